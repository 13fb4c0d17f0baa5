"""The parameters of feeder_controller, and the settings that they state."""

from pathlib import Path
from typing import Any

from resting_aspects_ros.api.forecast import pickable_aspects
from resting_aspects_ros.api.grasps import check_grasps, load_grasps
from resting_aspects_ros.errors import InvalidValueError, shown
from resting_aspects_ros.feeding.control import DEFAULT_MIN_SCORE
from resting_aspects_ros.feeding.evidence import Settings
from resting_aspects_ros.feeding.footprint import MAX_REQUESTED, Tray
from resting_aspects_ros.feeding.steady_state import MAX_TIME, CycleTimes
from resting_aspects_ros.part.part import is_valid_name
from resting_aspects_ros.ros.parameters import Parameter
from resting_aspects_ros.vision.rolling import KnownPart

TIME = (0.0, MAX_TIME)
PARAMETERS = (
    Parameter('part', 'l_bracket', 'name of the part in the feeder'),
    Parameter('pickable_classes', [1], 'symmetry classes in which the robot can pick the part'),
    Parameter('clearance', 0.005, 'free distance that the gripper needs, m', (0.0, 1.0)),
    Parameter(
        'grasps', '', 'YAML file of the grasps of the part; empty: only the clearance matters'
    ),
    Parameter('tray', [0.2, 0.2], 'width and depth of the tray, m'),
    Parameter('robot_time', 1.2, 'time from one pick to the next, s', (0.001, MAX_TIME)),
    Parameter(
        'place_time', 0.0, 'part of it in which the feeder and the camera may work, s', TIME
    ),
    Parameter('vibrate_time', 0.6, 'duration of a flip, s', TIME),
    Parameter('settle_time', 0.6, 'time until the parts are at rest, s', TIME),
    Parameter('image_time', 0.2, 'time of an image and its evaluation, s', TIME),
    Parameter('supply_time', 0.0, 'time to supply a part, s', TIME),
    Parameter('spread_time', 0.0, 'duration of a spread, s; 0: the feeder has none', TIME),
    Parameter('best_number', 0, 'parts on the tray; 0: the best number', (0, MAX_REQUESTED)),
    Parameter('max_picks', 0, 'maximum number of picks after an image; 0: all', (0, 1000)),
    Parameter('max_supply', 0, 'maximum number of parts supplied at once; 0: all', (0, 1000)),
    Parameter(
        'min_score', DEFAULT_MIN_SCORE, 'minimum score of a part that is picked', (0.0, 1.0)
    ),
    Parameter('action', 'flip', 'action whose transitions are those of a flip'),
)


def settings_from(values: dict[str, Any]) -> Settings:
    """Return the settings from the parameters; raises InvalidValueError."""
    part, pickable = values['part'], sorted(set(values['pickable_classes'] or ()))
    if not is_valid_name(part):
        raise InvalidValueError(f'invalid part {shown(part)}: expected the name of a part')
    if not pickable or pickable[0] < 1:
        raise InvalidValueError(
            f'invalid pickable_classes {pickable}: expected numbers of symmetry classes, from 1'
        )
    sides = tuple(values['tray'] or ())
    if len(sides) != 2:
        raise InvalidValueError(f'invalid tray {list(sides)}: expected width and depth, m')
    if not values['action'].isidentifier():
        raise InvalidValueError(
            f'invalid action {shown(values["action"])}: expected the name of an action'
        )
    names = ('robot', 'place', 'vibrate', 'settle', 'image', 'supply')
    return Settings(
        part=part,
        pickable=tuple(pickable),
        action=values['action'],
        grasps=load_grasps(Path(values['grasps'])) if values['grasps'] else (),
        tray=Tray((sides[0], sides[1]), values['clearance']),
        times=CycleTimes(**{name: values[f'{name}_time'] for name in names}),
        spread=values['spread_time'] or None,
        best_number=values['best_number'] or None,
        max_picks=values['max_picks'] or None,
        max_supply=values['max_supply'] or None,
        min_score=values['min_score'],
    )


def pickable_ids(part: KnownPart, settings: Settings) -> tuple[int, ...]:
    """Return the ids of the aspects of the pickable classes.

    Raises InvalidValueError if the part does not have one of the classes, or if one has no grasp.
    """
    try:
        ids = pickable_aspects(part.aspects, None, settings.pickable)
    except InvalidValueError:
        raise InvalidValueError(
            f'invalid pickable_classes {list(settings.pickable)}: expected symmetry classes of '
            f'{settings.part}, 1 to {len(part.outlines)}'
        ) from None
    if settings.grasps:
        check_grasps(settings.grasps, part.placements, ids)
    return ids
