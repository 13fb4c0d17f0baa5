"""What `resting_aspects drop` does: drop a part here and now, without ROS."""

import argparse
import csv
import dataclasses
import sys
import time
import uuid
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, TextIO

from resting_aspects_ros.commands.answer import Answer
from resting_aspects_ros.commands.convergence import REFINEMENT, Convergence, check_convergence
from resting_aspects_ros.commands.given_part import given_part
from resting_aspects_ros.commands.interruption import Interruption
from resting_aspects_ros.commands.outputs import check_output, make_folder, whole_file
from resting_aspects_ros.commands.progress import DropProgress
from resting_aspects_ros.core.aspects import find_aspects
from resting_aspects_ros.core.distribution import METHOD, Distribution, count_poses, no_drops
from resting_aspects_ros.core.errors import EngineError, InvalidValueError
from resting_aspects_ros.core.poses import DecidedBy, RestingPoses, RestStatus
from resting_aspects_ros.drops.campaign import default_workers, make_pool, stop_pool, submit_drops
from resting_aspects_ros.drops.conditions import DropConditions
from resting_aspects_ros.drops.job import DropJob
from resting_aspects_ros.drops.plan import most_drops, plan_run
from resting_aspects_ros.drops.run import RunDescription

INTERRUPTED = 130
POSES_HEADER = (
    'drop', 'x', 'y', 'z', 'qx', 'qy', 'qz', 'qw',
    'status', 'decided_by', 'time_to_rest', 'energy_growth',
)  # fmt: skip
DOCUMENT, PICTURE, POSES = 'distribution.json', 'distribution.png', 'poses.csv'
# A fall from higher than this, hull radii, was probably meant in another unit.
HIGH = 200
# How often it is looked for Ctrl-C, s.
LOOK_PERIOD = 0.1


def drop_here(
    arguments: argparse.Namespace,
    conditions: DropConditions,
    drops: int,
    precision: float,
    confidence: float,
    stop: Interruption,
) -> int:
    """Drop, count and show; returns the exit code.

    ``drops`` and ``precision`` as most_drops has them.

    Raises RestingAspectsError: before the first drop for wrong input, and after what was done is
    saved, if not all could be done.
    """
    part = given_part(arguments.part, arguments.unit, arguments.parts)
    empty = no_drops(
        find_aspects(part),
        interval=arguments.interval,
        confidence=confidence,
        by_precision=precision > 0,
    )
    job, run = plan_run(
        part,
        conditions,
        seed=arguments.seed,
        drops=most_drops(drops, precision, len(empty.aspects), empty.interval, confidence),
        precision=precision,
        run_id=uuid.uuid4().hex[:12],
        started=time.time_ns(),
    )
    workers = default_workers() if arguments.workers is None else arguments.workers
    out: Path | None = arguments.out
    failure: EngineError | None = None
    convergence: Convergence | None = None
    tally = _Tally(empty, run)
    with ExitStack() as stack:
        pool = make_pool(workers)
        stack.callback(stop_pool, pool)
        for flag, path in _poses_paths(arguments.poses, out):
            tally.tables.append(stack.enter_context(_poses_file(flag, path)))
        for warning in (*part.warnings, *_of_height(conditions.height, part.hull_radius)):
            print(f'warning: {warning}', file=sys.stderr)
        try:
            _drop_all(part.name, job, pool, 2 * workers, tally, stop)
            if arguments.check_convergence and not stop.asked:
                convergence = _check(job, pool, 2 * workers, tally, stop)
        except EngineError as error:
            failure = error
    answer = Answer(tally.distribution, run, part, METHOD, tally.over, convergence)
    if out is not None:
        answer.save_json(out / DOCUMENT)
        answer.save_picture(out / PICTURE)
    answer.print(as_json=arguments.json)
    if out is not None and not arguments.json:
        print(f'Written: {", ".join(str(out / name) for name in (DOCUMENT, PICTURE, POSES))}')
    if failure is not None:
        done = tally.distribution.drops
        raise EngineError(f'{failure} after {done} of {run.drops} drops, which are in the answer')
    missing = _missing(answer, check=arguments.check_convergence)
    if missing:
        print(missing, file=sys.stderr)
    return INTERRUPTED if missing else 0


def _missing(answer: Answer, *, check: bool) -> str:
    """What an interruption left out, in words."""
    done = answer.distribution.drops
    if not answer.complete:
        return f'interrupted after {done} of {answer.run.drops} drops, which are in the answer'
    if check and answer.convergence is None:
        return 'interrupted before the convergence was checked'
    return ''


