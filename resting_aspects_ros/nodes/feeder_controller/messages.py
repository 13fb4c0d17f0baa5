"""The parameters of the controller, and conversions between its messages and types."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Pose as PoseMsg
from rclpy.serialization import deserialize_message
from resting_aspects_interfaces.msg import (
    AspectDistribution,
    DetectionArray,
    FeederAdvice,
    FeederPick,
    PartDescription,
    RunDescription,
)
from resting_aspects_interfaces.msg import TransitionMatrix as TransitionMatrixMsg
from std_msgs.msg import Header

from resting_aspects_ros.api.forecast import footprints_of
from resting_aspects_ros.api.grasps import check_grasps, load_grasps
from resting_aspects_ros.api.identify import known_part
from resting_aspects_ros.aspects.find import ASPECT_NUMBERING
from resting_aspects_ros.errors import InvalidValueError, shown
from resting_aspects_ros.feeding.control import DEFAULT_MIN_SCORE, Choice, Expected
from resting_aspects_ros.feeding.evidence import (
    FedPart,
    KnownDrops,
    KnownFlips,
    Settings,
    SimulatedRun,
)
from resting_aspects_ros.feeding.footprint import MAX_REQUESTED, Tray
from resting_aspects_ros.feeding.image_advice import ChosenPart, CurrentAdvice
from resting_aspects_ros.feeding.steady_state import MAX_TIME, CycleTimes
from resting_aspects_ros.feeding.tray_state import Detection, Image, PickOutcome
from resting_aspects_ros.part.part import is_valid_name
from resting_aspects_ros.ros.conversions import (
    check_description,
    nanoseconds,
    part_from,
    pose_msg,
)
from resting_aspects_ros.ros.distribution_conversions import distribution_from
from resting_aspects_ros.ros.interface import CHOICES as NAMED_CHOICES
from resting_aspects_ros.ros.interface import RESULTS
from resting_aspects_ros.ros.parameters import Parameter
from resting_aspects_ros.ros.transition_conversions import (
    check_numbering,
    check_transitions,
    transition_matrix_from,
)
from resting_aspects_ros.statistics.intervals import Interval
from resting_aspects_ros.vision.grasp import Grasp
from resting_aspects_ros.vision.location import Pose
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
        ids = part.aspects.chosen(None, settings.pickable, 'pickable')
    except InvalidValueError:
        raise InvalidValueError(
            f'invalid pickable_classes {list(settings.pickable)}: expected symmetry classes of '
            f'{settings.part}, 1 to {len(part.outlines)}'
        ) from None
    if settings.grasps:
        check_grasps(settings.grasps, part.placements, ids)
    return ids


CHOICES = {Choice(name): number for number, name in NAMED_CHOICES.items()}
OUTCOMES = {number: PickOutcome(name) for number, name in RESULTS.items()}
UNKNOWN = Interval(math.nan, math.nan, math.nan)


def read_fed_part(data: bytes, name: str, grasps: tuple[Grasp, ...] = ()) -> FedPart:
    """Return the part in a serialized description on parts/<name>; runs in a FileWorker."""
    message = deserialize_message(data, PartDescription)
    check_description(message, name)
    part = part_from(message)
    known = known_part(part, {1: 1.0})  # the shares are not used: they are those of the drops
    check_grasps(grasps, known.placements, ())
    classes = known.aspects.classes()
    footprints = footprints_of(known.part, known.aspects, classes, grasps)
    return FedPart(known, footprints, grasps)


def drops_from(message: AspectDistribution) -> KnownDrops:
    """Return the drops in a message; raises InvalidValueError."""
    if message.aspect_numbering != ASPECT_NUMBERING:
        raise InvalidValueError(
            f'invalid aspect_numbering {message.aspect_numbering}: expected {ASPECT_NUMBERING}'
        )
    return KnownDrops(_run_from(message.run, message.complete), distribution_from(message))


def flips_from(message: TransitionMatrixMsg, part: str) -> KnownFlips:
    """Return the flips in a message on transitions/<part>; raises InvalidValueError."""
    check_transitions(message, part)
    check_numbering(message)
    name = message.action.name or message.action.kind
    run = _run_from(message.run, message.complete)
    return KnownFlips(run, name, transition_matrix_from(message))


def _run_from(run: RunDescription, complete: bool) -> SimulatedRun:
    return SimulatedRun(
        run.run_id, run.part, run.part_sha256, run.conditions, run.conditions.surface, complete
    )


def image_from(msg: DetectionArray) -> Image:
    """Return the image in a message; its values are checked by the tray state."""
    return Image(
        msg.image,
        nanoseconds(msg.header.stamp),
        msg.header.frame_id,
        tuple(
            Detection(k, d.part, d.class_id, d.score, d.x, d.y, d.yaw, d.clearance)
            for k, d in enumerate(msg.detections)
        ),
    )


def pick_msgs(picks: Sequence[ChosenPart], part: KnownPart) -> list[FeederPick]:
    """Return the messages for parts to be picked, with all poses."""
    return [
        FeederPick(
            detection=pick.detection.index,
            symmetry_class=pick.symmetry_class,
            score=pick.detection.score,
            poses=_pose_msgs(
                part.placements[pick.symmetry_class - 1].poses(
                    pick.detection.x, pick.detection.y, pick.detection.yaw
                )
            ),
            grasps=_pose_msgs(pick.grasps),
        )
        for pick in picks
    ]


def _pose_msgs(poses: Sequence[Pose]) -> list[PoseMsg]:
    return [pose_msg(pose.position.tolist(), pose.orientation.tolist()) for pose in poses]


def advice_msg(
    advice: CurrentAdvice,
    part: str,
    epoch: int,
    stamp: Time,
    picks: Sequence[FeederPick] = (),
    share: Interval = UNKNOWN,
    drops: int = 0,
    actions: int = 0,
) -> FeederAdvice:
    """Return the message for an advice."""
    return FeederAdvice(
        header=Header(stamp=stamp, frame_id=advice.frame),
        part=part,
        epoch=epoch,
        image=advice.image,
        choice=CHOICES[advice.choice],
        picks=picks,
        then=CHOICES[advice.then],
        supply=advice.supply,
        rate=_rate(advice),
        reason=advice.reason,
        pickable_share=share.probability,
        lower=share.lower,
        upper=share.upper,
        drops=drops,
        actions=actions,
        **_expected_fields(advice.expected),
    )


def _rate(advice: CurrentAdvice) -> float:
    expected = advice.expected.get(advice.choice)
    return math.nan if expected is None else expected.rate


def _expected_fields(expected: Mapping[Choice, Expected]) -> dict[str, list[float] | list[int]]:
    return {
        'choices': [CHOICES[choice] for choice in expected],
        'expected_picks': [each.picks for each in expected.values()],
        'seconds': [each.seconds for each in expected.values()],
        'rates': [each.rate for each in expected.values()],
    }
