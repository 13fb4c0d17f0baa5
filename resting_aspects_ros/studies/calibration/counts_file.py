"""Read a counts file: parts, their counts on one surface, and what is known of the release."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from resting_aspects_ros.core.aspects.aspect import find_aspects
from resting_aspects_ros.core.errors import InvalidValueError, located, one_line, shown, warn
from resting_aspects_ros.core.input_file import named
from resting_aspects_ros.core.quantity_text import parse_quantity
from resting_aspects_ros.core.schema import FileModel, validated
from resting_aspects_ros.core.yaml_file import read_yaml
from resting_aspects_ros.simulation.conditions import QUANTITIES, DropConditions, HeightOf
from resting_aspects_ros.simulation.quantity import check_name
from resting_aspects_ros.studies.calibration.counted_part import CountedPart, read_groups
from resting_aspects_ros.studies.calibration.solids import KINDS, CountedEntry, make_solid
from resting_aspects_ros.studies.design import Factor, Setting, read_factor

MAX_BYTES = 1 << 20
MAX_PARTS = 50
DROPPED, THROWN = 'dropped', 'thrown'
# Values that are known, and ranges of those that are fitted, unless the file states others.
_COMMON: dict[str, float | str] = {
    'restitution': '0.05:0.95',
    'friction': '0.03:1:log',
    'height': '20mm:300mm:log',
    'rolling_friction': 0.003,
    'spinning_friction': 0.0,
    'gravity': 9.81,
    'speed_vertical': 0.0,
}
WAYS: dict[str, dict[str, float | str]] = {
    DROPPED: {**_COMMON, 'spin': 0.0, 'speed_horizontal': 0.0},
    THROWN: {**_COMMON, 'spin': '0:100', 'speed_horizontal': '0:1.5'},
}
EXPECTED = {
    'way': f'{DROPPED} (released at rest) or {THROWN} (with spin and speed)',
    'parts': f'a list of 1 to {MAX_PARTS} parts',
}


@dataclass(frozen=True, eq=False)
class SurfaceCounts:
    """Counts of parts on one surface.

    surface : str
        Name of the surface.
    source : str
        Origin of the counts.
    factors : tuple of Factor
        What is fitted, with its range.
    base : DropConditions
        Known values; those of factors are in the middle of their ranges.
    """

    surface: str
    source: str
    way: str
    factors: tuple[Factor, ...]
    base: DropConditions
    parts: tuple[CountedPart, ...]

    @property
    def drops(self) -> int:
        """Number of all counted drops."""
        return sum(each.drops for each in self.parts)


class CountsFile(FileModel):
    """A counts file; its parts and conditions are checked by themselves."""

    surface: Any = 'calibrated'
    source: Any = ''
    way: Literal['dropped', 'thrown'] = 'dropped'
    conditions: Any = None
    parts: list[Any]


def read_surface_counts(path: Path) -> SurfaceCounts:
    """Read a file; raises RestingAspectsError with one line that names the entry."""
    label = named('counts file', path)
    return make_surface_counts(read_yaml(path, 'counts file', MAX_BYTES), path.parent, label)


def make_surface_counts(document: Any, folder: Path, label: str = 'counts') -> SurfaceCounts:
    """Return the counts in a document with the keys of a counts file."""
    with located(label):
        given = validated(CountsFile, document, expected=EXPECTED)
        surface = check_name('a surface', given.surface)
        if not 1 <= len(given.parts) <= MAX_PARTS:
            raise InvalidValueError(
                f'invalid parts {shown(given.parts)}: expected a list of 1 to {MAX_PARTS} parts'
            )
        known = _known_of_all(given.parts)
        factors, base = made_conditions(given.conditions, given.way, known)
        fitted = {factor.name for factor in factors}
    parts = [
        _part(entry, folder, f'{label}, part {number}', fitted, base)
        for number, entry in enumerate(given.parts, 1)
    ]
    names = [part.name for part in parts]
    for name in names:
        if names.count(name) > 1:
            raise InvalidValueError(
                f'{label}: invalid parts: {shown(name)} is there twice: expected another name '
                'for each'
            )
    source = given.source if isinstance(given.source, str) else shown(given.source)
    return SurfaceCounts(surface, one_line(source, 1000), given.way, factors, base, tuple(parts))


def _known_of_all(entries: list[Any]) -> dict[str, Any]:
    """Return the conditions that each part states, with the values of the first."""
    stated = [
        entry['conditions']
        for entry in entries
        if isinstance(entry, Mapping) and isinstance(entry.get('conditions'), Mapping)
    ]
    if len(stated) < len(entries):
        return {}
    return {k: v for k, v in stated[0].items() if k in QUANTITIES and all(k in s for s in stated)}


def made_conditions(
    given: Any, way: str, known_of_all: Mapping[str, Any] | None = None
) -> tuple[tuple[Factor, ...], DropConditions]:
    """Return what is fitted and what is known, from the keys conditions and way of a file.

    ``known_of_all`` are conditions that all parts state. Raises InvalidValueError.
    """
    if way not in WAYS:
        raise InvalidValueError(f'invalid way {shown(way)}: expected {EXPECTED["way"]}')
    with located('conditions'):
        stated = _stated(given, 'height_of')
        height_of = stated.pop('height_of', HeightOf.LOWEST_POINT.name)
        both = {**WAYS[way], **(known_of_all or {}), **stated}
        ranges = {
            k: v
            for k, v in both.items()
            if isinstance(v, Mapping) or (isinstance(v, str) and ':' in v)
        }
        known = {k: _value(k, v) for k, v in both.items() if k not in ranges}
        # A factor needs unit and bounds only, which all conditions have.
        middle = {name: QUANTITIES[name].low or 1.0 for name in ranges}
        values: dict[str, Any] = {**middle, **known}
        base = DropConditions(**values, height_of=_height_of(height_of))
        factors = tuple(
            read_factor(k, ranges[k], Setting(base)) for k in QUANTITIES if k in ranges
        )
        if not factors:
            raise InvalidValueError(
                'invalid conditions: all values are known: expected a range for one or more'
            )
    middles = {f.name: float(f.values(np.array([0.5]))[0]) for f in factors}
    return factors, base.changed(**middles)


def _part(
    given: Any, folder: Path, where: str, fitted: set[str], base: DropConditions
) -> CountedPart:
    """Return a part with its counts; raises RestingAspectsError."""
    with located(where):
        entry = validated(CountedEntry, given, expected=KINDS)
        name = one_line(entry.name, 60)
    where = f'{where}, {name}' if name else where
    with located(where):
        part = make_solid(entry, folder)
        aspects = find_aspects(part)
        groups, names, counts = read_groups(entry.counts, entry.drops, entry.kind, aspects)
        with located('conditions'):
            values = {k: _value(k, v) for k, v in _stated(entry.conditions).items()}
            base.changed(**values)  # checks the values
        if both := sorted(fitted & set(values)):
            raise InvalidValueError(
                f'invalid {both[0]}: it is fitted for all parts: expected it known for all '
                'parts, or not stated here'
            )
    if counts.max() == counts.sum():
        warn(
            f'{where}: all {counts.sum()} drops are in {names[int(counts.argmax())]!r}: they '
            'tell little about the surface'
        )
    return CountedPart(name or part.name, part, aspects, groups, names, counts, values)


def _stated(given: Any, *others: str) -> dict[str, Any]:
    """Return a mapping of conditions; raises InvalidValueError for a name that is not known."""
    known = [*QUANTITIES, *others]
    if given is None:
        return {}
    if not isinstance(given, Mapping):
        raise InvalidValueError(f'invalid {shown(given)}: expected a mapping')
    for key in given:
        if key not in known:
            raise InvalidValueError(f'invalid key {shown(key)}: expected {", ".join(known)}')
    return dict(given)


def _value(name: str, given: Any) -> float:
    unit = QUANTITIES[name].unit
    number = (
        parse_quantity(name, given.replace(' ', ''), unit) if isinstance(given, str) else given
    )
    return QUANTITIES[name].check(name, number)


def _height_of(given: Any) -> HeightOf:
    if not isinstance(given, str) or given not in HeightOf.__members__:
        allowed = ' or '.join(h.name for h in HeightOf)
        raise InvalidValueError(f'invalid height_of {shown(given)}: expected {allowed}')
    return HeightOf[given]
