"""The settings of a room, how a message changes them, and the controls that show them.

Units, bounds and texts are those of the declarations of conditions, actions and surroundings;
new here are only the ranges of the sliders, which are those that are useful in a feeder.
"""

import dataclasses
import json
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeAlias

from resting_aspects_ros.api.conditions import shipped_actions, shipped_surfaces
from resting_aspects_ros.api.forecast import CLEARANCE, IMAGE, ROBOT, TRAY
from resting_aspects_ros.api.forecast import DEFAULT_ACTION as FEEDER_ACTION
from resting_aspects_ros.errors import InvalidValueError, shown
from resting_aspects_ros.input_files import MAX_COUNTED, parse_quantity
from resting_aspects_ros.simulation.actions import NamedAction, make_action
from resting_aspects_ros.simulation.conditions import (
    DEFAULT_SURFACE,
    MAX_DROPS,
    QUANTITIES,
    DropConditions,
    Quantity,
    quantities_of,
)
from resting_aspects_ros.simulation.surroundings import (
    Surroundings,
    named_surroundings,
    surroundings_names,
)
from resting_aspects_ros.studio.page import TITLES
from resting_aspects_ros.tracks.description import MAX_TRAPS, Track, Wall
from resting_aspects_ros.tracks.traps import KINDS, CutOut, Surface, Trap, read_trap

Changes: TypeAlias = dict[str, Any]

DROPS = 2000
MORE = 4  # four times as many drops halve the intervals
PRECISIONS = {'0': 'number of drops', '0.02': '± 2 %', '0.01': '± 1 %', '0.005': '± 0.5 %'}
# The units in which a designer reads lengths and angles.
DISPLAY = {'m': 'mm', 'rad': 'deg', 'N s': 'mNs'}
# Ranges of the sliders, SI units. A number field beside each accepts all allowed values.
RANGES = {
    'height': (0.005, 0.3),
    'restitution': (0.0, 1.0),
    'friction': (0.0, 1.2),
    'rolling_friction': (0.0, 0.02),
    'spinning_friction': (0.0, 0.1),
    'gravity': (1.0, 20.0),
    'speed_horizontal': (0.0, 2.0),
    'speed_vertical': (0.0, 2.0),
    'spin': (0.0, 100.0),
    'robot': (0.3, 5.0),
    'image': (0.05, 1.0),
    'vibrate': (0.0, 5.0),
    'settle': (0.0, 3.0),
    'width': (0.05, 0.6),
    'depth': (0.05, 0.6),
    'clearance': (0.0, 0.03),
    'rail.width': (0.005, 0.2),
    'rail.roll': (0.0, math.radians(30)),
    'rail.wall_friction': (0.0, 1.0),
    'rail.speed': (0.01, 0.4),
    'rail.fill': (0.1, 1.0),
    'rail.tolerance': (0.0, 0.001),
}
# Those of values of actions and surroundings, by unit.
UNIT_RANGES = {
    'm': (0.0, 0.1),
    'm/s': (0.0, 2.0),
    'rad/s': (0.0, 100.0),
    'rad': (-math.radians(60), math.radians(60)),
    's': (0.0, 5.0),
    'Hz': (0.0, 200.0),
    'N': (0.0, 1.0),
    'N s': (0.0, 0.05),
    '': (0.0, 1.0),
}
STEPS = 200  # of a slider
MAIN_CONDITIONS = ('restitution', 'friction', 'height')
CELL = {
    'robot': Quantity('robot', 's', 'from one pick of the robot to the next', high=60, above=True),
    'vibrate': Quantity('motion of the feeder', 's', 'vibration before each image', high=60),
    'settle': Quantity('settling', 's', 'until the parts are at rest', high=60),
    'image': Quantity('image', 's', 'image and its evaluation', high=60),
    'width': Quantity('width of the tray', 'm', 'width of the tray', high=5, above=True),
    'depth': Quantity('depth of the tray', 'm', 'depth of the tray', high=5, above=True),
    'clearance': Quantity('clearance', 'm', 'minimum distance to any other part', high=1),
}
# The track of a feeder: the width, if it is not the default, and what it shares with `track`.
RAIL = {
    'width': quantities_of(Surface)['width'],
    'roll': quantities_of(Surface)['roll'],
    'wall_friction': dataclasses.replace(quantities_of(Wall)['friction'], label='wall friction'),
    'speed': quantities_of(Track)['speed'],
    'fill': quantities_of(Track)['fill'],
    'tolerance': Quantity('tolerance', 'm', 'half width of the dimensions of parts', high=0.1),
}
MAX_ROW = 1000  # of the orientations on a track
MAX_ON_TRAY = 1000  # parts
# Traps that are described by numbers alone, and what a new one has, SI units.
TRAP_KINDS = [kind for kind in KINDS if kind != CutOut.kind]
NEW_TRAP = {'m': 0.01, 'N': 0.1}
NEW_START = 0.005


