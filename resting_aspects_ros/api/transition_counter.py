"""Make the actions of a run and count the transitions as they arrive."""

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np

from resting_aspects_ros.api.chunk_loop import count_chunks
from resting_aspects_ros.api.drop_counter import DETECTABLE_SHIFT, REFINEMENT
from resting_aspects_ros.simulation.job import DropJob, RunDescription
from resting_aspects_ros.simulation.workers import Workers
from resting_aspects_ros.statistics.comparison import square_and_add
from resting_aspects_ros.statistics.distribution import aspect_ids
from resting_aspects_ros.statistics.intervals import SIMULTANEOUS, bounds, checkpoints, is_precise
from resting_aspects_ros.statistics.poses import RestingPoses, RestStatus
from resting_aspects_ros.statistics.transitions import (
    TransitionMatrix,
    columns_of,
    no_actions,
)


class TransitionCounter:
    """Counter that makes the actions of a run: action i is on a part in ``ids[i mod k]``.

    Parameters
    ----------
    empty : TransitionMatrix
        Matrix without actions.
    run : RunDescription
        ``drops`` is the maximum number of actions from all aspects together.
    precision : float
        Maximum half width of all intervals of the matrix at which the run stops; 0: never.
    ids : sequence of int, optional
        The k aspects from which actions start; by default all.
    """

    def __init__(
        self,
        empty: TransitionMatrix,
        run: RunDescription,
        precision: float,
        ids: Sequence[int] = (),
    ) -> None:
        self.matrix = empty
        self.ids = tuple(ids) or tuple(range(1, len(empty.counts) + 1))
        self._rows = np.array(self.ids, dtype=np.int64) - 1
        self.run = run
        self.precision = precision
        self.precise = False
        limit = max(1, run.drops // max(1, len(self.ids)))
        self._checkpoints = [n for n in checkpoints(limit) if precision > 0]

    @property
    def done(self) -> int:
        """Number of actions made."""
        return int(self.matrix.actions.sum())

    @property
    def complete(self) -> bool:
        """Whether all actions are made, or enough for the precision."""
        return self.precise or self.done >= self.run.drops

    def make(
        self,
        job: DropJob,
        workers: Workers,
        progress: Callable[[int], None] = lambda _: None,
        stopped: Callable[[], bool] = lambda: False,
    ) -> None:
        """Make the actions until ``stopped`` returns True; raises EngineError."""
        count_chunks(
            job,
            self.run,
            [(self.run.first_drop, self.run.end)],
            workers,
            self.count,
            lambda: self.complete,
            lambda: progress(self.done),
            stopped,
        )

    def count(self, poses: RestingPoses) -> None:
        """Count a chunk; chunks must arrive in order."""
        k = len(self.matrix.counts)
        start = self._rows[np.arange(poses.first_drop, poses.end) % len(self._rows)]
        end = columns_of(poses, aspect_ids(self.matrix.aspects, poses), k)
        counts = np.zeros_like(self.matrix.counts)
        np.add.at(counts, (start, end), 1)
        growth = float(poses.energy_growth.max(initial=0.0))
        self.matrix += dataclasses.replace(
            self.matrix,
            counts=counts,
            sliding=int((poses.status == RestStatus.SLIDING).sum()),
            energy_growth=growth,
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


@dataclasses.dataclass(frozen=True)
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


def check_in_finer_steps(
    counter: TransitionCounter,
    job: DropJob,
    workers: Workers,
    progress: Callable[[int], None] = lambda _: None,
    stopped: Callable[[], bool] = lambda: False,
) -> MatrixConvergence | None:
    """Repeat the actions with a finer time step; returns None if they were stopped."""
    coarse = counter.matrix
    fine = dataclasses.replace(job, refinement=REFINEMENT * job.refinement)
    run = dataclasses.replace(counter.run, drops=counter.done, time_step=fine.time_step)
    again = TransitionCounter(no_actions(coarse.aspects), run, 0.0, counter.ids)
    again.make(fine, workers, progress, stopped)
    if not again.complete:
        return None
    return compare_matrices(coarse, again.matrix, run.time_step)


def compare_matrices(
    coarse: TransitionMatrix, fine: TransitionMatrix, time_step: float
) -> MatrixConvergence:
    """Return the entry that changes most, by symmetry class.

    The bounds are Newcombe's (1998, method 10) with those of Clopper and Pearson, and share the
    error probability among all entries. They are conservative, because the actions start from the
    same states.
    """
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
