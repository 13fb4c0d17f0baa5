"""Counts of drops over aspects, or over groups of classes that a camera confuses."""

import dataclasses
import re
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from resting_aspects_ros.api.conditions import conditions_text
from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.errors import InvalidValueError, one_line, shown
from resting_aspects_ros.input_files import MAX_COUNTED
from resting_aspects_ros.simulation.job import RunDescription
from resting_aspects_ros.statistics.comparison import DropCounts
from resting_aspects_ros.statistics.counted_parts import Groups, group_places
from resting_aspects_ros.statistics.distribution import Distribution
from resting_aspects_ros.statistics.model_range import ModelRange

_NUMBER = r'(?:class(?:es)?[_ ]?)?0*[1-9]\d{0,8}'
_GROUP = re.compile(rf'{_NUMBER}(?:\s*\+\s*{_NUMBER})*', re.IGNORECASE)


def parse_group(text: str) -> tuple[int, ...] | None:
    """Return the classes of '3', 'class_3' or '3+4', ascending; None for any other text.

    A text that names a class twice is not a group either.
    """
    if not _GROUP.fullmatch(text.strip()):
        return None
    numbers = sorted(int(digits) for digits in re.findall(r'\d+', text))
    return tuple(numbers) if len(set(numbers)) == len(numbers) else None


def single_groups(ids: Iterable[int]) -> Groups:
    """Return groups of one class each."""
    return tuple((number,) for number in ids)


def common_groups(one: Groups, other: Groups) -> Groups:
    """Return the smallest groups that contain each group of both, in ascending order."""
    found: list[set[int]] = []
    for group in (*one, *other):
        touched = [each for each in found if not each.isdisjoint(group)]
        found = [each for each in found if each.isdisjoint(group)]
        found.append(set(group).union(*touched))
    return tuple(sorted(tuple(sorted(each)) for each in found))


# -- Counts ---------------------------------------------------------------------------------------


# Maximum size of a file of counts.
MAX_BYTES = 1 << 26