def _of_height(height: float, radius: float) -> Iterator[str]:
    if height > HIGH * radius:
        yield (
            f'the height is {height:g} m, which is {height / radius:.0f} times the radius of the '
            'part'
        )


class _Tally:
    """What was done so far: counted, and written in rows."""

    def __init__(self, distribution: Distribution, run: RunDescription) -> None:
        self.distribution = distribution
        self.run = run
        self.tables: list[TextIO] = []

    def add(self, poses: RestingPoses) -> None:
        for table in self.tables:
            csv.writer(table).writerows(_rows(poses))
            table.flush()
        self.distribution += count_poses(self.distribution.aspects, poses)

    @property
    def over(self) -> bool:
        """All drops are made, or enough."""
        return self.distribution.stops(self.run.precision, self.run.drops)


def _drop_all(
    label: str,
    job: DropJob,
    pool: ProcessPoolExecutor,
    lookahead: int,
    tally: _Tally,
    stop: Interruption,
) -> None:
    with DropProgress(label, tally.run.drops) as progress:
        _drop(job, pool, lookahead, tally, progress.update, stop)
        progress.end(tally.distribution.drops)


def _check(
    job: DropJob, pool: ProcessPoolExecutor, lookahead: int, tally: _Tally, stop: Interruption
) -> Convergence | None:
    """Make the same drops in finer steps; None if somebody asks for an end."""
    coarse = tally.distribution
    fine = dataclasses.replace(job, refinement=REFINEMENT * job.refinement)
    run = dataclasses.replace(
        tally.run, drops=coarse.drops, precision=0.0, time_step=fine.time_step
    )
    again = _Tally(no_drops(coarse.aspects, confidence=coarse.confidence), run)
    _drop_all(f'{run.part} in finer steps', fine, pool, lookahead, again, stop)
    if not again.over:
        return None
    return check_convergence(coarse, again.distribution, run.time_step, run.seed)


def _drop(
    job: DropJob,
    pool: ProcessPoolExecutor,
    lookahead: int,
    tally: _Tally,
    progress: Callable[[int], None],
    stop: Interruption,
) -> None:
    """Make the drops, or those until somebody asks for an end; raises EngineError."""
    try:
        for future in submit_drops(job, 0, tally.run.drops, pool, lookahead):
            while not stop.asked and not wait([future], LOOK_PERIOD).done:
                progress(tally.distribution.drops)
            if stop.asked:
                return
            tally.add(_dropped(future))
            progress(tally.distribution.drops)
            if tally.over:
                return
    except BrokenProcessPool:
        raise EngineError('a worker process died') from None


def _dropped(future: 'Future[RestingPoses]') -> RestingPoses:
    """What a worker dropped; EngineError if it failed, so that what others did is kept."""
    try:
        return future.result()
    except BrokenProcessPool:
        raise
    except Exception as error:
        # Whatever a worker raises, but nothing that is raised here.
        raise EngineError(f'a worker failed: {error!r}') from error


def _poses_paths(poses: Path | None, out: Path | None) -> Iterator[tuple[str, Path]]:
    """Where the poses go, checked, like what goes beside them."""
    check_output('--poses', poses)
    if out is not None:
        make_folder('--out', out)
        for name in (DOCUMENT, PICTURE, POSES):
            check_output('--out', out / name)
        yield '--out', out / POSES
    if poses is not None and not (out is not None and _same(poses, out / POSES)):
        yield '--poses', poses


def _same(one: Path, other: Path) -> bool:
    return one.resolve() == other.resolve()


@contextmanager
def _poses_file(flag: str, path: Path) -> Iterator[TextIO]:
    with whole_file(path) as part:
        try:
            file = part.open('w', newline='', encoding='utf-8')
        except OSError as error:
            raise InvalidValueError(
                f'{flag} is {str(path)!r}, allowed is a file that can be written: {error.strerror}'
            ) from None
        with file:
            csv.writer(file).writerow(POSES_HEADER)
            yield file


def _rows(poses: RestingPoses) -> Iterator[tuple[Any, ...]]:
    """In full precision: Python prints the shortest text that reads back as the same number."""
    for k in range(len(poses)):
        yield (
            poses.first_drop + k,
            *poses.position[k].tolist(),
            *poses.orientation[k].tolist(),
            RestStatus(poses.status[k]).name,
            DecidedBy(poses.decided_by[k]).name,
            float(poses.time_to_rest[k]),
            float(poses.energy_growth[k]),
        )
