"""Run the drops of many points on all workers at once, each point reproducible by itself."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.api.chunk_loop import PROGRESS_PERIOD, given_workers
from resting_aspects_ros.core.aspects.aspect import find_aspects
from resting_aspects_ros.core.aspects.aspect_set import AspectSet
from resting_aspects_ros.core.aspects.landscape import Landscape
from resting_aspects_ros.core.errors import InvalidValueError, warn
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.poses import RestingPoses
from resting_aspects_ros.simulation.chunks import DeathCount, Workers, chunk_bounds
from resting_aspects_ros.simulation.conditions import DropConditions
from resting_aspects_ros.simulation.run_description import check_drops, check_seed
from resting_aspects_ros.studies.design import Setting
from resting_aspects_ros.studies.point_plans import (
    OTHER,
    WANTED_OUTCOMES,
    PointPlan,
    plan_point,
    point_seed,
)
from resting_aspects_ros.studies.wanted_contacts import WantedContacts

Counts = npt.NDArray[np.int64]


@dataclass(frozen=True)
class PointTask:
    """Drops [first, end) that a point needs; ``index`` is that of the caller."""

    index: int
    first: int
    end: int
    plan: Callable[[], PointPlan]


@dataclass(frozen=True, eq=False)
class PointCounts:
    """Counts of the drops at m points.

    aspects : AspectSet
        Of the part on a level plane.
    counts : (m, k) int
        Drops at rest in each aspect, by id from 1.
    other : (m, 5) int
        Drops that ended otherwise; columns as in OTHER.
    skipped : dict of int to str
        Why a point is impossible; its counts are 0.
    """

    aspects: AspectSet
    counts: Counts
    other: Counts
    skipped: dict[int, str] = field(default_factory=dict)

    @property
    def drops(self) -> Counts:
        """(m,) number of drops at each point."""
        return np.asarray(self.counts.sum(axis=1) + self.other.sum(axis=1))

    def by_class(self) -> Counts:
        """Return the counts (m, c) by symmetry class, in the order of the classes."""
        return counts_by_class(self.aspects, self.counts)


def counts_by_class(aspects: AspectSet, counts: Counts) -> Counts:
    """Return counts (..., k) by aspect as counts (..., c) by symmetry class."""
    classes = [[a.id - 1 for a in members] for members in aspects.classes()]
    return np.stack([counts[..., ids].sum(axis=-1) for ids in classes], axis=-1)


def drop_points(
    part: Part,
    points: Sequence[DropConditions | Setting],
    drops: int,
    seed: int,
    *,
    workers: int | Workers | None = None,
    progress: Callable[[int], None] = lambda _: None,
    stopped: Callable[[], bool] = lambda: False,
    landscape: Landscape | None = None,
    contacts: Sequence[WantedContacts] = (),
) -> PointCounts:
    """Drop a part at each point, and count the aspects; impossible points are skipped.

    The counts of a point follow from the part, its conditions and the seed, bit for bit, and not
    from the other points, which have independent random numbers.

    Parameters
    ----------
    drops : int
        Number of drops at each point. With more drops, the first ones are the same.
    progress : callable
        Called often, with the number of drops made at all points together.
    stopped : callable
        Ends early if it returns True: unfinished points then have fewer drops.
    landscape : Landscape, optional
        Of the part, if it was already computed.
    contacts : sequence of WantedContacts
        Count drops that are at rest with one of these, and other drops at rest, in the two columns
        of ``counts``.
    """
    landscape = Landscape(part) if landscape is None else landscape
    aspects = find_aspects(part, landscape)
    outcomes = WANTED_OUTCOMES if contacts else len(aspects)
    columns = outcomes + len(OTHER)
    counts = np.zeros((len(points), columns), dtype=np.int64)
    skipped: dict[int, str] = {}
    check_drops(drops)
    check_seed(seed)
    done = 0

    def add(task: PointTask, _: tuple[int, int], found: Counts) -> None:
        nonlocal done
        counts[task.index] += found[0]
        done += int(found.sum())
        progress(done)

    def task(index: int, setting: Setting) -> PointTask:
        own = point_seed(seed, part, setting)
        plan = lambda: plan_point(  # noqa: E731
            part, setting, drops, own, landscape, aspects, contacts=contacts
        )
        return PointTask(index, 0, drops, plan)

    settings = [p if isinstance(p, Setting) else Setting(p) for p in points]
    if any(setting.action is not None for setting in settings):
        raise ValueError('drop_points drops parts: it makes no actions')
    with given_workers(workers) as pool:
        run_points(
            [task(k, setting) for k, setting in enumerate(settings)],
            pool,
            add,
            lambda task, error: skipped.__setitem__(task.index, str(error)),
            lambda: progress(done),
            stopped,
        )
    return PointCounts(aspects, counts[:, :outcomes], counts[:, outcomes:], skipped)


def run_points(
    tasks: Iterable[PointTask],
    workers: Workers,
    count: Callable[[PointTask, tuple[int, int], Counts], None],
    skip: Callable[[PointTask, InvalidValueError], None],
    waiting: Callable[[], None] = lambda: None,
    stopped: Callable[[], bool] = lambda: False,
) -> None:
    """Simulate the drops of all tasks, several points at a time, so that no worker is idle.

    ``count`` is called for each finished chunk with its range of drops, in any order, and ``skip``
    for a point that is impossible. ``waiting`` is called often. A chunk whose worker died is
    repeated. Raises EngineError if a worker fails, or if several die in a row.
    """
    pipeline = _Pipeline(workers, _chunks(tasks, skip))
    try:
        while not stopped() and pipeline.fill():
            for chunk, poses in pipeline.finished():
                count(chunk.task, (chunk.first, chunk.end), chunk.plan.count(poses))
            waiting()
    finally:
        pipeline.cancel()


@dataclass(frozen=True)
class _Chunk:
    task: PointTask
    plan: PointPlan
    first: int
    end: int


class _Pipeline:
    """Chunks that are being simulated, enough of them to keep all workers busy."""

    def __init__(self, workers: Workers, chunks: Iterator[_Chunk]) -> None:
        self._workers, self._chunks = workers, chunks
        self._pending: dict[Future[Any], _Chunk] = {}
        self._deaths = DeathCount()

    def fill(self) -> bool:
        """Submit chunks, as many as should be pending; returns whether any is."""
        while len(self._pending) < max(1, self._workers.lookahead()):
            chunk = next(self._chunks, None)
            if chunk is None:
                break
            self._submit(chunk)
        return bool(self._pending)

    def finished(self) -> Iterator[tuple[_Chunk, RestingPoses]]:
        """Wait briefly, and yield the chunks that are finished with their poses."""
        for future in wait(self._pending, PROGRESS_PERIOD, FIRST_COMPLETED).done:
            chunk = self._pending.pop(future)
            try:
                poses = self._workers.result(future)
            except Exception as error:  # noqa: BLE001 - raised again unless a worker died
                where = f'near drop {chunk.first} of a point'
                warn(self._deaths.repeat(self._workers, error, where))
                self._submit(chunk)
                continue
            self._deaths.reset()
            yield chunk, poses

    def cancel(self) -> None:
        """Cancel the chunks that were not started."""
        for future in self._pending:
            future.cancel()

    def _submit(self, chunk: _Chunk) -> None:
        self._pending[self._workers.submit(chunk.plan.job, chunk.first, chunk.end)] = chunk


def _chunks(
    tasks: Iterable[PointTask], skip: Callable[[PointTask, InvalidValueError], None]
) -> Iterator[_Chunk]:
    """Yield the chunks of all tasks; a point is planned when its first chunk is needed."""
    for task in tasks:
        try:
            plan = task.plan()
        except InvalidValueError as error:
            skip(task, error)
            continue
        for first, end in chunk_bounds(plan.job, task.first, task.end):
            yield _Chunk(task, plan, first, end)