@dataclass(frozen=True)
class Rail:
    """The track of a bowl feeder.

    width : float or None
        m; None: that fits the part.
    traps : tuple of Trap or None
        None: those that are proposed for the wanted row.
    """

    width: float | None = None
    roll: float = math.radians(5)
    wall_friction: float = Wall().friction
    speed: float = 0.05
    fill: float = 1.0
    tolerance: float = 0.0
    want: int = 1
    traps: tuple[Trap, ...] | None = None


@dataclass(frozen=True)
class Cell:
    """The feeder, the camera and the robot; a time that is None is that of the action."""

    robot: float = ROBOT
    vibrate: float | None = None
    settle: float | None = None
    image: float = IMAGE
    width: float = TRAY[0]
    depth: float = TRAY[1]
    clearance: float = CLEARANCE
    parts_on_tray: int | None = None
    action: str = FEEDER_ACTION


def _default_conditions() -> DropConditions:
    return shipped_surfaces().get(DEFAULT_SURFACE)


def _default_action() -> NamedAction:
    return shipped_actions().get('tap')


@dataclass(frozen=True)
class Settings:
    """Everything that the user of a tab has chosen.

    classes : int
        Number of symmetry classes of the part; 0 without a part.
    surroundings : str
        Their name; empty for a level plane. ``conditions`` have the surroundings themselves.
    pickable : frozenset of int
        Numbers of symmetry classes.
    other : DropConditions
        Those of the second side of a comparison.
    counts : mapping of str to int
        Parts that were counted by hand, by number of the class or 'unclassified'.
    fit : bool
        Whether a surface is fitted to these counts.
    """

    tab: str = 'aspects'
    live: bool = True
    conditions: DropConditions = field(default_factory=_default_conditions)
    surroundings: str = ''
    drops: int = DROPS
    precision: float = 0.0
    seed: int = 1
    classes: int = 0
    pickable: frozenset[int] = frozenset()
    action: NamedAction = field(default_factory=_default_action)
    cell: Cell = Cell()
    rail: Rail = Rail()
    other: DropConditions = field(default_factory=_default_conditions)
    counts: Mapping[str, int] = field(default_factory=dict)
    fit: bool = False

    def for_part(self, classes: int) -> 'Settings':
        """Return the settings for another part: nothing is pickable, nothing is counted."""
        return dataclasses.replace(
            self, classes=classes, pickable=frozenset(), counts={}, fit=False
        )

    def same_conditions(self) -> 'Settings':
        """Return the settings with the conditions of the first side on the second one."""
        return dataclasses.replace(self, other=self.conditions)


# -- Changes --------------------------------------------------------------------------------------


def changed(settings: Settings, name: str, value: Any) -> Settings:
    """Return the settings after a message; raises InvalidValueError.

    ``name`` is that of a control, such as 'live' or 'condition.friction'; ``value`` is what the
    browser sent: a number or a text in the unit of the control, or a truth value.
    """
    group, _, key = name.partition('.')
    if group not in _CHANGES:
        raise InvalidValueError(f'invalid setting {shown(name)}: expected a control of the page')
    return dataclasses.replace(settings, **_CHANGES[group](settings, key, value))


