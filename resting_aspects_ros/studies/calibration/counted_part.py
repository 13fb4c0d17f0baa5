"""Counts of a part over groups of its aspects, with what is known of its release."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.api.inputs.class_groups import parse_group
from resting_aspects_ros.core.aspects.aspect_set import AspectSet
from resting_aspects_ros.core.errors import InvalidValueError, shown
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.schema import MAX_COUNTED
from resting_aspects_ros.studies.calibration.solids import side_ids

Counts = npt.NDArray[np.int64]

REST = 'rest'
# Drops in no aspect: they are not compared with the simulation.
IGNORED = 'unclassified'
_EXPECTED = (
    'a class such as 2 or 3+4, aspect_5, x, y or z of a box, end or side of a cylinder, '
    f'{REST} or {IGNORED}'
)


@dataclass(frozen=True, eq=False)
class CountedPart:
    """A part with its counts.

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
    def shares(self) -> npt.NDArray[np.float64]:
        """Counted shares of the groups, (g,)."""
        return np.asarray(self.counts / self.drops)

    def grouped(self, counts: Counts) -> Counts:
        """Return counts (m, k) by aspect as counts (m, g) by group."""
        columns = [[number - 1 for number in group] for group in self.groups]
        return np.stack([counts[:, ids].sum(axis=1) for ids in columns], axis=1)


def read_groups(
    given: Any, drops: Any, kind: str, aspects: AspectSet
) -> tuple[tuple[tuple[int, ...], ...], tuple[str, ...], Counts]:
    """Return groups of aspects, their names and their counts from a mapping of names to counts.

    ``drops`` is the stated sum, or None. Raises InvalidValueError if names are unknown or count
    an aspect twice, if aspects are missing, or if the counts do not add up to the stated sum.
    """
    if not isinstance(given, Mapping) or not given:
        raise InvalidValueError(f'invalid counts {shown(given)}: expected a mapping')
    numbers = {_name(k): _count(each, k) for k, each in given.items()}
    if len(numbers) < len(given):
        raise InvalidValueError(f'invalid counts {shown(given)}: expected each name once')
    total = None if drops is None else _count(drops, 'drops')
    ignored, rest = numbers.pop(IGNORED, 0), numbers.pop(REST, None)
    groups = _named_groups(numbers, kind, aspects)
    left = {a.id for a in aspects.aspects} - {k for ids in groups.values() for k in ids}
    rest = _rest(rest, total, sum(numbers.values()) + ignored, left)
    if left:
        groups[REST], numbers[REST] = tuple(sorted(left)), rest
    if len(groups) < 2:
        raise InvalidValueError(
            'invalid counts: all aspects are in one group, which says nothing about '
            'the surface: expected two or more'
        )
    counts = np.array([numbers[name] for name in groups], dtype=np.int64)
    if not 1 <= counts.sum() <= MAX_COUNTED:
        raise InvalidValueError(
            f'invalid number of drops {counts.sum()}: expected 1 to {MAX_COUNTED}'
        )
    return tuple(groups.values()), tuple(groups), counts


def _named_groups(
    numbers: Mapping[str, int], kind: str, aspects: AspectSet
) -> dict[str, tuple[int, ...]]:
    """Return the ids of the aspects of each name; raises InvalidValueError if two overlap."""
    groups: dict[str, tuple[int, ...]] = {}
    for name in numbers:
        ids = _ids(name, kind, aspects)
        if twice := {k for other in groups.values() for k in other} & set(ids):
            raise InvalidValueError(
                f'invalid counts: {shown(name)} counts aspect {min(twice)} again: '
                'expected each aspect once'
            )
        groups[name] = ids
    return groups


def _rest(rest: int | None, total: int | None, counted: int, left: set[int]) -> int:
    """Return the count of the aspects that are left; raises InvalidValueError."""
    if rest is None and total is not None and left:
        rest = total - counted
    known = max(rest or 0, 0)
    if (rest or 0) < 0 or (total is not None and counted + known != total):
        raise InvalidValueError(
            f'invalid drops {total}: expected the sum of the counts, {counted + known}'
        )
    if rest is None and left:
        raise InvalidValueError(
            f'invalid counts: aspects {_listed(left)} are missing: expected a count of '
            f'each (0 if it was never seen), or {REST}, or drops, the number of all drops'
        )
    if rest and not left:
        raise InvalidValueError(
            f'invalid {REST} {rest}: expected 0, because all aspects are counted'
        )
    return known


def _ids(name: str, kind: str, aspects: AspectSet) -> tuple[int, ...]:
    """Return the ids of the aspects that a name stands for; raises InvalidValueError."""
    if sides := side_ids(kind, name, aspects):
        return sides
    prefix, _, digits = name.partition('_')
    if prefix == 'aspect' and digits.isascii() and digits.isdecimal():
        found = [a.id for a in aspects.aspects if str(a.id) == digits.lstrip('0')]
        known = f'aspects 1 to {len(aspects)}'
    else:
        group = parse_group(name)
        classes = {a.symmetry_class for a in aspects.aspects}
        if group is None:
            raise InvalidValueError(f'invalid name {shown(name)} of a count: expected {_EXPECTED}')
        inside = set(group) <= classes
        found = [a.id for a in aspects.aspects if inside and a.symmetry_class in group]
        known = f'classes 1 to {max(classes)}'
    if not found:
        raise InvalidValueError(
            f'invalid name {shown(name)} of a count: the part has {known}; see '
            'resting_aspects aspects'
        )
    return tuple(found)


def _count(value: Any, name: object) -> int:
    if type(value) is not int or not 0 <= value <= MAX_COUNTED:
        raise InvalidValueError(
            f'invalid count {shown(value)} of {shown(name)}: expected an integer from 0 '
            f'to {MAX_COUNTED}'
        )
    return value


def _name(key: Any) -> str:
    return (key if isinstance(key, str) else shown(key)).strip().lower()


def _listed(ids: set[int]) -> str:
    some = sorted(ids)
    return ', '.join(map(str, some[:10])) + (' and more' if len(some) > 10 else '')
