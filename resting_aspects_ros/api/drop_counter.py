"""Make the drops of a run and count them as they arrive; check whether the time step matters."""

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.api.chunk_loop import count_chunks
from resting_aspects_ros.errors import warn
from resting_aspects_ros.simulation.job import MAX_DROPS, DropJob, RunDescription
from resting_aspects_ros.simulation.workers import Workers
from resting_aspects_ros.statistics.distribution import (
    Distribution,
    History,
    aspect_ids,
    count_poses,
    no_drops,
)
from resting_aspects_ros.statistics.poses import RestingPoses

# Number of time steps of the check for each time step of the run.
REFINEMENT = 2
# The change of a share that the check is meant to detect.
DETECTABLE_SHIFT = 0.01
# Called for each chunk of poses, with the ids of their aspects.
Consumer = Callable[[RestingPoses, npt.NDArray[np.int64]], None]


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


class DropCounter:
    """Counter that makes the drops of a run, counts them, and passes them to consumers.

    Parameters
    ----------
    distribution : Distribution
        Distribution without drops.
    run : RunDescription
    precision : float
        Maximum half width of the intervals at which the run stops; 0: make all drops.
    consumers : sequence of callables
        Called with each chunk of poses and the ids of their aspects.
    """

    def __init__(
        self,
        distribution: Distribution,
        run: RunDescription,
        precision: float = 0.0,
        consumers: Sequence[Consumer] = (),
    ) -> None:
        self.distribution = distribution
        self.run = run
        self.precision = precision
        self.consumers = list(consumers)
        self.history = History(distribution.aspects)

    @property
    def complete(self) -> bool:
        """Return whether all drops are made, or enough for the precision."""
        return self.distribution.stops(self.precision, self.run.drops)

    def drop(
        self,
        job: DropJob,
        workers: Workers,
        progress: Callable[[int], None] = lambda _: None,
        stopped: Callable[[], bool] = lambda: False,
    ) -> None:
        """Make the drops until `stopped` returns True; raises EngineError.

        ``progress`` is called often, with the number of drops made.
        """
        count_chunks(
            job,
            self.run,
            [(self.run.first_drop, self.run.end)],
            workers,
            self._count,
            lambda: self.complete,
            lambda: progress(self.distribution.drops),
            stopped,
        )

    def _count(self, poses: RestingPoses) -> None:
        aspects = self.distribution.aspects
        ids = aspect_ids(aspects, poses)
        self.history.add(ids)
        self.distribution += count_poses(aspects, poses, ids)
        for consume in self.consumers:
            consume(poses, ids)


def check_in_finer_steps(
    counter: DropCounter,
    job: DropJob,
    workers: Workers,
    progress: Callable[[int], None] = lambda _: None,
    stopped: Callable[[], bool] = lambda: False,
) -> tuple[bool, Convergence | None]:
    """Repeat the drops of a counter with a finer time step, and compare the distributions.

    Returns
    -------
    complete : bool
        Whether all drops were made again.
    convergence : Convergence or None
        None if it is not complete, or could not be determined.
    """
    coarse = counter.distribution
    fine = dataclasses.replace(job, refinement=REFINEMENT * job.refinement)
    run = dataclasses.replace(
        counter.run, drops=coarse.drops, precision=0.0, time_step=fine.time_step
    )
    empty = no_drops(coarse.aspects, confidence=coarse.confidence)
    again = DropCounter(empty, run)
    again.drop(fine, workers, progress, stopped)
    if not again.complete:
        return False, None
    found = check_convergence(coarse, again.distribution, run.time_step, run.seed)
    if found is None:
        warn('convergence could not be determined: no drop came to rest in an aspect')
    return True, found
