"""A counts file: parts that were counted on one surface, and what is known of the release."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import StrictInt, StrictStr

from resting_aspects_ros.api.conditions import shipped_surfaces
from resting_aspects_ros.api.counts import parse_group
from resting_aspects_ros.arrays import Array, Counts
from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.errors import (
    InvalidValueError,
    PartError,
    located,
    one_line,
    shown,
    warn,
)
from resting_aspects_ros.input_files import (
    MAX_COUNTED,
    Count,
    FileModel,
    Number,
    Positive,
    named,
    read_yaml,
    validated,
)
from resting_aspects_ros.part.library import load_part
from resting_aspects_ros.part.loading import part_from_bytes
from resting_aspects_ros.part.part import DEFAULT_UNIT, Part, valid_name
from resting_aspects_ros.simulation.conditions import (
    DEFAULT_SURFACE,
    QUANTITIES,
    DropConditions,
    check_name,
)
from resting_aspects_ros.studies.design import (
    Factor,
    Setting,
    condition_values,
    point_values,
    read_factor,
)

MAX_BYTES = 1 << 20
MAX_PARTS = 50
MAX_CORNERS = 10_000
SECTIONS = 64  # flats of a cylinder
# A direction is along an axis within this angle.
AXIS_ANGLE = np.radians(3.0)
# Names of counts: all other aspects, and drops that are not compared with the simulation.
REST, IGNORED = 'rest', 'unclassified'
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
    'dropped': {**_COMMON, 'spin': 0.0, 'speed_horizontal': 0.0},
    'thrown': {**_COMMON, 'spin': '0:100', 'speed_horizontal': '0:1.5'},
}
# How a part is given, with what is expected.
KINDS = {
    'part': 'the name of a part',
    'mesh': 'a mesh file',
    'box': 'three lengths along x, y and z',
    'cylinder': 'diameter and height',
    'hull': 'rows of x, y and z of the corners of a convex solid',
}
EXPECTED = {
    'way': 'dropped (released at rest) or thrown (with spin and speed)',
    'parts': f'a list of 1 to {MAX_PARTS} parts',
    'conditions': 'a mapping of conditions to values, or to ranges of those that are fitted',
    'count': 'a class such as 2 or 3+4, aspect_5, x, y or z of a box, end or side of a cylinder, '
    f'{REST} or {IGNORED}',
}


@dataclass(frozen=True, eq=False)
class CountedPart:
    """A part with its counts.

    aspects : AspectSet
    groups : tuple of tuples of int
        Ids of the aspects that were counted together; each aspect is in one group.
    names : tuple of str
        Names of the groups, as they were given.
    counts : (g,) int
    values : dict of str to float
        Conditions that differ from those of the other parts, such as the height.
    """

    name: str
    part: Part
    aspects: AspectSet
    groups: tuple[tuple[int, ...], ...]
    names: tuple[str, ...]
    counts: Counts
    values: Mapping[str, float]

    @property
    def drops(self) -> int:
        """Number of drops that were counted in a group."""
        return int(self.counts.sum())

    @property
    def shares(self) -> Array:
        """Counted shares of the groups, (g,)."""
        return np.asarray(self.counts / self.drops)

    @property
    def shown(self) -> range:
        """Indices of the groups that are shown: of two groups, the share of one tells both."""
        return range(len(self.names) if len(self.names) > 2 else 1)

    def grouped(self, counts: Counts) -> Counts:
        """Return counts (m, k) by aspect as counts (m, g) by group."""
        columns = [[number - 1 for number in group] for group in self.groups]
        return np.stack([counts[:, ids].sum(axis=1) for ids in columns], axis=1)


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

    def conditions(self, points: Array, part: CountedPart) -> list[DropConditions]:
        """Return the conditions of a part at points (m, d) of the unit cube."""
        rows = point_values(self.factors, points)
        return [self.base.changed(**{**row, **part.values}) for row in rows]


class CountsFile(FileModel):
    """A counts file; its parts and conditions are checked by themselves."""

    surface: Any = 'calibrated'
    source: Any = ''
    way: Literal['dropped', 'thrown'] = 'dropped'
    conditions: dict[StrictStr, Any] | None = None
    parts: list[Any]


class CountedEntry(FileModel):
    """A part of a counts file, which is given in one of the ways in KINDS."""

    name: StrictStr = ''
    unit: StrictStr | None = None
    counts: dict[StrictInt | StrictStr, Count]
    drops: Count | None = None
    conditions: dict[StrictStr, Any] | None = None
    part: StrictStr | None = None
    mesh: StrictStr | None = None
    box: tuple[Positive, Positive, Positive] | None = None
    cylinder: tuple[Positive, Positive] | None = None
    hull: list[tuple[Number, Number, Number]] | None = None

    @property
    def kind(self) -> str:
        """The key in KINDS that is given; raises InvalidValueError unless it is exactly one."""
        given = [kind for kind in KINDS if getattr(self, kind) is not None]
        if len(given) != 1:
            raise InvalidValueError(
                f'invalid keys {shown(given)}: expected exactly one of {", ".join(KINDS)}'
            )
        return given[0]


def read_surface_counts(path: Path) -> SurfaceCounts:
    """Read a file; raises RestingAspectsError with one line that names the entry."""
    document = read_yaml(path, 'counts file', MAX_BYTES)
    return make_surface_counts(document, path.parent, named('counts file', path))


def make_surface_counts(document: Any, folder: Path, label: str = 'counts') -> SurfaceCounts:
    """Return the counts in a document with the keys of a counts file."""
    with located(label):
        given = validated(CountsFile, document, expected=EXPECTED)
        surface = check_name('a surface', given.surface)
        if not 1 <= len(given.parts) <= MAX_PARTS:
            raise InvalidValueError(
                f'invalid parts {shown(given.parts)}: expected {EXPECTED["parts"]}'
            )
        factors, base = _conditions(given.conditions, given.way)
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


def _conditions(
    given: Mapping[str, Any] | None, way: str
) -> tuple[tuple[Factor, ...], DropConditions]:
    """Return what is fitted and what is known; raises InvalidValueError."""
    with located('conditions'):
        both = {**WAYS[way], **(given or {})}
        ranges = {
            k: v
            for k, v in both.items()
            if isinstance(v, Mapping) or (isinstance(v, str) and ':' in v)
        }
        known = condition_values({k: v for k, v in both.items() if k not in ranges})
        # A factor needs unit and bounds only, which all conditions have.
        default = Setting(shipped_surfaces().get(DEFAULT_SURFACE))
        by_name = {k: read_factor(k, each, default) for k, each in ranges.items()}
        factors = tuple(by_name[name] for name in QUANTITIES if name in by_name)
        if not factors:
            raise InvalidValueError(
                'invalid conditions: all values are known: expected a range for one or more'
            )
        middles = {f.name: float(f.values(np.array([0.5]))[0]) for f in factors}
        return factors, DropConditions(**{**known, **middles})


def _part(
    given: Any, folder: Path, where: str, fitted: set[str], base: DropConditions
) -> CountedPart:
    """Return a part with its counts; raises RestingAspectsError."""
    with located(where):
        entry = validated(CountedEntry, given, expected={**EXPECTED, **KINDS})
        name = one_line(entry.name, 60)
    where = f'{where}, {name}' if name else where
    with located(where):
        part = make_solid(entry, folder)
        aspects = find_aspects(part)
        groups, names, counts = read_groups(entry.counts, entry.drops, entry.kind, aspects)
        with located('conditions'):
            values = condition_values(entry.conditions or {})
            base.changed(**values)  # checks the values
        if both := sorted(fitted & set(values)):
            raise InvalidValueError(
                f'invalid {both[0]}: it is fitted for all parts: expected it in the conditions of '
                'all parts, too, or not stated here'
            )
    if counts.max() == counts.sum():
        warn(
            f'{where}: all {counts.sum()} drops are in {names[int(counts.argmax())]!r}: they '
            'tell little about the surface'
        )
    return CountedPart(name or part.name, part, aspects, groups, names, counts, values)


def make_solid(entry: CountedEntry, folder: Path) -> Part:
    """Return the part of an entry; raises RestingAspectsError."""
    kind, unit = entry.kind, entry.unit
    if entry.part is not None:
        return load_part(entry.part, unit)
    if entry.mesh is not None:
        return load_part(folder / entry.mesh, unit)
    import trimesh  # takes a second

    if entry.box is not None:
        mesh = trimesh.creation.box(entry.box)
    elif entry.cylinder is not None:
        mesh = trimesh.creation.cylinder(entry.cylinder[0] / 2, entry.cylinder[1], SECTIONS)
    else:
        mesh = trimesh.convex.convex_hull(_spanning(entry.hull or []))
    data = mesh.export(file_type='stl')
    assert isinstance(data, bytes)
    name = valid_name(entry.name or kind)
    return part_from_bytes(data, 'stl', name, unit=DEFAULT_UNIT if unit is None else unit)


def _spanning(points: list[tuple[float, float, float]]) -> Array:
    """Return points (n, 3) that span a solid; raises RestingAspectsError."""
    if not 4 <= len(points) <= MAX_CORNERS:
        raise InvalidValueError(
            f'invalid hull of {len(points)} points: expected 4 to {MAX_CORNERS} {KINDS["hull"]}'
        )
    found = np.array(points, dtype=np.float64)
    if np.linalg.matrix_rank(found - found.mean(axis=0)) < 3:
        raise PartError('invalid hull: expected points that span a solid')
    return found


def read_groups(
    given: Mapping[int | str, int], drops: int | None, kind: str, aspects: AspectSet
) -> tuple[tuple[tuple[int, ...], ...], tuple[str, ...], Counts]:
    """Return groups of aspects, their names and their counts from a mapping of names to counts.

    ``drops`` is the stated sum, or None. Raises InvalidValueError if names are unknown or count
    an aspect twice, if aspects are missing, or if the counts do not add up to the stated sum.
    """
    numbers = {str(name).strip().lower(): count for name, count in given.items()}
    if len(numbers) < len(given):
        raise InvalidValueError(f'invalid counts {shown(given)}: expected each name once')
    ignored, rest = numbers.pop(IGNORED, 0), numbers.pop(REST, None)
    groups = _named_groups(numbers, kind, aspects)
    left = {a.id for a in aspects} - {number for ids in groups.values() for number in ids}
    if rest is None and drops is not None:
        rest = max(0, drops - ignored - sum(numbers.values()))
    if left and rest is None:
        raise InvalidValueError(
            f'invalid counts: aspects {shown(sorted(left))} are missing: expected a count of each '
            f'(0 if it was never seen), or {REST}, or drops, the number of all drops'
        )
    if rest and not left:
        raise InvalidValueError(
            f'invalid {REST} {rest}: expected 0, because all aspects are counted'
        )
    if left:
        groups[REST], numbers[REST] = tuple(sorted(left)), rest or 0
    counts = np.array([numbers[name] for name in groups], dtype=np.int64)
    if drops not in (None, ignored + counts.sum()):
        raise InvalidValueError(
            f'invalid drops {drops}: expected the sum of the counts, {ignored + counts.sum()}'
        )
    if len(groups) < 2:
        raise InvalidValueError(
            'invalid counts: all aspects are in one group, which says nothing about '
            'the surface: expected two or more'
        )
    if not 1 <= counts.sum() <= MAX_COUNTED:
        raise InvalidValueError(
            f'invalid number of drops {counts.sum()}: expected 1 to {MAX_COUNTED}'
        )
    return tuple(groups.values()), tuple(groups), counts


def _named_groups(
    names: Iterable[str], kind: str, aspects: AspectSet
) -> dict[str, tuple[int, ...]]:
    """Return the ids of the aspects of each name; raises InvalidValueError if two overlap."""
    groups: dict[str, tuple[int, ...]] = {}
    for name in names:
        ids = _ids(name, kind, aspects)
        if twice := {number for other in groups.values() for number in other} & set(ids):
            raise InvalidValueError(
                f'invalid counts: {shown(name)} counts aspect {min(twice)} again: '
                'expected each aspect once'
            )
        groups[name] = ids
    return groups


def _ids(name: str, kind: str, aspects: AspectSet) -> tuple[int, ...]:
    """Return the ids of the aspects that a name stands for; raises InvalidValueError.

    Of a box, x, y or z are the two sides across that axis; of a cylinder, ``end`` and ``side``.
    """
    axes = {'box': {'x': 0, 'y': 1, 'z': 2}, 'cylinder': {'end': 2, 'side': 2}}.get(kind, {})
    group, (prefix, _, digits) = parse_group(name), name.partition('_')
    if name in axes:
        along = np.array([abs(a.down_in_part[axes[name]]) for a in aspects])
        inside = (along > np.cos(AXIS_ANGLE)) != (name == 'side')
        return tuple(a.id for a, chosen in zip(aspects, inside, strict=True) if chosen)
    if group is not None:
        known, text = {a.symmetry_class for a in aspects}, 'classes'
        found = tuple(a.id for a in aspects if a.symmetry_class in group)
    elif prefix == 'aspect' and digits.isascii() and digits.isdecimal():
        known, text = {a.id for a in aspects}, 'aspects'
        group = found = (int(digits),) if len(digits) < 10 else (0,)
    else:
        raise InvalidValueError(
            f'invalid name {shown(name)} of a count: expected {EXPECTED["count"]}'
        )
    if not set(group) <= known:
        raise InvalidValueError(
            f'invalid name {shown(name)} of a count: the part has {text} 1 to {max(known)}; see '
            'resting_aspects aspects'
        )
    return found