def number_of(name: str, quantity: Quantity, value: Any) -> float:
    """Return a number in the unit of its control in SI units; raises InvalidValueError."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise InvalidValueError(f'invalid {name} {shown(value)}: expected a number')
    text = str(value).strip()[:40]
    if text[-1:].isdigit() or text.endswith('.'):
        text += DISPLAY.get(quantity.unit, '')
    number = parse_quantity(quantity.label, text, quantity.unit)
    return quantity.check(quantity.label, number)


def _choice(name: str, value: Any, known: Any) -> str:
    if not isinstance(value, str) or value not in known:
        raise InvalidValueError(
            f'invalid {name} {shown(value)}: expected one of {", ".join(map(str, known))}'
        )
    return value


def _integer(name: str, value: Any, low: int, high: int) -> int:
    text = str(value).strip()[:20] if isinstance(value, int | str) else ''
    if not text.isascii() or not text.isdigit() or not low <= int(text) <= high:
        raise InvalidValueError(
            f'invalid {name} {shown(value)}: expected an integer from {low} to {high}'
        )
    return int(text)


def _truth(name: str, value: Any) -> bool:
    if not isinstance(value, bool):
        raise InvalidValueError(f'invalid {name} {shown(value)}: expected true or false')
    return value


def _quantity(known: Mapping[str, Quantity], key: str) -> Quantity:
    if key not in known:
        raise InvalidValueError(f'invalid value {shown(key)}: expected one of {", ".join(known)}')
    return known[key]


# What each group of controls changes: called with the settings, the rest of the name of the
# control, and the value.


def _set_surface(settings: Settings, _key: str, value: Any) -> Changes:
    chosen = shipped_surfaces().get(_choice('surface', value, shipped_surfaces().names()))
    around = settings.conditions.surroundings
    return {'conditions': dataclasses.replace(chosen, surroundings=around)}


def _set_condition(settings: Settings, key: str, value: Any) -> Changes:
    number = number_of(key, _quantity(QUANTITIES, key), value)
    conditions = settings.conditions.changed(**{key: number})
    return {'conditions': shipped_surfaces().named(conditions)}


def _set_surroundings(settings: Settings, _key: str, value: Any) -> Changes:
    name = _choice('surroundings', value, ['', *surroundings_choices()])
    around = named_surroundings(name) if name else None
    return {'conditions': settings.conditions.changed(surroundings=around), 'surroundings': name}


def _set_dimension(settings: Settings, key: str, value: Any) -> Changes:
    around = settings.conditions.surroundings
    if around is None:
        raise InvalidValueError(f'invalid dimension {shown(key)}: expected surroundings first')
    number = number_of(key, _quantity(quantities_of(around.shape), key), value)
    around = named_surroundings(settings.surroundings, dimensions(around) | {key: number})
    return {'conditions': settings.conditions.changed(surroundings=around)}


def _set_pickable(settings: Settings, key: str, value: Any) -> Changes:
    number = _integer('class', key, 1, settings.classes)
    without = settings.pickable - {number}
    return {'pickable': without | {number} if _truth('pickable', value) else without}


def _set_action(settings: Settings, key: str, value: Any) -> Changes:
    if not key:
        known = shipped_actions()
        return {'action': known.get(_choice('action', value, known.names()))}
    before = settings.action
    number = number_of(key, _quantity(quantities_of(before.action), key), value)
    made = make_action(before.action.kind, {**before.action.numbers, key: number})
    shipped = shipped_actions().get(before.name.removesuffix('_changed'))
    if shipped.action == made:
        return {'action': shipped}
    # The name that `resting_aspects reorient` gives an action with other values.
    return {'action': NamedAction(f'{shipped.name}_changed', made, before.time)}


def _set_cell(settings: Settings, key: str, value: Any) -> Changes:
    changes: Changes
    if key == 'action':
        name = _choice('action', value, shipped_actions().names())
        changes = {'action': name, 'vibrate': None, 'settle': None}
    elif key == 'parts_on_tray':
        most = MAX_ON_TRAY
        number = None if value == '' else _integer('number of parts on the tray', value, 1, most)
        changes = {key: number}
    else:
        changes = {key: number_of(key, _quantity(CELL, key), value)}
    return {'cell': dataclasses.replace(settings.cell, **changes)}


def _set_rail(settings: Settings, key: str, value: Any) -> Changes:
    made: float | None
    if key == 'want':
        made = _integer('row', value, 1, MAX_ROW)
    elif key == 'width' and value == '':
        made = None
    else:
        made = number_of(key, _quantity(RAIL, key), value)
    changes: Changes = {key: made}
    return {'rail': dataclasses.replace(settings.rail, **changes)}


def _set_trap(settings: Settings, key: str, value: Any) -> Changes:
    """Change a dimension, as in '0.height', or 'all' traps, 'add' one, 'remove' one."""
    traps = list(settings.rail.traps or ())
    number, _, name = key.partition('.')
    if key == 'all':
        made = _listed_traps(value)
    elif key == 'add':
        made = (*traps, _new_trap(_choice('trap', value, TRAP_KINDS)))
    elif key == 'remove':
        del traps[_integer('trap', value, 1, len(traps)) - 1]
        made = tuple(traps)
    else:
        k = _integer('trap', number, 1, len(traps)) - 1
        given = number_of(name, _quantity(quantities_of(traps[k]), name), value)
        traps[k] = dataclasses.replace(traps[k], **{name: given})
        made = tuple(traps)
    if len(made) > MAX_TRAPS:
        raise InvalidValueError(f'invalid number of traps: expected at most {MAX_TRAPS}')
    return {'rail': dataclasses.replace(settings.rail, traps=made or None)}


def _listed_traps(text: Any) -> tuple[Trap, ...]:
    """Return the traps of a JSON text; raises InvalidValueError."""
    try:
        found = json.loads(text)
    except (TypeError, ValueError, RecursionError):
        found = None
    if not isinstance(found, list):
        raise InvalidValueError(f'invalid traps {shown(text)}: expected a list in JSON')
    made = tuple(read_trap(each) for each in found)
    for trap in made:
        _choice('trap', trap.kind, TRAP_KINDS)
    return made


def _new_trap(kind: str) -> Trap:
    known = quantities_of(KINDS[kind])
    has_default = KINDS[kind].__dataclass_fields__
    values = {
        name: NEW_START if name == 'start' else NEW_TRAP[each.unit]
        for name, each in known.items()
        if has_default[name].default is dataclasses.MISSING
    }
    return read_trap({'kind': kind, **values})


def _set_other(settings: Settings, key: str, value: Any) -> Changes:
    side = dataclasses.replace(settings, conditions=settings.other)
    return {'other': changed(side, key, value).conditions}


def _set_count(settings: Settings, key: str, value: Any) -> Changes:
    if key != 'unclassified':
        _integer('class', key, 1, settings.classes)
    number = 0 if value == '' else _integer('number of parts', value, 0, MAX_COUNTED)
    return {'counts': {**settings.counts, key: number}, 'fit': False}


_CHANGES: dict[str, Callable[[Settings, str, Any], Changes]] = {
    'tab': lambda _settings, _key, value: {'tab': _choice('tab', value, TITLES)},
    'live': lambda _settings, _key, value: {'live': _truth('live', value)},
    'surface': _set_surface,
    'condition': _set_condition,
    'surroundings': _set_surroundings,
    'dimension': _set_dimension,
    'drops': lambda _settings, _key, value: {
        'drops': _integer('number of drops', value, 1, MAX_DROPS),
        'precision': 0.0,
    },
    'more': lambda settings, _key, _value: {'drops': min(MORE * settings.drops, MAX_DROPS)},
    'precision': lambda _settings, _key, value: {
        'precision': float(_choice('precision', value, PRECISIONS))
    },
    'pickable': _set_pickable,
    'action': _set_action,
    'cell': _set_cell,
    'rail': _set_rail,
    'trap': _set_trap,
    'other': _set_other,
    'count': _set_count,
    'fit': lambda _settings, _key, _value: {'fit': True},
}


def counts_csv(settings: Settings) -> str:
    """Return the counts as the file that `resting_aspects compare` reads."""
    names = [*map(str, range(1, settings.classes + 1)), 'unclassified']
    lines = [f'{name},{settings.counts.get(name, 0)}' for name in names]
    return '\n'.join(['class,count', *lines]) + '\n'


# -- Controls -------------------------------------------------------------------------------------


def surroundings_choices() -> list[str]:
    """Return the names of the surroundings that the page offers beside the level plane."""
    return [name for name in surroundings_names() if name != 'plane']


def dimensions(around: Surroundings) -> dict[str, float]:
    """Return the dimensions of surroundings by name, SI units."""
    return {name: getattr(around.shape, name) for name in quantities_of(around.shape)}


@dataclass(frozen=True)
class Slider:
    """A slider with a number field; numbers are in ``unit``."""

    name: str
    label: str
    text: str
    unit: str
    low: str
    high: str
    step: str
    value: str


def slider(name: str, key: str, quantity: Quantity, value: float | None) -> Slider:
    """Return the slider of a quantity."""
    unit = DISPLAY.get(quantity.unit, quantity.unit)
    scale = parse_quantity('unit', f'1{DISPLAY.get(quantity.unit, "")}', quantity.unit)
    low, high = RANGES[key] if key in RANGES else UNIT_RANGES[quantity.unit]
    low, high = max(low, quantity.low), min(high, quantity.high)
    if value is not None:
        low, high = min(low, value), max(high, value)
    low, high = low / scale, high / scale
    step = 10 ** math.floor(math.log10((high - low) / STEPS)) if high > low else 1.0
    return Slider(
        name,
        quantity.label,
        quantity.text,
        unit,
        f'{low:.6g}',
        f'{high:.6g}',
        f'{step:.6g}',
        '' if value is None else f'{value / scale:.6g}',
    )


def condition_sliders(conditions: DropConditions, prefix: str = '') -> list[Slider]:
    """Return the sliders of the conditions, the most important first."""
    order = [*MAIN_CONDITIONS, *(name for name in QUANTITIES if name not in MAIN_CONDITIONS)]
    return [
        slider(f'{prefix}condition.{name}', name, QUANTITIES[name], getattr(conditions, name))
        for name in order
    ]


def dimension_sliders(settings: Settings) -> list[Slider]:
    """Return the sliders of the surroundings; none on a level plane."""
    around = settings.conditions.surroundings
    if around is None:
        return []
    known = quantities_of(around.shape)
    return [
        slider(f'dimension.{name}', '', known[name], value)
        for name, value in dimensions(around).items()
    ]


def action_sliders(action: NamedAction) -> list[Slider]:
    """Return the sliders of the values of an action."""
    return [
        slider(f'action.{name}', '', quantity, getattr(action.action, name))
        for name, quantity in quantities_of(action.action).items()
    ]


def cell_sliders(cell: Cell) -> list[Slider]:
    """Return the sliders of the feeder, the camera and the robot."""
    action = shipped_actions().get(cell.action)
    own = {'vibrate': action.moving_time, 'settle': action.time - action.moving_time}
    return [
        slider(f'cell.{name}', name, quantity, own.get(name) if value is None else value)
        for name, quantity in CELL.items()
        for value in [getattr(cell, name)]
    ]


def rail_sliders(rail: Rail) -> list[Slider]:
    """Return the sliders of the track of a bowl feeder."""
    return [
        slider(f'rail.{name}', f'rail.{name}', quantity, getattr(rail, name))
        for name, quantity in RAIL.items()
    ]


def trap_sliders(rail: Rail) -> list[tuple[str, str, list[Slider]]]:
    """Return kind, explanation and sliders of each trap of the user."""
    return [
        (
            trap.kind.replace('_', ' '),
            (trap.__doc__ or '').partition('\n')[0],
            [
                slider(f'trap.{number}.{name}', '', quantity, getattr(trap, name))
                for name, quantity in quantities_of(trap).items()
            ],
        )
        for number, trap in enumerate(rail.traps or (), 1)
    ]


def control_values(settings: Settings) -> Iterator[tuple[str, Any]]:
    """Yield the name and the value of each control of the page."""
    yield 'live', settings.live
    yield 'surface', settings.conditions.surface
    yield 'surroundings', settings.surroundings
    yield 'drops', str(settings.drops)
    yield 'precision', f'{settings.precision:g}'
    yield 'action', settings.action.name.removesuffix('_changed')
    yield 'cell.action', settings.cell.action
    yield 'cell.parts_on_tray', str(settings.cell.parts_on_tray or '')
    yield 'rail.want', str(settings.rail.want)
    yield 'trap.add', ''
    yield 'other.surface', settings.other.surface
    for number in range(1, settings.classes + 1):
        yield f'pickable.{number}', number in settings.pickable
    for name, count in settings.counts.items():
        yield f'count.{name}', str(count)
    for each in [
        *condition_sliders(settings.conditions),
        *dimension_sliders(settings),
        *action_sliders(settings.action),
        *cell_sliders(settings.cell),
        *rail_sliders(settings.rail),
        *(each for _, _, sliders in trap_sliders(settings.rail) for each in sliders),
        *condition_sliders(settings.other, 'other.'),
    ]:
        yield each.name, each.value
