"""Counts of drops over aspects, from a file or a result."""

import dataclasses
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.api.inputs.class_groups import group_name, single_groups
from resting_aspects_ros.api.surroundings import conditions_text
from resting_aspects_ros.core.aspects.aspect_set import AspectSet
from resting_aspects_ros.core.errors import InvalidValueError, one_line, shown
from resting_aspects_ros.core.schema import MAX_COUNTED
from resting_aspects_ros.core.statistics.comparison import DropCounts
from resting_aspects_ros.core.statistics.counted_parts import Groups, group_places
from resting_aspects_ros.core.statistics.distribution import Distribution
from resting_aspects_ros.simulation.run_description import RunDescription


@dataclass(frozen=True, eq=False)
class CountedDrops:
    """Counts of drops over aspects, with the description of the run if it is known.

    source : str
        The file, or another name of the drops for messages.
    ids : tuple of int
        Ids of the k aspects of ``tally``, ascending; numbers of symmetry classes with
        ``by_class``.
    down : (k, 3) float
        Unit vectors of gravity, part frame; NaN where the part rolls. None if not known.
    part, part_sha256 : str
        Empty if not known.
    run : RunDescription
        None if not known.
    classes : tuple of int
        The symmetry class of each aspect; None if not known.
    complete : bool
        False if more drops were requested than are counted.
    by_class : bool
        Whether the drops are counted by symmetry class.
    groups : tuple of tuples of int
        With ``by_class``, the classes that were counted together, in the order of ``ids``, each of
        which is the first class of its group. Empty if each class was counted alone.
    """

    source: str
    ids: tuple[int, ...]
    tally: DropCounts
    down: npt.NDArray[np.float64] | None = None
    part: str = ''
    part_sha256: str = ''
    run: RunDescription | None = None
    complete: bool = True
    classes: tuple[int, ...] | None = None
    by_class: bool = False
    groups: Groups = ()

    @property
    def all_groups(self) -> Groups:
        """The groups of ``ids``, including those of a single class."""
        return self.groups or single_groups(self.ids)

    @property
    def members(self) -> tuple[int, ...]:
        """The ids of all aspects or classes, also of those that were counted together."""
        return tuple(sorted(number for group in self.all_groups for number in group))

    @property
    def names(self) -> tuple[str, ...]:
        """The names of ``ids``, such as '3+4' for classes that were counted together."""
        return tuple(map(group_name, self.all_groups))

    @property
    def drops(self) -> int:
        """Return the number of all counted drops."""
        return self.tally.drops

    @property
    def title(self) -> str:
        """Return file, part, drops, surface and seed, as far as they are known."""
        words = [one_line(self.source), *([self.part] if self.part else [])]
        if self.run is None:
            return ', '.join([*words, f'{self.drops} drops'])
        where = conditions_text(self.run.conditions)
        return ', '.join([*words, f'{self.drops} drops on {where}', f'seed {self.run.seed}'])


def counts_of_run(
    source: str, distribution: Distribution, run: RunDescription, *, complete: bool
) -> CountedDrops:
    """Return the counts of a run; ``complete``: all drops that were requested are counted."""
    aspects = distribution.aspects.aspects
    return CountedDrops(
        source,
        tuple(aspect.id for aspect in aspects),
        DropCounts(
            distribution.counts,
            distribution.unclassified,
            distribution.unsettled + distribution.lost + distribution.sliding,
            distribution.failed,
        ),
        np.array([np.full(3, np.nan) if a.rolls else a.down_in_part for a in aspects]),
        run.part,
        run.part_sha256,
        run,
        complete,
        tuple(aspect.symmetry_class for aspect in aspects),
    )


def counted_by_class(given: CountedDrops) -> CountedDrops:
    """Return the same drops counted by symmetry class, with the direction of its first aspect.

    Raises InvalidValueError if the symmetry classes are not known.
    """
    if given.by_class:
        return given
    if given.classes is None:
        raise InvalidValueError(
            f'{given.source!r} counts by aspect and has no symmetry classes: expected a log, a '
            'JSON document, or a CSV with the column class'
        )
    numbers, first, which = np.unique(given.classes, return_index=True, return_inverse=True)
    of_class = np.bincount(which, weights=given.tally.counts).astype(np.int64)
    return dataclasses.replace(
        given,
        ids=tuple(numbers.tolist()),
        tally=dataclasses.replace(given.tally, counts=of_class),
        down=None if given.down is None else given.down[first],
        classes=None,
        by_class=True,
    )


def grouped(given: CountedDrops, into: Groups) -> CountedDrops:
    """Return drops by class with more classes counted together.

    into : tuple of tuples of int
        All groups; each group of ``given`` is in one of them.
    """
    if into == given.all_groups:
        return given
    counts = np.zeros(len(into), dtype=np.int64)
    np.add.at(counts, group_places(given.all_groups, into), given.tally.counts)
    return dataclasses.replace(
        given,
        ids=tuple(group[0] for group in into),
        tally=dataclasses.replace(given.tally, counts=counts),
        # The aspects of several classes have no common direction.
        down=None,
        groups=into,
    )


def check_counts(given: CountedDrops) -> None:
    """Raise InvalidValueError if no drop is in an aspect, or if there are too many drops."""
    if not given.tally.counts.any():
        raise InvalidValueError(
            f'invalid counts in {given.source!r}: expected at least one drop in an aspect, found '
            f'0 of {given.drops} drops'
        )
    if given.drops > MAX_COUNTED:
        raise InvalidValueError(
            f'invalid number of drops {given.drops} in {given.source!r}: expected at most '
            f'{MAX_COUNTED}'
        )


def check_same_part(one: tuple[str, str, str], other: tuple[str, str, str]) -> None:
    """Raise InvalidValueError if two results are known to be of different parts.

    Parameters
    ----------
    one, other : (str, str, str)
        The result as messages name it, the name of its part, and its part_sha256; the latter two
        are empty if they are not known.
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
    if given.by_class:
        what, many = 'a class', 'classes'
        ids = tuple(sorted({aspect.symmetry_class for aspect in aspects.aspects}))
    else:
        what, many = 'an aspect', 'aspects'
        ids = tuple(aspect.id for aspect in aspects.aspects)
    if given.ids != ids or given.groups:
        raise InvalidValueError(
            f'invalid {many} [{", ".join(given.names)}] in --against {path!r}: expected those of '
            f'{part}, {list(ids)} ({what} that was never seen has count 0)'
        )


def counted_by_class_of(given: CountedDrops, aspects: AspectSet) -> DropCounts:
    """Return the drops by symmetry class; for counts that check_against has accepted."""
    if given.by_class:
        return given.tally
    classes = [aspect.symmetry_class for aspect in aspects.aspects]
    counts = np.bincount(classes, weights=given.tally.counts)[1:].astype(np.int64)
    return dataclasses.replace(given.tally, counts=counts)
