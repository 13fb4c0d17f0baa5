"""Check whether the time step matters: repeat drops or actions with a finer one, and compare."""

import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from resting_aspects_ros.api.runner import DropTally, Runner, TransitionTally
from resting_aspects_ros.errors import warn
from resting_aspects_ros.simulation.job import MAX_DROPS, DropJob, RunDescription
from resting_aspects_ros.statistics.distribution import Distribution, no_drops
from resting_aspects_ros.statistics.intervals import SIMULTANEOUS, bounds
from resting_aspects_ros.statistics.transitions import TransitionMatrix, no_actions

# Number of time steps of the check for each time step of the run.
REFINEMENT = 2
# The change of a share that the check is meant to detect.
DETECTABLE_SHIFT = 0.01


@dataclass(frozen=True)
class Convergence:
    """Change of a distribution when its drops are repeated with a finer time step.

    time_step : float
        The finer time step, s.
    drops : int
        Number of drops with each time step.
    aspect : int
        Id of the aspect whose share changes most.
    shift : float
        Change of its share of the drops that are in an aspect: fine minus coarse.
    lower, upper : float
        Bounds of the true shift; those of all aspects hold together with ``confidence``.
    p_value : float
        Probability that chance alone changes the shares at least as much.
    enough : int
        Number of drops, rounded up to one digit, with which the widest of these bounds would
        detect DETECTABLE_SHIFT; 0 if a document of an earlier version does not have it.
    """

    time_step: float
    drops: int
    aspect: int
    shift: float
    lower: float
    upper: float
    confidence: float
    p_value: float
    enough: int = 0

    def text(self) -> str:
        """Return the change and a verdict, in lines of up to 80 columns."""
        enough = ''
        if not self.lower <= 0 <= self.upper:
            verdict = 'not explained by chance'
        elif self.upper - self.lower > 2 * DETECTABLE_SHIFT:
            verdict = f'too few drops to detect {100 * DETECTABLE_SHIFT:g} %'
            enough = self._enough_text()
        else:
            verdict = 'explained by chance'
        return (
            f'With 1/{REFINEMENT} of the time step ({self.time_step * 1e6:.3g} us), aspect '
            f'{self.aspect} changes most: {100 * self.shift:+.2g} points,\n'
            f'{verdict} ({100 * self.confidence:g} % interval {100 * self.lower:+.2g} to '
            f'{100 * self.upper:+.2g}, {self.drops} drops each).{enough}'
        )

    def _enough_text(self) -> str:
        if self.enough > MAX_DROPS:
            return f'\nMore than the maximum of {MAX_DROPS} drops are needed.'
        return f'\nAbout {self.enough} drops are needed.' if self.enough else ''


def check_convergence(
    coarse: Distribution, fine: Distribution, time_step: float, seed: int
) -> Convergence | None:
    """Compare the distribution of a run with that of the same drops with a finer time step.

    The intervals are those of independent drops. They are conservative here, because both sets
    start from the same states. Returns None if one of them has no drop in an aspect.
    """
    if not (coarse.counts.any() and fine.counts.any()):
        return None
    # This import is slow, and only needed for the check.
    from resting_aspects_ros.statistics.comparison import compare

    found = compare(fine, coarse, np.random.default_rng(seed), coarse.confidence)
    lower, upper = found.largest_bounds
    return Convergence(
        time_step=time_step,
        drops=fine.drops,
        aspect=found.largest_aspect,
        shift=found.largest_deviation,
        lower=lower,
        upper=upper,
        confidence=found.confidence,
        p_value=found.p_value,
        enough=_required_drops(fine.drops, float((found.upper - found.lower).max())),
    )


