"""The runner: makes the drops or actions of a run and counts them, with progress and a stop.

A run is a job (part, conditions, starts) with its description (seed and number). The runner passes
each chunk of its poses, with the ids of their aspects, to a tally, which counts them and says when
there are enough, and to consumers, such as a log.
"""

import dataclasses
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, wait
from contextlib import closing, contextmanager
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

import numpy as np
import numpy.typing as npt
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn
from rich.progress import Progress as ProgressBar

from resting_aspects_ros.arrays import Counts
from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.errors import EngineError, LogError, OutputError, warn
from resting_aspects_ros.simulation.job import DropJob, RunDescription
from resting_aspects_ros.simulation.workers import (
    LocalWorkers,
    Workers,
    drop_chunks,
)
from resting_aspects_ros.statistics.distribution import (
    Distribution,
    History,
    aspect_ids,
    count_poses,
    no_drops,
)
from resting_aspects_ros.statistics.intervals import SIMULTANEOUS, bounds, checkpoints, is_precise
from resting_aspects_ros.statistics.poses import RestingPoses, RestStatus
from resting_aspects_ros.statistics.transitions import (
    OUTCOMES,
    TransitionMatrix,
    columns_of,
    no_actions,
)
from resting_aspects_ros.system import available_cores

# -- Progress -------------------------------------------------------------------------------------


Self = TypeVar('Self', bound='DropProgress')  # typing.Self is newer than Python 3.10
LINE_PERIOD = 1.0  # s
# Whether progress is shown on standard error; or a function that is called often with the numbers
# done and in total.
Progress = bool | Callable[[int, int], None]


class DropProgress:
    """Progress display of drops, or what ``unit`` is, and their rate; a context manager.

    It is a bar on standard error if that is a terminal, else a line each second. ``done`` are made
    so far. A function as ``shown`` is called instead of a display.
    """

    def __init__(
        self, what: str, total: int, unit: str = 'drops', *, shown: Progress = True
    ) -> None:
        self._visible = shown is True
        self._report = shown if callable(shown) else None
        self._bar: ProgressBar | None = None
        if self._visible and sys.stderr.isatty():
            text = TextColumn('{task.fields[text]}', markup=False)
            title = TextColumn('{task.description}', markup=False)
            columns = title, BarColumn(), MofNCompleteColumn(), text
            self._bar = ProgressBar(*columns, console=Console(stderr=True))
            self._task = self._bar.add_task(what, total=total, text='')
        self.done = 0
        self._what = what
        self._unit = unit
        self._total = total
        self._started = self._shown = time.monotonic()
        self._updated = False
        self._line = ''  # the last printed line

    def __enter__(self: Self) -> Self:  # noqa: PYI019
        return self

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.stop()

    def update(self, done: int) -> None:
        """Update the number of drops made."""
        self.done = done
        self._updated = True
        if self._report is not None:
            self._report(done, self._total)
        now = time.monotonic()
        seconds = max(now - self._started, 1e-9)
        rate = f'{_rate_text(done / seconds)} {self._unit}/s' if done else ''
        if self._bar is not None:
            if 0 < done < self._total:
                rate += f', {seconds * (self._total - done) / done:.0f} s left'
            self._bar.update(self._task, completed=done, total=self._total, text=rate)
            self._bar.start()
        elif self._visible and (now - self._shown >= LINE_PERIOD or done == self._total):
            line = f'{self._what}: {done} of {self._total} {self._unit}'
            if line != self._line:  # a new rate alone is not printed
                print(f'{line}  {rate}'.rstrip(), file=sys.stderr)
                self._line, self._shown = line, now

    def end(self, done: int) -> None:
        """Show ``done`` as the total of the finished run; does nothing if no update was shown."""
        if self._updated:
            self._total = done
            self.update(done)


def _rate_text(rate: float) -> str:
    """Return a rate with two digits, so that a slow one is not 0."""
    return f'{rate:.0f}' if rate >= 10 else f'{rate:.1f}' if rate >= 1 else f'{rate:.2g}'


