"""Counts of newly supplied parts in the order in which they were counted."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.api.inputs.counts import MAX_COUNTED
from resting_aspects_ros.core.errors import InvalidValueError, shown
from resting_aspects_ros.core.statistics.intervals import Counts


@dataclass(frozen=True, eq=False)
class ObservedCounts:
    """Counts of parts in batches; a batch is the smallest set of parts whose order is unknown.

    source : str
        The file, or another name of the counts for messages.
    batch, place, count : (m,) int
        Index of the batch, not descending, index of the class, both from 0, and the number of
        parts.
    labels : tuple of str
        Text of the column batch or time of each batch; empty without this column.
    """

    source: str
    batch: Counts
    place: Counts
    count: Counts
    labels: tuple[str, ...] = ()

    @property
    def parts(self) -> int:
        """Number of counted parts."""
        return int(self.count.sum())

    def totals(self, classes: int) -> Counts:
        """Return all parts by class, (c,)."""
        totals = np.zeros(classes, dtype=np.int64)
        np.add.at(totals, self.place, self.count)
        return totals

    def windows(self, size: int, classes: int) -> tuple[Counts, Counts, list[str]]:
        """Return disjoint windows of at least ``size`` parts, each of whole batches.

        Returns
        -------
        counts : (w, c) int
            Parts of each window by class. Parts at the end that do not fill a window are in none.
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
        windows = np.zeros((len(edges), classes), dtype=np.int64)
        window = np.searchsorted(edges, self.batch, side='right') - 1
        np.add.at(windows, (window, self.place), self.count)
        labels = [self.labels[k] for k in edges[:-1]] if self.labels else []
        return windows[:-1], before[edges], labels


def counts_from_array(counts: npt.ArrayLike, classes: int) -> ObservedCounts:
    """Return the counts of an array (b, c): a row for each batch, a column for each class.

    Raises InvalidValueError unless these are integers from 0 to MAX_COUNTED.
    """
    try:
        given = np.asarray(counts)
        with np.errstate(invalid='ignore'):  # the conversion of nan
            rows = given.astype(np.int64)
        fits = bool((rows == given).all() and (rows >= 0).all() and (rows <= MAX_COUNTED).all())
    except (TypeError, ValueError, OverflowError):
        fits, rows = False, np.zeros((0, 0), dtype=np.int64)
    if not fits or rows.ndim != 2 or rows.shape[1] != classes:
        raise InvalidValueError(
            f'invalid counts {shown(counts)}: expected rows of {classes} integers from 0 to '
            f'{MAX_COUNTED}, one for each class'
        )
    batch, place = np.indices(rows.shape).reshape(2, -1)
    observed = ObservedCounts('counts', batch, place, rows.ravel())
    check_parts(observed)
    return observed


def check_parts(counts: ObservedCounts) -> None:
    """Raise InvalidValueError if no part was counted, or too many."""
    if not 1 <= counts.parts <= MAX_COUNTED:
        raise InvalidValueError(
            f'invalid number of counted parts {counts.parts} in {counts.source!r}: expected 1 to '
            f'{MAX_COUNTED}'
        )
