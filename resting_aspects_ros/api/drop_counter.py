"""Make the drops of a run and count them as they arrive."""

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.api.chunk_loop import count_chunks
from resting_aspects_ros.api.convergence import REFINEMENT, Convergence, check_convergence
from resting_aspects_ros.core.errors import warn
from resting_aspects_ros.core.poses import RestingPoses
from resting_aspects_ros.core.statistics.distribution import (
    Distribution,
    aspect_ids,
    count_poses,
    no_drops,
)
from resting_aspects_ros.core.statistics.history import History
from resting_aspects_ros.simulation.chunks import Workers
from resting_aspects_ros.simulation.drop_job import DropJob
from resting_aspects_ros.simulation.run_description import RunDescription

# Called for each chunk of poses, with the ids of their aspects.
Consumer = Callable[[RestingPoses, npt.NDArray[np.int64]], None]


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
