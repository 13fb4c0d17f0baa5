"""Actions from the same states with two time steps, and the shift of each transition between them.

Coarse and fine steps lead many parts to the same aspect. The error of a shift therefore follows
from the parts that end differently, and is smaller than that of two independent samples.
"""

import dataclasses
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from dropper import SEED, Dropper

from resting_aspects_ros.core.aspects.aspect import find_aspects
from resting_aspects_ros.core.aspects.aspect_set import AspectSet
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.poses import RestingPoses, RestStatus
from resting_aspects_ros.core.reorientation.transition_matrix import OUTCOMES
from resting_aspects_ros.core.statistics.distribution import aspect_ids
from resting_aspects_ros.simulation.actions import Action
from resting_aspects_ros.simulation.drop_job import DropJob
from resting_aspects_ros.simulation.plan import make_job
from resting_aspects_ros.simulation.reorientation import action_starts

Counts = npt.NDArray[np.int64]
Array = npt.NDArray[np.float64]

# Quantile of the normal distribution that 95 % of it are below.
ONE_SIDED = 1.645
# Minimum number of parts that leave or reach a column, for the chi-square distribution to hold.
MIN_CHANGED = 10
_OUTCOME = {RestStatus.UNSETTLED: 1, RestStatus.FAILED: 2, RestStatus.LOST: 3}


@dataclass(frozen=True, eq=False)
class Shifts:
    """Changes of the probabilities of a matrix by symmetry class: fine minus coarse.

    shift, error : (c, c + 4) float
        Of each entry, and its standard error.
    different : float
        Share of the parts that end differently.
    """

    shift: Array
    error: Array
    different: float

    @property
    def largest(self) -> tuple[int, int]:
        """Row and column, from 0, of the entry that changes most."""
        row, column = divmod(int(np.abs(self.shift).argmax()), self.shift.shape[1])
        return row, column

    @property
    def bound(self) -> float:
        """Upper bound of all true changes, with a confidence of 95 %.

        To state that no entry changes by more than this, each entry must show it by itself, so
        the confidence needs no correction for their number (Berger 1982, Technometrics 24:295).
        """
        return float((np.abs(self.shift) + ONE_SIDED * self.error).max())


def joint_counts(dropper: Dropper, part: Part, action: Action, per_class: int) -> Counts:
    """Return counts (c, m, m) by class before, and by column with coarse and with fine steps.

    With at least ``per_class`` actions from each symmetry class. The m columns are the c classes
    and OUTCOMES.
    """
    conditions = dropper.surfaces.get()
    aspects = find_aspects(part)
    starts = action_starts(part, aspects.aspects, action, conditions.gravity)
    job = make_job(part, conditions, SEED, starts=starts)
    fewest = min(len(members) for members in aspects.classes())
    n = len(aspects) * -(-per_class // fewest)
    coarse = _columns(dropper, job, aspects, n)
    fine = _columns(dropper, dataclasses.replace(job, refinement=2), aspects, n)
    classes = len(aspects.classes())
    counts = np.zeros((classes, classes + len(OUTCOMES), classes + len(OUTCOMES)), dtype=np.int64)
    row = class_indices(aspects)[np.arange(n) % len(aspects)]
    np.add.at(counts, (row, coarse, fine), 1)
    return counts


def class_indices(aspects: AspectSet) -> Counts:
    """Return the index of the symmetry class of each aspect, from 0."""
    return np.array([aspect.symmetry_class - 1 for aspect in aspects.aspects])


def _columns(dropper: Dropper, job: DropJob, aspects: AspectSet, n: int) -> Counts:
    """Return the column of the matrix in which each of n actions ended."""
    return np.concatenate([_column(aspects, poses) for poses in dropper.poses(job, n)])


def _column(aspects: AspectSet, poses: RestingPoses) -> Counts:
    classes = len(aspects.classes())
    known = np.append(classes, class_indices(aspects))  # the id 0 is unclassified
    column = known[aspect_ids(aspects, poses)]
    for status, k in _OUTCOME.items():
        column[poses.status == status] = classes + k
    return column


def shifts(counts: Counts) -> Shifts:
    """Return the shifts that follow from joint counts (c, m, m).

    The standard errors are those of paired shares, with half a count added to each cell (Agresti
    and Min 2005, Statistics in Medicine 24:729), so that they are not 0 where no part differs.
    """
    n = counts.sum(axis=(1, 2))[:, None]
    same = np.diagonal(counts, axis1=1, axis2=2)
    gained, left = counts.sum(axis=1) - same, counts.sum(axis=2) - same
    size = n + 2
    difference = (gained - left) / size
    error = np.sqrt(((gained + left + 1) / size - difference**2) / size)
    different = 1 - same.sum() / counts.sum()
    return Shifts((gained - left) / n, error, float(different))


def homogeneity(counts: Counts) -> tuple[float, int]:
    """Return the statistic of Stuart and Maxwell of joint counts (m, m), and its degrees.

    If coarse and fine steps have the same probabilities, it has the chi-square distribution with
    these degrees of freedom. Columns that fewer than MIN_CHANGED parts leave or reach are joined
    with others.
    """
    changed = _changed(counts)
    while len(counts) > 1 and changed.min() < MIN_CHANGED:
        one, other = np.sort(np.argsort(changed, kind='stable')[:2])
        joined = np.delete(np.eye(len(counts), dtype=np.int64), other, axis=0)
        joined[one, other] = 1
        counts = joined @ counts @ joined.T
        changed = _changed(counts)
    # The last column follows from the others, because all shifts add up to 0.
    shift = (counts.sum(axis=0) - counts.sum(axis=1))[:-1]
    covariance = (np.diag(counts.sum(axis=0) + counts.sum(axis=1)) - counts - counts.T)[:-1, :-1]
    return float(shift @ np.linalg.solve(covariance, shift)), len(shift)


def _changed(counts: Counts) -> Counts:
    """Return how many parts leave or reach each column of joint counts (m, m), (m,)."""
    return np.asarray(counts.sum(axis=0) + counts.sum(axis=1) - 2 * np.diag(counts))
