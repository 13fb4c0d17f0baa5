"""Run a study: simulate what is missing, and store it point by point."""

import functools
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.api.chunk_loop import given_workers
from resting_aspects_ros.api.output_files import make_folder
from resting_aspects_ros.api.progress import DropProgress
from resting_aspects_ros.api.reorient import drop_for_start
from resting_aspects_ros.core.aspects.aspect import find_aspects
from resting_aspects_ros.core.aspects.landscape import Landscape
from resting_aspects_ros.core.errors import EngineError, InvalidValueError
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.poses import RestingPoses
from resting_aspects_ros.simulation.chunks import Workers
from resting_aspects_ros.simulation.dask_workers import worker_versions
from resting_aspects_ros.simulation.run_description import DEFAULT_DROPS
from resting_aspects_ros.studies.design import Setting, point_values
from resting_aspects_ros.studies.point_plans import OTHER, plan_point, point_key, point_seed
from resting_aspects_ros.studies.point_runs import PointTask, run_points
from resting_aspects_ros.studies.point_store import STORE, PointStore
from resting_aspects_ros.studies.study_cases import cases_of
from resting_aspects_ros.studies.study_result import StudyResult
from resting_aspects_ros.studies.study_spec import (
    SPEC,
    StudySpec,
    read_spec,
    write_spec,
)

Counts = npt.NDArray[np.int64]


def run_study(
    spec: StudySpec,
    folder: Path | None,
    *,
    workers: int | Workers | None = None,
    progress: bool = False,
    stopped: Callable[[], bool] = lambda: False,
) -> StudyResult:
    """Make a study or continue it; see study. Ends early if ``stopped`` returns True."""
    versions = worker_versions()
    if folder is not None:
        make_folder('--out', folder)
        if (folder / SPEC).exists():
            spec = spec.extended(read_spec(folder / SPEC))
    points = spec.points()
    with PointStore(folder and folder / STORE, versions) as store:
        if folder is not None:
            write_spec(spec, folder, versions)
        with given_workers(workers) as pool:
            run = _Run(spec, points, store, pool)
            complete = run.make(progress, stopped)
        cases = [case for made in run.parts for case in made.cases()]
        return StudyResult(spec, points, tuple(cases), complete, folder)


class _PartPoints:
    """The points of one part, with its aspects and what is stored of it."""

    def __init__(self, part: Part, settings: Sequence[Setting | str], run: '_Run') -> None:
        self.part = part
        self.landscape = Landscape(part)
        self.aspects = find_aspects(part, self.landscape)
        if not len(self.aspects):
            raise InvalidValueError(f'invalid part {part.name}: expected a part with an aspect')
        self.settings = settings
        self.skipped = {k: each for k, each in enumerate(settings) if isinstance(each, str)}
        self._run = run
        self.starts = 1 if run.spec.base.action is None else len(self.aspects)
        self.needed = run.spec.drops * self.starts

    @functools.cached_property
    def keys(self) -> list[str]:
        """Keys of the points; empty for impossible ones."""
        seed = self._run.spec.seed
        return [
            '' if isinstance(each, str) else f'{seed}-{point_key(self.part, each)}'
            for each in self.settings
        ]

    def tasks(self) -> list[PointTask]:
        """Return what is missing."""
        found = []
        for k, (key, setting) in enumerate(zip(self.keys, self.settings, strict=True)):
            if isinstance(setting, Setting) and self._run.store.done(key) < self.needed:
                plan = functools.partial(self._plan, setting)
                found.append(PointTask(k, self._run.store.done(key), self.needed, plan))
        return found

    def _plan(self, setting: Setting) -> Any:
        seed = point_seed(self._run.spec.seed, self.part, setting)
        rests = functools.partial(self._rests, seed)
        return plan_point(
            self.part, setting, self.needed, seed, self.landscape, self.aspects, rests
        )

    def _rests(self, seed: int, setting: Setting) -> RestingPoses:
        conditions = setting.drop_conditions
        return drop_for_start(
            self.part, conditions, DEFAULT_DROPS, seed, self._run.workers, shown=False
        )[1]

    def cases(self) -> Any:
        """Return the cases of the part, with what is stored."""
        shape = (self.starts, len(self.aspects) + len(OTHER))
        none = np.zeros(shape, dtype=np.int64)
        stored = [self._run.store.counts(key) for key in self.keys]
        counts = np.array([none if each is None else each for each in stored])
        return cases_of(self.part, self.aspects, counts, self.skipped)


class _Run:
    """A run of a study: what is missing is simulated, and stored point by point."""

    def __init__(self, spec: StudySpec, points: Any, store: PointStore, workers: Workers) -> None:
        self.spec, self.store, self.workers = spec, store, workers
        settings = [_setting(spec.base, values) for values in point_values(spec.factors, points)]
        self.parts = [_PartPoints(part, settings, self) for part in spec.parts]
        self._partial: dict[tuple[int, int], dict[int, tuple[int, Counts]]] = {}
        self._done = 0

    def make(self, progress: bool, stopped: Callable[[], bool]) -> bool:
        """Make what is missing; returns whether all possible points are complete."""
        tasks = {(j, task.index): task for j, p in enumerate(self.parts) for task in p.tasks()}
        owners = {id(task): key for key, task in tasks.items()}
        total = sum(task.end - task.first for task in tasks.values())
        all_points = len(tasks) == sum(len(p.settings) for p in self.parts)
        label = f'{len(tasks)} {"" if all_points else "missing "}points'
        with DropProgress(label, total, shown=progress and total > 0) as bar:
            try:
                run_points(
                    tasks.values(),
                    self.workers,
                    lambda task, span, counts: self._count(owners[id(task)], task, span, counts),
                    lambda task, error: self._skip(owners[id(task)], error),
                    lambda: bar.update(self._done),
                    stopped,
                )
            except EngineError:
                self._store_partial()
                raise
            self._store_partial()
            bar.end(self._done)
        return all(not p.tasks() or _only_skipped(p) for p in self.parts)

    def _count(
        self, owner: tuple[int, int], task: PointTask, span: tuple[int, int], counts: Counts
    ) -> None:
        self._done += span[1] - span[0]
        self._partial.setdefault(owner, {})[span[0]] = (span[1], counts)
        if sum(end - first for first, (end, _) in self._partial[owner].items()) == (
            task.end - task.first
        ):
            self._store(owner)

    def _store(self, owner: tuple[int, int]) -> None:
        """Store the drops of a point that follow those that are stored, without a gap."""
        part, index = owner
        key, chunks = self.parts[part].keys[index], self._partial[owner]
        first = end = self.store.done(key)
        total: Any = 0
        while end in chunks:
            end, counts = chunks.pop(end)
            total = total + counts
        if end > first:
            self.store.add(key, first, end, total)

    def _store_partial(self) -> None:
        for owner in list(self._partial):
            self._store(owner)

    def _skip(self, owner: tuple[int, int], error: InvalidValueError) -> None:
        part, index = owner
        self.parts[part].skipped[index] = str(error)


def _only_skipped(points: _PartPoints) -> bool:
    return all(task.index in points.skipped for task in points.tasks())


def _setting(base: Setting, values: Mapping[str, float]) -> Setting | str:
    """Return the setting of a point, or why it is impossible."""
    try:
        return base.changed(values)
    except InvalidValueError as error:
        return str(error)