# -- The runner -----------------------------------------------------------------------------------


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
    """Workers, and how a run reports its progress and is stopped; see `drop`."""

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
            with closing(drop_chunks(job, run, self.workers)) as steps:
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
    workers = LocalWorkers(available_cores() if given is None else given)
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

    ``drops`` is the maximum number of drops, and ``precision`` the maximum half width of the
    intervals at which the run stops; 0: after all drops.
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


class StartTally:
    """Counts of ``number`` parts by their start and where they end: part i has the start i mod n.

    counts : (n, k + 4) int
        Parts of each start that ended in each of the k aspects, by id from 1, and then in each of
        OUTCOMES.
    """

    def __init__(self, aspects: AspectSet, starts: int, number: int) -> None:
        self.aspects, self.number = aspects, number
        self.counts: Counts = np.zeros((starts, len(aspects) + len(OUTCOMES)), dtype=np.int64)

    @property
    def done(self) -> int:
        """Number of parts that are counted."""
        return int(self.counts.sum())

    @property
    def complete(self) -> bool:
        """Whether all parts are counted."""
        return self.done >= self.number

    def add(self, poses: RestingPoses, ids: npt.NDArray[np.int64]) -> None:
        """Count a chunk, given the ids of its aspects."""
        start = np.arange(poses.first_drop, poses.end) % len(self.counts)
        np.add.at(self.counts, (start, columns_of(poses, ids, len(self.aspects))), 1)


