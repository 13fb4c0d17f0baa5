"""Counts of newly supplied parts in the order in which they were counted."""

import dataclasses
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.api.inputs.class_groups import Groups, group_places
from resting_aspects_ros.core.errors import InvalidValueError, shown
from resting_aspects_ros.core.schema import MAX_COUNTED
from resting_aspects_ros.core.statistics.intervals import Counts


@dataclass(frozen=True, eq=False)
class ObservedCounts:
    """Counts of parts in batches; a batch is the smallest set of parts whose order is unknown.

    source : str
        The file, or another name of the counts for messages.
    groups : tuple of tuples of int
        The c groups of symmetry classes that were counted together; most have one class.
    batch, place, count : (m,) int
        Index of the batch, not descending, index of the group, both from 0, and the number of
        parts.
    labels : tuple of str
        Text of the column batch or time of each batch; empty without this column.
    unclassified : int
        Number of further parts that were counted in no class.
    """

    source: str
    groups: Groups
    batch: Counts
    place: Counts
    count: Counts
    labels: tuple[str, ...] = ()
    unclassified: int = 0

    @property
    def parts(self) -> int:
        """Number of parts that were counted in a class."""
        return int(self.count.sum())

    @property
    def totals(self) -> Counts:
        """All parts by group, (c,)."""
        totals = np.zeros(len(self.groups), dtype=np.int64)
        np.add.at(totals, self.place, self.count)
        return totals

    def grouped(self, into: Groups) -> 'ObservedCounts':
        """Return the counts with larger groups, each of which contains whole groups."""
        place = np.array(group_places(self.groups, into), dtype=np.int64)[self.place]
        return dataclasses.replace(self, groups=into, place=place)

    def windows(self, size: int) -> tuple[Counts, Counts, list[str]]:
        """Return disjoint windows of at least ``size`` parts, each of whole batches.

        Returns
        -------
        counts : (w, c) int
            Parts of each window by group. Parts at the end that do not fill a window are in none.
        ends : (w + 1,) int
            Number of parts before the first window, 0, and up to the end of each window.
        labels : list of str
            Label of the first batch of each window; empty without labels.
        """
        before = np.concatenate([[0], np.cumsum(np.bincount(self.batch, self.count))])
        before = before.astype(np.int64)
        edges = [0]
        while (end := int(np.searchsorted(before, before[edges[-1]] + size))) < len(before):
            edges.append(end)
        windows = np.zeros((len(edges), len(self.groups)), dtype=np.int64)
        window = np.searchsorted(edges, self.batch, side='right') - 1
        np.add.at(windows, (window, self.place), self.count)
        labels = [self.labels[k] for k in edges[:-1]] if self.labels else []
        return windows[:-1], before[edges], labels


def counts_from_array(counts: npt.ArrayLike, groups: Groups) -> ObservedCounts:
    """Return the counts of an array (b, c): a row for each batch, a column for each group.

    Raises InvalidValueError unless these are integers from 0 to MAX_COUNTED.
    """
    try:
        given = np.asarray(counts)
        with np.errstate(invalid='ignore'):  # the conversion of nan
            rows = given.astype(np.int64)
        fits = bool((rows == given).all() and (rows >= 0).all() and (rows <= MAX_COUNTED).all())
    except (TypeError, ValueError, OverflowError):
        fits, rows = False, np.zeros((0, 0), dtype=np.int64)
    if not fits or rows.ndim != 2 or rows.shape[1] != len(groups):
        raise InvalidValueError(
            f'invalid counts {shown(counts)}: expected rows of {len(groups)} integers from 0 to '
            f'{MAX_COUNTED}, one for each class'
        )
    batch, place = np.indices(rows.shape).reshape(2, -1)
    observed = ObservedCounts('counts', groups, batch, place, rows.ravel())
    check_parts(observed)
    return observed


def check_parts(counts: ObservedCounts) -> None:
    """Raise InvalidValueError if no part was counted, or too many."""
    if not 1 <= counts.parts <= MAX_COUNTED:
        raise InvalidValueError(
            f'invalid number of counted parts {counts.parts} in {counts.source!r}: expected 1 to '
            f'{MAX_COUNTED}'
        )
