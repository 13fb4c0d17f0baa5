"""The drops that the sections of the benchmark time."""

import time
from dataclasses import dataclass

import numpy as np
from validation.dropper import ROOT, SEED
from validation.trial import Trial

from resting_aspects_ros.api.conditions import shipped_surfaces
from resting_aspects_ros.part.library import PartLibrary
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.rotations import down_in_part
from resting_aspects_ros.simulation.job import BULLET, KERNEL, DropJob, make_job
from resting_aspects_ros.simulation.workers import LocalWorkers, drop_range, submit_drops
from resting_aspects_ros.statistics.poses import RestingPoses, RestStatus

EXAMPLE = 'l_bracket'
SETTLED = RestStatus.SETTLED
# Drops of which the processor time of one is the mean.
COST_DROPS = {KERNEL: 4000, BULLET: 250}


@dataclass(frozen=True)
class Cost:
    """Processor time of a drop, ms, its simulated time, T, and the share that came to rest."""

    milliseconds: float
    simulated: float
    settled: float


def example_part(name: str = EXAMPLE) -> Part:
    """Return an example part."""
    return PartLibrary(ROOT / 'config' / 'parts').load(name)


def job_of(part: Part, surface: str = 'rubber_mat', engine: str = KERNEL) -> DropJob:
    """Return the job of a part on a surface."""
    return make_job(part, shipped_surfaces().get(surface), SEED, engine=engine)


def suite(workers: LocalWorkers, job: DropJob, first: int, drops: int) -> Trial:
    """Simulate drops as the commands do."""
    started = time.perf_counter()
    futures = submit_drops(job, first, drops, workers)
    poses = RestingPoses.join([future.result() for future in futures])
    seconds = time.perf_counter() - started
    return Trial(drops, seconds, down_in_part(poses.orientation[poses.status == SETTLED]))


def cost(job: DropJob) -> Cost:
    """Return what a drop costs in one thread."""
    drops = COST_DROPS[job.engine]
    drop_range(job, 0, 1)
    started = time.process_time()
    poses = drop_range(job, 0, drops)
    seconds = time.process_time() - started
    simulated = float(np.nanmean(poses.time_to_rest)) / job.time_unit
    return Cost(1000 * seconds / drops, simulated, float((poses.status == SETTLED).mean()))
