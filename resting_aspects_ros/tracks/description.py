"""A track with its traps, as a YAML file describes it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from resting_aspects_ros.errors import InvalidValueError, located, shown
from resting_aspects_ros.input_files import named, parse_quantity, read_yaml
from resting_aspects_ros.simulation.conditions import (
    Described,
    Quantity,
    made_from,
    quantities_of,
    quantity,
)
from resting_aspects_ros.tracks.traps import (
    KINDS,
    MAX_SIZE,
    Balcony,
    Cut,
    Groove,
    Surface,
    Trap,
    read_trap,
    trap_text,
)

MAX_TRAPS = 20


@dataclass(frozen=True)
class Wall(Described):
    """The wall along which the track conveys the part. Only what is below its top touches it."""

    height: float = quantity(
        'height', 'm', 'height of the wall', high=MAX_SIZE, above=True, default=MAX_SIZE
    )
    friction: float = quantity('friction', '', 'friction of the wall', high=10.0, default=0.2)


@dataclass(frozen=True)
class Track(Described):
    """A track with traps, which a part passes one after the other.

    speed : float
        At which the track conveys parts, m/s.
    fill : float
        Share of the length of the track that parts cover before the traps, 0 to 1.
    """

    surface: Surface
    wall: Wall = field(default_factory=Wall)
    speed: float = quantity(
        'speed', 'm/s', 'speed of the parts', high=10.0, above=True, default=0.05
    )
    fill: float = quantity(
        'fill', '', 'share of the track that parts cover', high=1.0, above=True, default=1.0
    )
    traps: tuple[Trap, ...] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.traps) > MAX_TRAPS:
            raise InvalidValueError(
                f'invalid number of traps {len(self.traps)}: expected at most {MAX_TRAPS}'
            )
        for trap in self.traps:
            _check_fits(trap, self.surface)

    @property
    def document(self) -> dict[str, Any]:
        """The track as plain values in SI units, as `read_track` reads it."""
        return {
            **self.surface.numbers,
            'wall': self.wall.numbers,
            **self.numbers,
            'traps': [trap.document for trap in self.traps],
        }


def _check_fits(trap: Trap, surface: Surface) -> None:
    """Raise InvalidValueError if a trap is beyond the edge of the track."""
    for name in ('width', 'start', 'centre', 'depth'):
        value = getattr(trap, name, None)
        if value is not None and value > surface.width and not isinstance(trap, Groove):
            raise InvalidValueError(
                f'invalid {name} {1000 * value:g} mm of a {trap.kind}: expected at most the width '
                f'of the track, {1000 * surface.width:g} mm'
            )
    inside = isinstance(trap, Cut) and trap.removed().intersection(surface.area).area > 0
    if isinstance(trap, Cut) and not isinstance(trap, Balcony) and not inside:
        raise InvalidValueError(
            f'invalid {trap.kind}, {trap_text(trap)}: expected one that cuts into the track, '
            f'which is {1000 * surface.width:g} mm wide'
        )


def read_track_file(path: Path) -> Track:
    """Return the track of a YAML file; raises InvalidValueError."""
    with located(named('track', path)):
        return read_track(read_yaml(path, 'track'))


def read_track(document: Any) -> Track:
    """Return the track of a mapping; numbers are in SI units or have a unit as text.

    Raises InvalidValueError.
    """
    if not isinstance(document, Mapping):
        raise InvalidValueError(f'invalid track {shown(document)}: expected a mapping')
    given = dict(document)
    given.pop('source', None)
    traps, wall = given.pop('traps', []), given.pop('wall', {})
    if not isinstance(traps, list):
        raise InvalidValueError(f'invalid traps {shown(traps)}: expected a list of traps')
    if not isinstance(wall, Mapping):
        raise InvalidValueError(f'invalid wall {shown(wall)}: expected a mapping')
    with located('wall'):
        beside = made_from({'wall': Wall}, 'wall', 'wall', _numbers(Wall, wall))
    found = []
    for k, each in enumerate(traps, 1):
        with located(f'trap {k}'):
            found.append(read_trap(_trap_numbers(each)))
    names = list(quantities_of(Track))
    own = _numbers(Track, {name: given.pop(name) for name in names if name in given})
    names += ['wall', 'traps']
    surface = made_from({'track': Surface}, 'track', 'track', _numbers(Surface, given), names)
    return Track(surface, beside, traps=tuple(found), **own)


def _trap_numbers(given: Any) -> Any:
    """Return the mapping of a trap with its texts as numbers."""
    if not isinstance(given, Mapping) or given.get('kind') not in KINDS:
        return given
    found = _numbers(KINDS[given['kind']], given)
    points = given.get('points')
    if isinstance(points, list):
        found['points'] = tuple(
            tuple(_number('points', c, Quantity('', 'm', '')) for c in each)
            if isinstance(each, list)
            else each
            for each in points
        )
    return found


def _numbers(declared: Any, given: Mapping[Any, Any]) -> dict[str, Any]:
    """Return the values of a dataclass with numbers instead of texts with units."""
    known = quantities_of(declared)
    return {str(name): _number(str(name), each, known.get(name)) for name, each in given.items()}


def _number(name: str, given: Any, expected: Quantity | None) -> Any:
    if expected is None or not isinstance(given, str):
        return given
    return parse_quantity(name, given, expected.unit)