class TransitionTally(StartTally):
    """Counts of actions by aspect before and after: action i is on a part in ``ids[i mod k]``.

    ``actions`` is the maximum number from the k aspects ``ids`` together (by default all), and
    ``precision`` the maximum half width of all intervals at which the run stops; 0: never.
    """

    def __init__(
        self,
        empty: TransitionMatrix,
        actions: int,
        precision: float = 0.0,
        ids: Sequence[int] = (),
    ) -> None:
        self.ids = tuple(ids) or tuple(range(1, len(empty.counts) + 1))
        super().__init__(empty.aspects, len(self.ids), actions)
        self.precision, self.precise = precision, False
        self._empty, self._sliding, self._energy_growth = empty, 0, 0.0
        limit = max(1, actions // max(1, len(self.ids)))
        self._checkpoints = [n for n in checkpoints(limit) if precision > 0]

    @property
    def matrix(self) -> TransitionMatrix:
        """The matrix of the actions that are counted."""
        counts = np.zeros_like(self._empty.counts)
        counts[np.array(self.ids, dtype=np.int64) - 1] = self.counts
        growth = self._energy_growth
        return dataclasses.replace(
            self._empty, counts=counts, sliding=self._sliding, energy_growth=growth
        )

    @property
    def complete(self) -> bool:
        """Whether all actions are counted, or enough for the precision."""
        return self.precise or super().complete

    def add(self, poses: RestingPoses, ids: npt.NDArray[np.int64]) -> None:
        """Count a chunk, given the ids of its aspects."""
        super().add(poses, ids)
        self._sliding += int((poses.status == RestStatus.SLIDING).sum())
        growth = float(poses.energy_growth.max(initial=0.0))
        self._energy_growth = max(self._energy_growth, growth)
        actions = self.counts.sum(axis=1)
        while self._checkpoints and actions.min() >= self._checkpoints[0]:
            del self._checkpoints[0]
            interval, confidence = self._empty.interval, self._empty.confidence
            self.precise = all(
                is_precise(row, n, self.precision, interval, confidence)
                for row, n in zip(self.counts, actions.tolist(), strict=True)
            )


# -- Convergence ----------------------------------------------------------------------------------


# Number of time steps of the check for each time step of the run.
REFINEMENT = 2
# The change of a share that the check is meant to detect.
DETECTABLE_SHIFT = 0.01


@dataclass(frozen=True)
class Convergence:
    """Change of the shares when drops or actions are repeated with a finer time step.

    time_step : float
        The finer time step, s.
    number : int
        Number of drops or actions with each time step.
    row, column : int
        The share that changes most. Of drops: row 0, and the aspects as columns. Of actions: from
        a symmetry class to a class or one of OUTCOMES. Both from 0.
    shift : float
        Change of this share: fine minus coarse. Shares of drops are of those in an aspect.
    lower, upper : float
        Bounds of the true shift; those of all shares hold together with ``confidence``.
    """

    time_step: float
    number: int
    row: int
    column: int
    shift: float
    lower: float
    upper: float
    confidence: float

    def text(self, columns: Sequence[str] = ()) -> str:
        """Return the change and a verdict; of actions, ``columns`` name classes and outcomes."""
        share, unit = f'aspect {self.column + 1}', 'drops'
        if columns:
            share = f'the probability from {columns[self.row]} to {columns[self.column]}'
            unit = 'actions'
        verdict = 'explained by chance'
        if not self.lower <= 0 <= self.upper:
            verdict = 'not explained by chance'
        elif self.upper - self.lower > 2 * DETECTABLE_SHIFT:
            verdict = f'too few {unit} to detect {100 * DETECTABLE_SHIFT:g} %'
        return (
            f'With 1/{REFINEMENT} of the time step ({self.time_step * 1e6:.3g} us), '
            f'{share} changes most: {100 * self.shift:+.2g} points,\n'
            f'{verdict} ({100 * self.confidence:g} % interval {100 * self.lower:+.2g} to '
            f'{100 * self.upper:+.2g}, {self.number} {unit} each).'
        )


def find_convergence(
    coarse: Counts, fine: Counts, time_step: float, number: int, confidence: float
) -> Convergence:
    """Compare counts (r, c) with those of the same drops or actions with a finer time step.

    The bounds are Newcombe's (1998, method 10) with those of Clopper and Pearson, and share the
    error probability among all entries. They are those of independent drops, and conservative
    here, because both sets start from the same states.
    """
    # This import is slow, and only needed for the check.
    from resting_aspects_ros.statistics.comparison import square_and_add

    # Bounds of a row hold together; the rows share the rest of the error probability.
    of_row = 1 - (1 - confidence) / len(fine)
    (a, a_bounds), (b, b_bounds) = (
        (
            each / np.maximum(each.sum(axis=1), 1)[:, None],
            bounds(each, each.sum(axis=1), SIMULTANEOUS, of_row),
        )
        for each in (fine, coarse)
    )
    lower, upper = square_and_add(a, a_bounds, b, b_bounds)
    row, column = divmod(int(np.abs(a - b).argmax()), a.shape[1])
    return Convergence(
        time_step=time_step,
        number=number,
        row=row,
        column=column,
        shift=float((a - b)[row, column]),
        lower=float(lower[row, column]),
        upper=float(upper[row, column]),
        confidence=confidence,
    )


def _finer(job: DropJob, run: RunDescription, drops: int) -> tuple[DropJob, RunDescription]:
    job = dataclasses.replace(job, refinement=REFINEMENT * job.refinement)
    return job, dataclasses.replace(run, drops=drops, precision=0.0, time_step=job.time_step)


def repeat_drops_in_finer_steps(
    runner: Runner, job: DropJob, run: RunDescription, coarse: Distribution
) -> Convergence | None:
    """Repeat the drops of a run with a finer time step, and compare the distributions.

    Returns None if it was stopped, or if the convergence could not be determined.
    """
    job, run = _finer(job, run, coarse.drops)
    fine = DropTally(no_drops(coarse.aspects), run.drops)
    if coarse.drops:
        runner.count(job, run, fine, label=f'{run.part} with a finer time step')
    if not fine.complete:
        return None
    counts = fine.distribution.counts
    if not (coarse.counts.any() and counts.any()):
        warn('convergence could not be determined: no drop came to rest in an aspect')
        return None
    return find_convergence(
        coarse.counts[None], counts[None], run.time_step, coarse.drops, coarse.confidence
    )


def repeat_actions_in_finer_steps(
    runner: Runner, job: DropJob, run: RunDescription, coarse: TransitionTally, label: str
) -> Convergence | None:
    """Repeat the actions of a run with a finer time step; returns None if it was stopped."""
    job, run = _finer(job, run, coarse.done)
    fine = TransitionTally(no_actions(coarse.aspects), run.drops, ids=coarse.ids)
    runner.count(job, run, fine, label=f'{label} with a finer time step', unit='actions')
    if not fine.complete:
        return None
    before, after = coarse.matrix, fine.matrix
    return find_convergence(
        before.by_class().counts,
        after.by_class().counts,
        run.time_step,
        coarse.done,
        before.confidence,
    )
