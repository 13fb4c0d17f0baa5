"""Make drops and count them as they come, until there are enough or somebody asks for an end."""

import dataclasses
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import Future, wait
from contextlib import closing
from typing import TextIO

from resting_aspects_ros.commands.convergence import REFINEMENT, Convergence, check_convergence
from resting_aspects_ros.commands.interruption import Interruption
from resting_aspects_ros.commands.poses_csv import write_poses
from resting_aspects_ros.commands.progress import DropProgress
from resting_aspects_ros.core.distribution import Distribution, aspect_ids, count_poses, no_drops
from resting_aspects_ros.core.history import History
from resting_aspects_ros.core.poses import RestingPoses
from resting_aspects_ros.drops.campaign import Workers, drop_chunks
from resting_aspects_ros.drops.job import DropJob
from resting_aspects_ros.drops.run import RunDescription

# How often it is looked for Ctrl-C, s.
LOOK_PERIOD = 0.1


class Tally:
    """What was done so far: counted, and written in rows.

    precision : at which to stop; 0: when all drops are made
    ranges : which drops they are, if they are not those from the run's first on
    """

    def __init__(
        self,
        distribution: Distribution,
        run: RunDescription,
        precision: float,
        ranges: Sequence[tuple[int, int]],
    ) -> None:
        self.distribution = distribution
        self.run = run
        self.precision = precision
        self.ranges = ranges or [(run.first_drop, run.end)]
        self.tables: list[TextIO] = []
        self.history = History(distribution.aspects)

    def add(self, poses: RestingPoses) -> None:
        """Count the drops that come next."""
        aspects = self.distribution.aspects
        ids = aspect_ids(aspects, poses)
        for table in self.tables:
            write_poses(table, poses, ids)
        self.history.add(ids)
        self.distribution += count_poses(aspects, poses, ids)

    @property
    def over(self) -> bool:
        """All drops are made, or enough."""
        return self.distribution.stops(self.precision, self.run.drops)


def drop_all(label: str, job: DropJob, workers: Workers, tally: Tally, stop: Interruption) -> None:
    """Make the drops of a tally, and show how far it is; raises EngineError."""
    with DropProgress(label, tally.run.drops) as progress:
        _drop(job, workers, tally, progress.update, stop)
        progress.end(tally.distribution.drops)


def check_in_finer_steps(
    job: DropJob, workers: Workers, tally: Tally, stop: Interruption
) -> tuple[bool, Convergence | None]:
    """Make the same drops in finer steps: whether all were made, and what they show."""
    coarse = tally.distribution
    fine = dataclasses.replace(job, refinement=REFINEMENT * job.refinement)
    run = dataclasses.replace(
        tally.run, drops=coarse.drops, precision=0.0, time_step=fine.time_step
    )
    empty = no_drops(coarse.aspects, confidence=coarse.confidence)
    again = Tally(empty, run, 0.0, () if tally.precision else tally.ranges)
    drop_all(f'{run.part} in finer steps', fine, workers, again, stop)
    if not again.over:
        return False, None
    found = check_convergence(coarse, again.distribution, run.time_step, run.seed)
    if found is None:
        warn('the convergence cannot be told: no drop came to rest in an aspect')
    return True, found


def _drop(
    job: DropJob,
    workers: Workers,
    tally: Tally,
    progress: Callable[[int], None],
    stop: Interruption,
) -> None:
    """Make the drops, or those until somebody asks for an end; raises EngineError."""
    for first, end in tally.ranges:
        asked = dataclasses.replace(tally.run, first_drop=first, drops=end - first)
        with closing(drop_chunks(job, asked, workers, warn)) as steps:
            for step in steps:
                if isinstance(step, Future):
                    while not stop.asked and not wait([step], LOOK_PERIOD).done:
                        progress(tally.distribution.drops)
                else:
                    tally.add(step)
                    progress(tally.distribution.drops)
                if stop.asked or tally.over:
                    return


def warn(text: str) -> None:
    """Say it in a line on standard error."""
    print(f'warning: {text}', file=sys.stderr)
