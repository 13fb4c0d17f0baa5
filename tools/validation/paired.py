"""Drops or actions from the same states, simulated twice, and the shifts of the shares of ends.

Many parts end in the same aspect in both simulations. The error of a shift therefore follows from
the parts that end differently, and is smaller than that of two independent samples.
"""

import dataclasses
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.simulation.conditions import BULLET, KERNEL
from resting_aspects_ros.simulation.job import DropJob, make_job
from resting_aspects_ros.simulation.starts import Action, rest_starts
from resting_aspects_ros.statistics.distribution import aspect_ids
from resting_aspects_ros.statistics.poses import RestingPoses, RestStatus
from validation.dropper import SEED, Dropper

Counts = npt.NDArray[np.int64]
Array = npt.NDArray[np.float64]

# Factor by which the numerical parameters are finer in the second simulation. The kernel's are
# its time steps, distances and rotations; Bullet, which simulates steps, has only time steps.
REFINEMENT = {KERNEL: 4, BULLET: 2}
# Ends of drops that are in no aspect: the last columns of all counts.
OUTSIDE = ('unclassified', 'unsettled', 'failed', 'lost', 'sliding')
_STATUS = (RestStatus.UNSETTLED, RestStatus.FAILED, RestStatus.LOST, RestStatus.SLIDING)
# Quantiles of the normal distribution that 95 % of it are below, and between -q and q.
ONE_SIDED, TWO_SIDED = 1.645, 1.96


@dataclass(frozen=True, eq=False)
class Shifts:
    """Changes of the probabilities of a matrix: second minus first simulation.

    shift, error : (r, m) float
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
        return divmod(int(np.abs(self.shift).argmax()), self.shift.shape[1])

    @property
    def bound(self) -> float:
        """Upper bound of all true changes, with a confidence of 95 %.

        To state that no entry changes by more than this, each entry must show it by itself, so
        the confidence needs no correction for their number (Berger 1982, Technometrics 24:295).
        """
        return float((np.abs(self.shift) + ONE_SIDED * self.error).max())


def class_indices(aspects: AspectSet) -> Counts:
    """Return the index of the symmetry class of each aspect, from 0."""
    return np.array([aspect.symmetry_class - 1 for aspect in aspects])


def ends(dropper: Dropper, job: DropJob, aspects: AspectSet, labels: Counts, n: int) -> Counts:
    """Return the column (n,) in which each drop ended: the label of its aspect, or OUTSIDE.

    ``labels`` (k,) are those of the aspects: numbers from 0, of which several can be the same.
    """
    poses = RestingPoses.join(list(dropper.poses(job, n)))
    outside = int(labels.max()) + 1
    found = np.append(outside, labels)[aspect_ids(aspects, poses)]  # the id 0 is unclassified
    for k, status in enumerate(_STATUS, start=outside + 1):
        found[poses.status == status] = k
    return np.asarray(found)


def paired_counts(
    dropper: Dropper,
    job: DropJob,
    aspects: AspectSet,
    labels: Counts,
    n: int,
    rows: Counts | None = None,
) -> Counts:
    """Return counts (r, m, m) of n drops by row, and by column as they are and when refined.

    The m columns are the labels and OUTSIDE. ``rows`` (n,) are those of the drops; None: all are
    in one row.
    """
    rows = np.zeros(n, dtype=np.int64) if rows is None else rows
    refined = dataclasses.replace(job, refinement=REFINEMENT[job.engine])
    columns = (ends(dropper, each, aspects, labels, n) for each in (job, refined))
    m = int(labels.max()) + 1 + len(OUTSIDE)
    counts = np.zeros((int(rows.max()) + 1, m, m), dtype=np.int64)
    np.add.at(counts, (rows, *columns), 1)
    return counts


def action_job(
    dropper: Dropper, part: Part, action: Action, per_class: int
) -> tuple[DropJob, Counts]:
    """Return the job of an action, and the class (n,) from which each of n actions starts.

    With at least ``per_class`` actions from each symmetry class.
    """
    conditions, aspects = dropper.surfaces.get(), find_aspects(part)
    starts = rest_starts(part, aspects, action, conditions)
    fewest = min(len(members) for members in aspects.classes())
    n = len(aspects) * -(-per_class // fewest)
    before = class_indices(aspects)[np.arange(n) % len(aspects)]
    return make_job(part, conditions, SEED, starts=starts), before


def shifts(counts: Counts) -> Shifts:
    """Return the shifts that follow from joint counts (r, m, m).

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
