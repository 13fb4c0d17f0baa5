"""Use the parts counted on a machine in a forecast, beside the simulation."""

import dataclasses

import numpy as np

from resting_aspects_ros.api.reorient_result import ReorientResult
from resting_aspects_ros.core.statistics.intervals import Array, Counts
from resting_aspects_ros.core.statistics.live_counts import LiveCounts


def with_live_counts(
    result: ReorientResult, live: LiveCounts, moved: Counts | None = None
) -> ReorientResult:
    """Return a result in which drops and transitions are combined with counted parts.

    The simulation has the weight of ``live.prior_weight`` parts, for the drops and for each row of
    the matrix with counted parts; the other rows remain as simulated. Counts are by symmetry
    class, so they are those of the first aspect of each class: only the result by class is
    meaningful.

    Parameters
    ----------
    result : ReorientResult
        Simulated, by aspect.
    live : LiveCounts
        Newly supplied parts by symmetry class.
    moved : (c, c) int, optional
        Parts that were followed through the action, from class to class.
    """
    by_class = result.by_class()
    first = [members[0].id - 1 for members in result.drop.aspects.classes()]
    count, aspects = len(first), len(result.drop.counts)
    drops = np.zeros(aspects, dtype=np.int64)
    drops[first] = _integers(live.concentration)
    rows = by_class.matrix.counts.copy()
    machine = np.zeros((count, count), dtype=np.int64) if moved is None else moved
    for k in np.flatnonzero(machine.sum(axis=1)):
        total = int(rows[k].sum())
        both = rows[k] / max(total, 1) * min(live.weight, total)
        both[:count] += machine[k]
        rows[k] = _integers(both)
    matrix = np.zeros_like(result.matrix.counts)
    matrix[np.ix_(first, first)] = rows[:, :count]
    matrix[first, aspects:] = rows[:, count:]
    return dataclasses.replace(
        result,
        drop=dataclasses.replace(result.drop, counts=drops),
        matrix=dataclasses.replace(result.matrix, counts=matrix),
    )


def _integers(values: Array) -> Counts:
    """Return integers whose partial sums are those of the values, rounded."""
    ends = np.rint(np.cumsum(values)).astype(np.int64)
    return np.asarray(ends - np.concatenate([[0], ends[:-1]]))