@dataclass(frozen=True, eq=False)
class CountedDrops:
    """Counts of drops over aspects, with the description of the run if it is known.

    source
        The file, or another name of the drops for messages.
    groups
        The k groups of ``tally``, ascending: each has the id of an aspect, or with ``by_class``
        the numbers of the symmetry classes that were counted together.
    complete
        False if more drops were requested than are counted.
    classes
        The symmetry class of each aspect.
    model
        The model ranges of the groups.

    What is not known is None, such as all of these of parts that were counted by hand.
    """

    source: str
    groups: Groups
    tally: DropCounts
    by_class: bool = False
    run: RunDescription | None = None
    complete: bool = True
    classes: tuple[int, ...] | None = None
    model: ModelRange | None = None

    @property
    def part(self) -> str:
        """The name of the part; empty if it is not known."""
        return '' if self.run is None else self.run.part

    @property
    def part_sha256(self) -> str:
        """Empty if it is not known."""
        return '' if self.run is None else self.run.part_sha256

    @property
    def ids(self) -> tuple[int, ...]:
        """The first aspect or class of each group."""
        return tuple(group[0] for group in self.groups)

    @property
    def members(self) -> tuple[int, ...]:
        """The ids of all aspects or classes, including those that were counted together."""
        return tuple(sorted(number for group in self.groups for number in group))

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the groups, such as '3+4' for classes that were counted together."""
        return tuple('+'.join(map(str, group)) for group in self.groups)

    @property
    def drops(self) -> int:
        """Return the number of all counted drops."""
        return self.tally.drops

    @property
    def title(self) -> str:
        """Return file, part, drops, surface and seed, as far as they are known."""
        source, run = one_line(self.source), self.run
        if run is None:
            return f'{source}, {self.drops} drops'
        where = conditions_text(run.conditions)
        return f'{source}, {run.part}, {self.drops} drops on {where}, seed {run.seed}'

    def grouped(self, into: Groups) -> 'CountedDrops':
        """Return the drops with larger groups, each of which contains whole groups."""
        if into == self.groups:
            return self
        counts = np.zeros(len(into), dtype=np.int64)
        np.add.at(counts, group_places(self.groups, into), self.tally.counts)
        tally = dataclasses.replace(self.tally, counts=counts)
        # No model range is known of several classes together.
        return dataclasses.replace(self, groups=into, tally=tally, model=None)


def counts_of_run(
    source: str, distribution: Distribution, run: RunDescription, *, complete: bool
) -> CountedDrops:
    """Return the counts of a run; ``complete``: all drops that were requested are counted."""
    aspects = distribution.aspects
    return CountedDrops(
        source,
        single_groups(aspect.id for aspect in aspects),
        DropCounts(
            distribution.counts,
            distribution.unclassified,
            distribution.unsettled + distribution.lost + distribution.sliding,
            distribution.failed,
        ),
        run=run,
        complete=complete,
        classes=tuple(aspect.symmetry_class for aspect in aspects),
        model=distribution.model,
    )


def counted_by_class(given: CountedDrops, aspects: AspectSet | None = None) -> CountedDrops:
    """Return the same drops counted by symmetry class.

    The classes are those of ``aspects``, if these are given. Raises InvalidValueError if they are
    not known.
    """
    if given.by_class:
        return given
    classes = given.classes
    if aspects is not None:
        classes = tuple(aspect.symmetry_class for aspect in aspects)
    if classes is None:
        raise InvalidValueError(
            f'{given.source!r} counts by aspect and has no symmetry classes: expected a log, a '
            'JSON document, or a CSV with the column class'
        )
    numbers, which = np.unique(classes, return_inverse=True)
    of_class = np.bincount(which, weights=given.tally.counts).astype(np.int64)
    return dataclasses.replace(
        given,
        groups=single_groups(numbers.tolist()),
        tally=dataclasses.replace(given.tally, counts=of_class),
        by_class=True,
        classes=None,
        model=given.model and given.model.of_classes(),
    )


def check_counts(given: CountedDrops) -> None:
    """Raise InvalidValueError if no drop is in an aspect, or if there are too many drops."""
    if not given.tally.counts.any() or given.drops > MAX_COUNTED:
        raise InvalidValueError(
            f'invalid counts in {given.source!r}: expected at least one drop in an aspect, and at '
            f'most {MAX_COUNTED} drops; found {given.tally.counts.sum()} of {given.drops} drops'
        )


def check_same_part(one: tuple[str, str, str], other: tuple[str, str, str]) -> None:
    """Raise InvalidValueError if two results are known to be of different parts.

    Each is given as messages name it, with the name of its part and its part_sha256, which are
    empty if they are not known.
    """
    (result, name, digest), (second, other_name, other_digest) = one, other
    if not digest or not other_digest or digest == other_digest:
        return
    names = f'{result} is of {shown(name)}, {second} of {shown(other_name)}'
    if name == other_name:
        names += (
            ', but the mesh, the unit, the mass or the inertia differs '
            f'(part_sha256 {digest[:8]} and {other_digest[:8]})'
        )
    raise InvalidValueError(f'these are different parts: {names}')


def check_against(given: CountedDrops, part: str, part_sha256: str, aspects: AspectSet) -> None:
    """Raise InvalidValueError if the counts of --against have other aspects than a part."""
    path = given.source
    check_same_part(
        (f'--against {path!r}', given.part, given.part_sha256), ('the result', part, part_sha256)
    )
    ids = sorted({each.symmetry_class if given.by_class else each.id for each in aspects})
    if given.groups != single_groups(ids):
        many = 'classes' if given.by_class else 'aspects'
        raise InvalidValueError(
            f'invalid {many} [{", ".join(given.names)}] in --against {path!r}: expected those of '
            f'{part}, {ids} (what was never seen has count 0)'
        )