def _required_drops(drops: int, max_width: float) -> int:
    # The width of an interval is inversely proportional to the root of the number of drops.
    drops = math.ceil(drops * (max_width / (2 * DETECTABLE_SHIFT)) ** 2)
    step = 10 ** (len(str(drops)) - 1)
    return -(-drops // step) * step


def repeat_drops_in_finer_steps(
    runner: Runner, job: DropJob, run: RunDescription, coarse: Distribution
) -> Convergence | None:
    """Repeat the drops of a run with a finer time step, and compare the distributions.

    Returns None if it was stopped, or if the convergence could not be determined.
    """
    job = dataclasses.replace(job, refinement=REFINEMENT * job.refinement)
    run = dataclasses.replace(run, drops=coarse.drops, precision=0.0, time_step=job.time_step)
    fine = DropTally(no_drops(coarse.aspects, confidence=coarse.confidence), run.drops)
    if coarse.drops:
        runner.count(job, run, fine, label=f'{run.part} with a finer time step')
    if not fine.complete:
        return None
    found = check_convergence(coarse, fine.distribution, run.time_step, run.seed)
    if found is None:
        warn('convergence could not be determined: no drop came to rest in an aspect')
    return found


@dataclass(frozen=True)
class MatrixConvergence:
    """Change of a transition matrix by symmetry class with a finer time step.

    time_step : float
        The finer time step, s.
    actions : int
        Number of actions with each time step.
    row, column : int
        Entry that changes most, both from 0; a column after the classes is one of OUTCOMES.
    shift : float
        Change of its probability: fine minus coarse.
    lower, upper : float
        Bounds of the true shift; those of all entries hold together with ``confidence``.
    confidence : float
    """

    time_step: float
    actions: int
    row: int
    column: int
    shift: float
    lower: float
    upper: float
    confidence: float

    def text(self, columns: list[str]) -> str:
        """Return the change and a verdict; ``columns`` are the names of classes and outcomes."""
        if not self.lower <= 0 <= self.upper:
            verdict = 'not explained by chance'
        elif self.upper - self.lower > 2 * DETECTABLE_SHIFT:
            verdict = f'too few actions to detect {100 * DETECTABLE_SHIFT:g} %'
        else:
            verdict = 'explained by chance'
        return (
            f'With 1/{REFINEMENT} of the time step ({self.time_step * 1e6:.3g} us), the '
            f'probability from {columns[self.row]} to {columns[self.column]} changes most:\n'
            f'{100 * self.shift:+.2g} points, {verdict} ({100 * self.confidence:g} % interval '
            f'{100 * self.lower:+.2g} to {100 * self.upper:+.2g}).'
        )


def repeat_actions_in_finer_steps(
    runner: Runner, job: DropJob, run: RunDescription, coarse: TransitionTally, label: str
) -> MatrixConvergence | None:
    """Repeat the actions of a run with a finer time step; returns None if it was stopped."""
    job = dataclasses.replace(job, refinement=REFINEMENT * job.refinement)
    run = dataclasses.replace(run, drops=coarse.done, time_step=job.time_step)
    fine = TransitionTally(no_actions(coarse.aspects), run.drops, ids=coarse.ids)
    runner.count(job, run, fine, label=f'{label} with a finer time step', unit='actions')
    return compare_matrices(coarse.matrix, fine.matrix, run.time_step) if fine.complete else None


def compare_matrices(
    coarse: TransitionMatrix, fine: TransitionMatrix, time_step: float
) -> MatrixConvergence:
    """Return the entry that changes most, by symmetry class.

    The bounds are Newcombe's (1998, method 10) with those of Clopper and Pearson, and share the
    error probability among all entries. They are conservative, because the actions start from the
    same states.
    """
    # This import is slow, and only needed for the check.
    from resting_aspects_ros.statistics.comparison import square_and_add

    one, other = fine.by_class(), coarse.by_class()
    # Bounds of a row hold together; the rows share the rest of the error probability.
    confidence = 1 - (1 - coarse.confidence) / len(one.counts)
    a, b = (m.counts / np.maximum(m.actions, 1)[:, None] for m in (one, other))
    lower, upper = square_and_add(
        a,
        bounds(one.counts, one.actions, SIMULTANEOUS, confidence),
        b,
        bounds(other.counts, other.actions, SIMULTANEOUS, confidence),
    )
    row, column = divmod(int(np.abs(a - b).argmax()), a.shape[1])
    return MatrixConvergence(
        time_step=time_step,
        actions=int(fine.actions.sum()),
        row=row,
        column=column,
        shift=float((a - b)[row, column]),
        lower=float(lower[row, column]),
        upper=float(upper[row, column]),
        confidence=coarse.confidence,
    )
