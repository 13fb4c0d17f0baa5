"""The runner: makes the drops or actions of a run and counts them, with progress and a stop.

A run is a job (part, conditions, starts) with its description (seed and number). The runner passes
each chunk of its poses, with the ids of their aspects, to a tally, which counts them and says when
there are enough, and to consumers, such as a log.
"""

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, wait
from contextlib import closing, contextmanager
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.api.progress import DropProgress, Progress
from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.errors import EngineError, LogError, OutputError, warn
from resting_aspects_ros.simulation.job import DropJob, RunDescription
from resting_aspects_ros.simulation.workers import (
    LocalWorkers,
    Workers,
    default_workers,
    drop_chunks,
)
from resting_aspects_ros.statistics.distribution import (
    Distribution,
    History,
    aspect_ids,
    count_poses,
)
from resting_aspects_ros.statistics.intervals import checkpoints, is_precise
from resting_aspects_ros.statistics.poses import RestingPoses, RestStatus
from resting_aspects_ros.statistics.transitions import TransitionMatrix, columns_of

# How often progress is reported while a chunk is simulated, s.
PROGRESS_PERIOD = 0.1
# Called for each chunk of poses, in order, with the ids of their aspects, 0 for none.
Consumer = Callable[[RestingPoses, npt.NDArray[np.int64]], None]


def never() -> bool:
    """Return False: the run is not stopped."""
    return False


class Tally(Protocol):
    """Counts of the chunks of a run, which are added in order."""

    @property
    def aspects(self) -> AspectSet:
        """The aspects that are counted."""

    @property
    def done(self) -> int:
        """Number of drops or actions that are counted."""

    @property
    def complete(self) -> bool:
        """Whether no more are needed."""

    def add(self, poses: RestingPoses, ids: npt.NDArray[np.int64]) -> None:
        """Count a chunk, given the ids of its aspects."""


@dataclass(frozen=True)
class Runner:
    """Workers, and how a run reports its progress and is stopped.

    progress : bool or callable
        Show progress on standard error, or call this often with the numbers done and in total.
    stopped : callable
        Called often; a run ends early when it returns True.
    """

    workers: Workers
    progress: Progress = False
    stopped: Callable[[], bool] = never

    def count(
        self,
        job: DropJob,
        run: RunDescription,
        tally: Tally,
        consumers: Sequence[Consumer] = (),
        *,
        label: str = '',
        unit: str = 'drops',
    ) -> None:
        """Make the drops or actions of a run until the tally is complete; raises EngineError."""
        with DropProgress(label or run.part, run.drops, unit, shown=self.progress) as bar:
            with closing(drop_chunks(job, run, self.workers, warn)) as steps:
                for step in steps:
                    if isinstance(step, Future):
                        while not self.stopped() and not wait([step], PROGRESS_PERIOD).done:
                            bar.update(tally.done)
                    else:
                        ids = aspect_ids(tally.aspects, step)
                        tally.add(step, ids)
                        for consume in consumers:
                            consume(step, ids)
                        bar.update(tally.done)
                    if self.stopped() or tally.complete:
                        break
            bar.end(tally.done)


@contextmanager
def make_runner(
    workers: int | Workers | None = None,
    progress: Progress = False,
    stopped: Callable[[], bool] = never,
) -> Iterator[Runner]:
    """Yield a runner with the given workers, or with new ones, which are stopped at the end."""
    with given_workers(workers) as pool:
        yield Runner(pool, progress, stopped)


@contextmanager
def given_workers(given: int | Workers | None) -> Iterator[Workers]:
    """Yield the given workers, or new ones of this machine, which are stopped at the end.

    A number is that of the workers; None: one for each core.
    """
    if given is not None and not isinstance(given, int):
        yield given
        return
    workers = LocalWorkers(default_workers() if given is None else given)
    try:
        yield workers
    finally:
        workers.stop()


@contextmanager
def keep_result(result: Callable[[], Any]) -> Iterator[None]:
    """Give an error that ends the work the result that is complete so far.

    It is the attribute ``result`` of EngineError, LogError and OutputError.
    """
    try:
        yield
    except (EngineError, LogError, OutputError) as error:
        error.result = result()
        raise


class DropTally:
    """Counts of drops by aspect, and how they developed.

    Parameters
    ----------
    empty : Distribution
        Without drops.
    drops : int
        Maximum number of drops.
    precision : float
        Maximum half width of the intervals at which the run stops; 0: make all drops.
    """

    def __init__(self, empty: Distribution, drops: int, precision: float = 0.0) -> None:
        self.distribution, self.aspects = empty, empty.aspects
        self.drops, self.precision = drops, precision
        self.history = History(empty.aspects)

    @property
    def done(self) -> int:
        """Number of drops."""
        return self.distribution.drops

    @property
    def complete(self) -> bool:
        """Whether all drops are counted, or enough for the precision."""
        return self.distribution.stops(self.precision, self.drops)

    def add(self, poses: RestingPoses, ids: npt.NDArray[np.int64]) -> None:
        """Count a chunk, given the ids of its aspects."""
        self.history.add(ids)
        self.distribution += count_poses(self.aspects, poses, ids)


class TransitionTally:
    """Counts of actions by aspect before and after: action i is on a part in ``ids[i mod k]``.

    Parameters
    ----------
    empty : TransitionMatrix
        Matrix without actions.
    actions : int
        Maximum number of actions from all aspects together.
    precision : float
        Maximum half width of all intervals of the matrix at which the run stops; 0: never.
    ids : sequence of int, optional
        The k aspects from which actions start; by default all.
    """

    def __init__(
        self,
        empty: TransitionMatrix,
        actions: int,
        precision: float = 0.0,
        ids: Sequence[int] = (),
    ) -> None:
        self.matrix, self.aspects = empty, empty.aspects
        self.ids = tuple(ids) or tuple(range(1, len(empty.counts) + 1))
        self.actions, self.precision, self.precise = actions, precision, False
        self._rows = np.array(self.ids, dtype=np.int64) - 1
        limit = max(1, actions // max(1, len(self.ids)))
        self._checkpoints = [n for n in checkpoints(limit) if precision > 0]

    @property
    def done(self) -> int:
        """Number of actions."""
        return int(self.matrix.actions.sum())

    @property
    def complete(self) -> bool:
        """Whether all actions are counted, or enough for the precision."""
        return self.precise or self.done >= self.actions

    def add(self, poses: RestingPoses, ids: npt.NDArray[np.int64]) -> None:
        """Count a chunk, given the ids of its aspects."""
        start = self._rows[np.arange(poses.first_drop, poses.end) % len(self._rows)]
        end = columns_of(poses, ids, len(self.matrix.counts))
        counts = np.zeros_like(self.matrix.counts)
        np.add.at(counts, (start, end), 1)
        self.matrix += dataclasses.replace(
            self.matrix,
            counts=counts,
            sliding=int((poses.status == RestStatus.SLIDING).sum()),
            energy_growth=float(poses.energy_growth.max(initial=0.0)),
        )
        self._check_precision()

    def _check_precision(self) -> None:
        actions = self.matrix.actions[self._rows]
        while self._checkpoints and actions.min() >= self._checkpoints[0]:
            del self._checkpoints[0]
            m = self.matrix
            self.precise = all(
                is_precise(row, n, self.precision, m.interval, m.confidence)
                for row, n in zip(m.counts[self._rows], actions.tolist(), strict=True)
            )
