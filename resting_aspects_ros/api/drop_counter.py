"""Make drops and count them as they come, until there are enough or somebody asks for an end."""

import dataclasses
from collections.abc import Sequence
from concurrent.futures import Future, wait
from contextlib import closing
from typing import TextIO

from resting_aspects_ros.api.convergence import REFINEMENT, Convergence, check_convergence
from resting_aspects_ros.api.output_files import write_poses
from resting_aspects_ros.cli.progress import DropProgress
from resting_aspects_ros.core.errors import warn
from resting_aspects_ros.core.poses import RestingPoses
from resting_aspects_ros.core.statistics.distribution import (
    Distribution,
    aspect_ids,
    count_poses,
    no_drops,
)
from resting_aspects_ros.core.statistics.history import History
from resting_aspects_ros.simulation.chunks import Workers, drop_chunks
from resting_aspects_ros.simulation.drop_job import DropJob
from resting_aspects_ros.simulation.interruption import Interruption
from resting_aspects_ros.simulation.run_description import RunDescription

# How often signals are checked, s.
LOOK_PERIOD = 0.1


class DropCounter:
    """The drops of a run made so far: counted, and written to CSV files.

    precision : at which to stop; 0: when all drops are made
    ranges : which drops they are, if they are not those from the run's first on
    """

    def __init__(
        self,
        distribution: Distribution,
        run: RunDescription,
        precision: float = 0.0,
        ranges: Sequence[tuple[int, int]] = (),
    ) -> None:
        self.distribution = distribution
        self.run = run
        self.precision = precision
        self.ranges = ranges or [(run.first_drop, run.end)]
        self.tables: list[TextIO] = []
        self.history = History(distribution.aspects)

    @property
    def over(self) -> bool:
        """All drops are made, or enough."""
        return self.distribution.stops(self.precision, self.run.drops)

    def drop(self, label: str, job: DropJob, workers: Workers, stop: Interruption) -> None:
        """Make the drops, or those until a signal comes, and show progress; raises EngineError."""
        with DropProgress(label, self.run.drops) as progress:
            for first, end in self.ranges:
                asked = dataclasses.replace(self.run, first_drop=first, drops=end - first)
                with closing(drop_chunks(job, asked, workers, warn)) as steps:
                    for step in steps:
                        if isinstance(step, Future):
                            while not stop.asked and not wait([step], LOOK_PERIOD).done:
                                progress.update(self.distribution.drops)
                        else:
                            self._count(step)
                            progress.update(self.distribution.drops)
                        if stop.asked or self.over:
                            break
                if stop.asked or self.over:
                    break
            progress.end(self.distribution.drops)

    def _count(self, poses: RestingPoses) -> None:
        aspects = self.distribution.aspects
        ids = aspect_ids(aspects, poses)
        self.history.add(ids)
        self.distribution += count_poses(aspects, poses, ids)
        for table in self.tables:
            write_poses(table, poses, ids)


def check_in_finer_steps(
    job: DropJob, workers: Workers, counter: DropCounter, stop: Interruption
) -> tuple[bool, Convergence | None]:
    """Make the same drops in finer steps: whether all were made, and what they show."""
    coarse = counter.distribution
    fine = dataclasses.replace(job, refinement=REFINEMENT * job.refinement)
    run = dataclasses.replace(
        counter.run, drops=coarse.drops, precision=0.0, time_step=fine.time_step
    )
    empty = no_drops(coarse.aspects, confidence=coarse.confidence)
    again = DropCounter(empty, run, ranges=() if counter.precision else counter.ranges)
    again.drop(f'{run.part} in finer steps', fine, workers, stop)
    if not again.over:
        return False, None
    found = check_convergence(coarse, again.distribution, run.time_step, run.seed)
    if found is None:
        warn('the convergence cannot be told: no drop came to rest in an aspect')
    return True, found
