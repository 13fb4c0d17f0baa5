"""Read a counts file: parts, their counts on one surface, and what is known of the release."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from resting_aspects_ros.core.aspects.aspect import find_aspects
from resting_aspects_ros.core.errors import InvalidValueError, RestingAspectsError, one_line, shown
from resting_aspects_ros.core.input_file import named
from resting_aspects_ros.core.part import is_valid_name
from resting_aspects_ros.core.quantity_text import parse_quantity
from resting_aspects_ros.core.yaml_file import read_yaml
from resting_aspects_ros.simulation.conditions import QUANTITIES, DropConditions, HeightOf
from resting_aspects_ros.studies.calibration.counted_part import CountedPart, read_groups
from resting_aspects_ros.studies.calibration.solids import KINDS, make_solid
from resting_aspects_ros.studies.factors import Factor, read_factor
from resting_aspects_ros.studies.setting import Setting

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
_KEYS = {'surface', 'source', 'way', 'conditions', 'parts'}
_PART_KEYS = {'name', 'unit', 'counts', 'drops', 'conditions', *KINDS}


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


def read_surface_counts(path: Path) -> SurfaceCounts:
    """Read a file; raises RestingAspectsError with one line that names the entry."""
    label = named('counts file', path)
    return make_surface_counts(read_yaml(path, 'counts file', MAX_BYTES), path.parent, label)


def make_surface_counts(document: Any, folder: Path, label: str = 'counts') -> SurfaceCounts:
    """Return the counts in a document with the keys of a counts file."""
    given = _mapping(document, _KEYS, label)
    surface = given.get('surface', 'calibrated')
    if not isinstance(surface, str) or not is_valid_name(surface):
        raise InvalidValueError(
            f'{label}: invalid surface {shown(surface)}: expected a name such as oak_table'
        )
    way = _checked_way(given.get('way', DROPPED), label)
    entries = given.get('parts')
    if not isinstance(entries, list) or not 1 <= len(entries) <= MAX_PARTS:
        raise InvalidValueError(
            f'{label}: invalid parts {shown(entries)}: expected a list of 1 to {MAX_PARTS} parts'
        )
    factors, base = _conditions(given.get('conditions', {}), way, _known_of_all(entries), label)
    fitted = {factor.name for factor in factors}
    parts = [
        _part(entry, folder, f'{label}, part {number}', fitted, base)
        for number, entry in enumerate(entries, 1)
    ]
    names = [part.name for part in parts]
    for name in names:
        if names.count(name) > 1:
            raise InvalidValueError(
                f'{label}: invalid parts: {shown(name)} is there twice: expected another name '
                'for each'
            )
    source = one_line(str(given.get('source', '')), 1000)
    return SurfaceCounts(surface, source, way, factors, base, tuple(parts))


def made_conditions(given: Any, way: str) -> tuple[tuple[Factor, ...], DropConditions]:
    """Return what is fitted and what is known, from the keys conditions and way of a file."""
    return _conditions(given, _checked_way(way, 'counts'), {}, 'counts')


def _checked_way(way: Any, label: str) -> str:
    if not isinstance(way, str) or way not in WAYS:
        raise InvalidValueError(
            f'{label}: invalid way {shown(way)}: expected {DROPPED} (released at rest) or '
            f'{THROWN} (with spin and speed)'
        )
    return way


def _mapping(given: Any, keys: set[str], where: str) -> Mapping[str, Any]:
    if not isinstance(given, Mapping) or not all(isinstance(key, str) for key in given):
        raise InvalidValueError(f'{where}: invalid {shown(given)}: expected a mapping')
    if unknown := sorted(set(given) - keys):
        raise InvalidValueError(
            f'{where}: invalid key {shown(unknown[0])}: expected {", ".join(sorted(keys))}'
        )
    return given


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


def _conditions(
    given: Any, way: str, known_of_all: Mapping[str, Any], label: str
) -> tuple[tuple[Factor, ...], DropConditions]:
    """Return what is fitted, and the known conditions."""
    where = f'{label}, conditions'
    stated = dict(_mapping(given, {*QUANTITIES, 'height_of'}, where))
    height_of = _height_of(stated.pop('height_of', HeightOf.LOWEST_POINT.name), where)
    both = {**WAYS[way], **known_of_all, **stated}
    ranges = {k: v for k, v in both.items() if isinstance(v, Mapping) or ':' in str(v)}
    known = {k: _value(k, v, where) for k, v in both.items() if k not in ranges}
    # A factor needs unit and bounds only, which all conditions have.
    middle = {name: QUANTITIES[name].low or 1.0 for name in ranges}
    values: dict[str, Any] = {**middle, **known, 'height_of': height_of}
    base = DropConditions(**values)
    try:
        factors = tuple(
            read_factor(k, ranges[k], Setting(base)) for k in QUANTITIES if k in ranges
        )
    except InvalidValueError as error:
        raise InvalidValueError(f'{where}: {error}') from None
    if not factors:
        raise InvalidValueError(
            f'{where}: invalid conditions: all values are known: expected a range for one or more'
        )
    middles = {f.name: float(f.values(np.array([0.5]))[0]) for f in factors}
    return factors, base.changed(**middles)


def _part(
    given: Any, folder: Path, where: str, fitted: set[str], base: DropConditions
) -> CountedPart:
    entry = _mapping(given, _PART_KEYS, where)
    name = one_line(str(entry.get('name', '')), 60)
    where = f'{where}, {name}' if name else where
    try:
        part = make_solid(entry, folder, where)
    except RestingAspectsError as error:
        text = str(error)
        raise type(error)(text if text.startswith(where) else f'{where}: {text}') from None
    aspects = find_aspects(part)
    kind = next(kind for kind in KINDS if kind in entry)
    groups, names, counts = read_groups(
        entry.get('counts'), entry.get('drops'), kind, aspects, where
    )
    stated = _mapping(entry.get('conditions', {}), set(QUANTITIES), f'{where}, conditions')
    values = {k: _value(k, v, f'{where}, conditions') for k, v in stated.items()}
    if both := sorted(fitted & set(values)):
        raise InvalidValueError(
            f'{where}: invalid {both[0]}: it is fitted for all parts: expected it known for all '
            'parts, or not stated here'
        )
    base.changed(**values)  # checks the values
    return CountedPart(name or part.name, part, aspects, groups, names, counts, values)


def _value(name: str, given: Any, where: str) -> float:
    try:
        unit = QUANTITIES[name].unit
        number = (
            parse_quantity(name, given.replace(' ', ''), unit) if isinstance(given, str) else given
        )
        return QUANTITIES[name].check(name, number)
    except InvalidValueError as error:
        raise InvalidValueError(f'{where}: {error}') from None


def _height_of(given: Any, where: str) -> HeightOf:
    if not isinstance(given, str) or given not in HeightOf.__members__:
        allowed = ' or '.join(h.name for h in HeightOf)
        raise InvalidValueError(f'{where}: invalid height_of {shown(given)}: expected {allowed}')
    return HeightOf[given]
