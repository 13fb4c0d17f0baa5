"""Drops and actions of a part at many points, each reproducible by itself, and their store."""

import hashlib
import json
import os
import threading
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Literal, TypeVar

import numpy as np
from pydantic import BaseModel, StrictStr

from resting_aspects_ros.api.conditions import aspects_in, scene_of
from resting_aspects_ros.api.plan import check_speed
from resting_aspects_ros.api.runner import (
    PROGRESS_PERIOD,
    Consumer,
    DropTally,
    Runner,
    Tally,
    TransitionTally,
)
from resting_aspects_ros.arrays import Counts
from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.aspects.landscape import Landscape
from resting_aspects_ros.errors import InvalidValueError, OutputError, one_line, shown
from resting_aspects_ros.input_files import Count, validated
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.format import aspects_text
from resting_aspects_ros.simulation.conditions import DEFAULT_DROPS
from resting_aspects_ros.simulation.job import plan_run
from resting_aspects_ros.simulation.starts import RestStarts, Starts, pose_starts, starts_of
from resting_aspects_ros.simulation.workers import Workers
from resting_aspects_ros.statistics.distribution import OUTSIDE, no_drops
from resting_aspects_ros.statistics.poses import RestingPoses
from resting_aspects_ros.statistics.transitions import no_actions
from resting_aspects_ros.studies.design import Setting

MAX_THREADS = 64
STORE, STORE_VERSION = 'points.jsonl', 2

T = TypeVar('T', bound=Tally)


class Stopped(Exception):  # noqa: N818 - it is no error
    """A run ended early, because it was asked to."""


@dataclass(frozen=True)
class Monitor:
    """What a run reports, and how it learns that it should end early.

    update : callable
        Called often, with the number of drops or actions that are made.
    """

    update: Callable[[int], None] = lambda _: None
    stopped: Callable[[], bool] = lambda: False


# Makes the drops of a point: returns counts, or raises Stopped or, if it is impossible,
# InvalidValueError.
Task = Callable[[Monitor], Counts]


@dataclass(frozen=True, eq=False)
class Simulation:
    """Drops and actions of one part at any setting.

    aspects : AspectSet
        Of the part on a level plane.
    """

    part: Part
    workers: Workers
    landscape: Landscape
    aspects: AspectSet

    @classmethod
    def of(cls, part: Part, workers: Workers) -> 'Simulation':
        """Return the simulation of a part; raises InvalidValueError if it has no aspect."""
        landscape = Landscape(part)
        aspects = find_aspects(part, landscape)
        if not len(aspects):
            raise InvalidValueError(f'invalid part {part.name}: expected a part with an aspect')
        return cls(part, workers, landscape, aspects)

    def counts(
        self, setting: Setting | str, drops: int, seed: int, purpose: str, monitor: Monitor
    ) -> Counts:
        """Return counts (k + 5,) of drops by aspect and by OUTSIDE; see point_seed.

        With an action, it is done once on each part that comes to rest in an aspect. Raises
        InvalidValueError if the setting is impossible (a text is the reason), and Stopped.
        """
        if isinstance(setting, str):
            raise InvalidValueError(setting)
        simulate = self.dropped if setting.action is None else self.dropped_and_acted
        return simulate(setting, drops, point_seed(seed, self.part, setting, purpose), monitor)

    def dropped(
        self,
        setting: Setting,
        drops: int,
        seed: int,
        monitor: Monitor,
        consumers: Sequence[Consumer] = (),
        starts: Starts | None = None,
    ) -> Counts:
        """Return counts (k + 5,) of drops by aspect and by OUTSIDE.

        With ``starts``, the part starts there instead of being released.
        """
        found = self._counted(
            lambda aspects: DropTally(no_drops(aspects), drops),
            setting,
            drops,
            seed,
            monitor,
            consumers,
            starts,
        ).distribution
        return np.append(found.counts, [getattr(found, name) for name in OUTSIDE])

    def acted(
        self,
        setting: Setting,
        per_aspect: int,
        seed: int,
        monitor: Monitor,
        ids: Sequence[int] = (),
    ) -> Counts:
        """Return counts (k, k + 5) of actions from each of some aspects, by default of all.

        In surroundings, actions start from poses in which drops there end; an aspect in which
        none ends has no actions.
        """
        assert setting.action is not None
        rests: list[RestingPoses] = []
        scene = scene_of(self.part, setting.drop_conditions)
        setting.action.action.check(setting.action.name, scene)
        if not scene.level:
            quiet = Monitor(stopped=monitor.stopped)
            self.dropped(
                setting, DEFAULT_DROPS, seed, quiet, [lambda poses, _: rests.append(poses)]
            )
        starts = starts_of(
            self.part,
            aspects_in(scene, self.aspects),
            setting.action.action,
            scene,
            setting.drop_conditions,
            RestingPoses.join(rests) if rests else None,
            ids,
        )
        actions = per_aspect * starts.rows
        tally = self._counted(
            lambda aspects: TransitionTally(no_actions(aspects), actions, ids=starts.ids),
            setting,
            actions,
            seed,
            monitor,
            starts=starts,
        )
        # Parts that slide for ever are counted as unsettled.
        return np.pad(tally.matrix.counts, ((0, 0), (0, 1)))

    def dropped_and_acted(
        self, setting: Setting, drops: int, seed: int, monitor: Monitor
    ) -> Counts:
        """Drop parts, do the action once on each part in an aspect, and count where they end.

        Returns counts (k + 5,), which are multinomial, as those of drops are. A part that comes
        to rest in no aspect keeps that outcome.
        """
        assert setting.action is not None
        poses: list[RestingPoses] = []
        scene, k = scene_of(self.part, setting.drop_conditions), len(self.aspects)
        setting.action.action.check(setting.action.name, scene)

        def half(done: int) -> Monitor:  # a part that was dropped is half done
            return Monitor(lambda made: monitor.update((done + made) // 2), monitor.stopped)

        found = self.dropped(setting, drops, seed, half(0), [lambda chunk, _: poses.append(chunk)])
        aspects = aspects_in(scene, self.aspects)
        given = self.part, aspects, setting.action.action, scene, setting.drop_conditions
        starts: list[tuple[RestStarts, int]]
        if scene.level:
            starts = [
                (starts_of(*given, ids=(aspect.id,)), count)
                for aspect, count in zip(aspects, found.tolist(), strict=False)
            ]
        else:
            at_rest = pose_starts(*given, RestingPoses.join(poses))
            starts = [(at_rest, at_rest.rows)]
        found[:k] = 0
        for number, (each, count) in enumerate(starts):
            if count:
                own = seed_of(f'{seed} action {number}')
                done = drops + int(found.sum())
                found += self.dropped(setting, count, own, half(done), starts=each)
        monitor.update(drops)
        # Parts that only the mesh of a curved side stopped are not at rest.
        found[k] += drops - found.sum()
        return found

    def _counted(
        self,
        tally_of: Callable[[AspectSet], T],
        setting: Setting,
        drops: int,
        seed: int,
        monitor: Monitor,
        consumers: Sequence[Consumer] = (),
        starts: Starts | None = None,
    ) -> T:
        """Return the tally of drops, or of parts that start at ``starts``; raises Stopped."""
        job, run = plan_run(
            self.part,
            setting.drop_conditions,
            seed=seed,
            drops=drops,
            run_id='point',
            started=0,
            landscape=self.landscape,
            starts=starts,
        )
        if starts is not None and setting.action is not None:
            check_speed(self.part, setting.action, job)
        tally = tally_of(aspects_in(job.scene, self.aspects))
        runner = Runner(self.workers, lambda done, _: monitor.update(done), monitor.stopped)
        runner.count(job, run, tally, consumers)
        if not tally.complete:
            raise Stopped
        return tally


def run_tasks(
    tasks: Sequence[Task],
    workers: Workers,
    progress: Callable[[int], None] = lambda _: None,
    stopped: Callable[[], bool] = lambda: False,
    finished: Callable[[int, Counts], None] = lambda *_: None,
) -> list[Counts | str | None]:
    """Run tasks, several at a time, so that no worker is idle, and return their counts.

    Instead of its counts, an impossible task returns the reason, and one that was stopped None.
    ``progress`` is called often, with the number of drops that all tasks have made, and
    ``finished`` with the index of each task that returns counts, in any order.
    """
    done, ended = [0] * len(tasks), threading.Event()
    results: list[Counts | str | None] = [None] * len(tasks)

    def run(k: int) -> Counts | str | None:
        monitor = Monitor(partial(done.__setitem__, k), lambda: ended.is_set() or stopped())
        try:
            return None if monitor.stopped() else tasks[k](monitor)
        except InvalidValueError as error:
            return str(error)
        except Stopped:
            return None

    with ThreadPoolExecutor(min(max(1, workers.lookahead()), MAX_THREADS)) as threads:
        running = {threads.submit(run, k): k for k in range(len(tasks))}
        try:
            waiting = set(running)
            while waiting:
                ready, waiting = wait(waiting, PROGRESS_PERIOD, FIRST_COMPLETED)
                for future in sorted(ready, key=running.__getitem__):
                    k = running[future]
                    found = results[k] = future.result()
                    if isinstance(found, np.ndarray):
                        finished(k, found)
                progress(sum(done))
        finally:
            ended.set()
            for future in running:
                future.cancel()
    return results


def point_key(part: Part, setting: Setting) -> str:
    """Return a hash of everything physical at a point: part, conditions and action."""
    action = setting.action
    values = {} if action is None else {**action.values, 'name': '', 'time': 0}
    document = [part.part_sha256, setting.drop_conditions.key(), values]
    return hashlib.sha256(json.dumps(document, sort_keys=True).encode('ascii')).hexdigest()


def point_seed(seed: int, part: Part, setting: Setting, purpose: str = '') -> int:
    """Return the seed of a point, which follows from the study's seed and from the point.

    It does not depend on the other points, so that points can be added in any order. The drops
    for another purpose are independent.
    """
    return seed_of(f'{seed} {point_key(part, setting)} {purpose}'.rstrip())


def seed_of(text: str) -> int:
    """Return the seed that follows from a text."""
    return int.from_bytes(hashlib.sha256(text.encode('utf-8')).digest()[:8], 'little')


def counted(found: Sequence[Counts | str | None], *shape: int) -> Counts:
    """Return the counts (m, ...) of tasks; 0 for those without counts."""
    none = np.zeros(shape, dtype=np.int64)
    return np.array([each if isinstance(each, np.ndarray) else none for each in found])


def reasons(found: Sequence[Counts | str | None]) -> dict[int, str]:
    """Return why tasks are impossible, by index."""
    return {k: each for k, each in enumerate(found) if isinstance(each, str)}


def counts_by_class(aspects: AspectSet, counts: Counts) -> Counts:
    """Return counts (..., k) by aspect as counts (..., c) by symmetry class."""
    classes = [[a.id - 1 for a in members] for members in aspects.classes()]
    return np.stack([counts[..., ids].sum(axis=-1) for ids in classes], axis=-1)


@dataclass(frozen=True, eq=False)
class Case:
    """Counts of one part, or of an action on a part at rest in one class, at m points.

    classes : (m, c) int
        Drops in each symmetry class.
    other : (m, 5) int
        Drops that ended otherwise; columns as in OUTSIDE.
    start : int or None
        Number of the symmetry class from which the actions start; None: dropped.
    skipped : dict of int to str
        Why points are impossible for this part.
    fresh : dict of int to (c + 1,) int
        Fresh drops by class and elsewhere at some of the points: where a factor seems to change
        the shares most.
    """

    part: Part
    aspects: AspectSet
    classes: Counts
    other: Counts
    start: int | None = None
    skipped: dict[int, str] = field(default_factory=dict)
    fresh: dict[int, Counts] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """The part, and the start if there is one."""
        if self.start is None:
            return self.part.name
        return f'{self.part.name} from {self.class_names[self.start - 1]}'

    @property
    def class_names(self) -> list[str]:
        """Names of the symmetry classes, such as 'aspects 1 and 2'."""
        members = self.aspects.classes()
        return [aspects_text(alike) for alike in members]

    @property
    def start_ids(self) -> tuple[int, ...]:
        """Ids of the aspects from which the actions start; empty: dropped."""
        if self.start is None:
            return ()
        return tuple(aspect.id for aspect in self.aspects.classes()[self.start - 1])

    @property
    def drops(self) -> Counts:
        """(m,) number of drops at each point."""
        return np.asarray(self.classes.sum(axis=1) + self.other.sum(axis=1))

    @property
    def columns(self) -> list[str]:
        """Names of the columns of ``table``."""
        return [*self.class_names, *(['elsewhere'] if self.other.any() else [])]

    @property
    def table(self) -> Counts:
        """Counts (m, c) by class, with a column for drops in none of them if there are any."""
        if not self.other.any():
            return self.classes
        return np.column_stack([self.classes, self.other.sum(axis=1)])


class _Header(BaseModel):
    schema_version: Literal[STORE_VERSION]  # type: ignore[valid-type]
    versions: dict[StrictStr, StrictStr]


class _Point(BaseModel):
    point: StrictStr
    drops: Count
    counts: list[list[Count]]


class PointStore:
    """Counts of finished points, in a file of JSON lines to which they are appended.

    Parameters
    ----------
    path : Path or None
        None: the counts are only kept in memory.
    versions : mapping
        Versions of everything that determines the counts. A file of other versions is refused.

    Raises
    ------
    InvalidValueError
        If the file has other versions, or it is not such a file.
    OutputError
        If the file cannot be written.
    """

    def __init__(self, path: Path | None, versions: Mapping[str, str]) -> None:
        self._path = path
        self._counts: dict[str, tuple[int, Counts]] = {}
        if path is not None and not (path.exists() and self._read(path, versions)):
            self._append({'schema_version': STORE_VERSION, 'versions': dict(versions)})

    def counts(self, key: str, drops: int) -> Counts | None:
        """Return the counts of a point; None if it has not this number of drops, or more."""
        found = self._counts.get(key)
        return None if found is None or found[0] < drops else found[1]

    def add(self, key: str, drops: int, counts: Counts) -> None:
        """Append the counts (r, c) of a point; raises OutputError."""
        self._append({'point': key, 'drops': drops, 'counts': counts.tolist()})
        self._counts[key] = drops, counts

    def _append(self, document: Mapping[str, object]) -> None:
        if self._path is None:
            return
        line = json.dumps(document, separators=(',', ':')).encode() + b'\n'
        try:
            with self._path.open('ab') as file:
                file.write(line)
        except OSError as error:
            raise OutputError(
                f'{str(self._path)!r} cannot be written: {error.strerror}; the points in it are '
                'complete, and the same command continues the study'
            ) from error

    def _read(self, path: Path, versions: Mapping[str, str]) -> bool:
        """Read the file; returns whether it has a line. Raises InvalidValueError."""
        try:
            data = path.read_bytes()
            whole = data[: data.rfind(b'\n') + 1]
            if len(whole) < len(data):  # writing the last line was interrupted
                os.truncate(path, len(whole))
            if not whole:
                return False
            header, *documents = [json.loads(line) for line in whole.splitlines()]
            found = validated(_Header, header, 'line 1').versions
            for number, document in enumerate(documents, 2):
                each = validated(_Point, document, f'line {number}')
                self._counts[each.point] = each.drops, np.array(each.counts, dtype=np.int64)
        except (OSError, ValueError, RecursionError, InvalidValueError) as error:
            raise InvalidValueError(
                f'invalid file {shown(str(path))}: expected points of a study: '
                f'{one_line(str(error))}'
            ) from None
        for name, here in versions.items():
            if found.get(name) != here:
                raise InvalidValueError(
                    f'invalid study {shown(str(path))}: its drops were made with {name} '
                    f'{found.get(name)}, expected {here}, because drops of two versions do not '
                    'belong together; use another folder'
                )
        return True
