"""The suite's own drops, timed from the process that takes the poses."""

import os
import time
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager

import numpy as np
from bench_case import Trial

from resting_aspects_ros.core.poses import DecidedBy, RestingPoses, RestStatus
from resting_aspects_ros.core.rotations import down_in_part
from resting_aspects_ros.drops.campaign import submit_drops
from resting_aspects_ros.drops.job import DropJob
from resting_aspects_ros.drops.release import CHUNK, releases
from resting_aspects_ros.drops.settling import REST_WINDOW
from resting_aspects_ros.drops.worker_pool import make_pool, stop_pool

# For so long a worker is busy that says who it is, s, so that another has to say it, too.
_BUSY = 0.05


@contextmanager
def begun_pool(workers: int) -> Iterator[ProcessPoolExecutor]:
    """Worker processes that have all read their modules."""
    pool = make_pool(workers)
    try:
        seen: set[int] = set()
        while len(seen) < workers:
            seen |= {answer.result() for answer in [pool.submit(_who) for _ in range(workers)]}
        yield pool
    finally:
        stop_pool(pool)


def suite(executor: Executor, workers: int, job: DropJob, chunks: range) -> Trial:
    """Make the drops of some chunks, as the commands do."""
    first, drops = chunks.start * CHUNK, len(chunks) * CHUNK
    begun = time.perf_counter()
    futures = submit_drops(job, first, drops, executor, lambda: 2 * workers)
    poses = RestingPoses.join([future.result() for future in futures])
    seconds = time.perf_counter() - begun
    settled = poses.status == RestStatus.SETTLED
    down = down_in_part(poses.orientation[settled])
    return Trial(drops, seconds, float(simulated(job, poses).sum() * job.steps_per_t), down)


def simulated(job: DropJob, poses: RestingPoses) -> np.ndarray:
    """(n,) times that were simulated, T: without the fall, with the wait for stillness."""
    numbers = range(poses.first_drop // CHUNK, (poses.first_drop + len(poses) - 1) // CHUNK + 1)
    left_out = np.concatenate([releases(job, chunk).elapsed for chunk in numbers])
    begin = poses.first_drop - numbers.start * CHUNK
    still = (poses.decided_by == DecidedBy.STILLNESS) & (poses.status == RestStatus.SETTLED)
    times = poses.time_to_rest / job.time_unit - left_out[begin : begin + len(poses)]
    return np.nan_to_num(times) + REST_WINDOW * still


def _who() -> int:
    time.sleep(_BUSY)
    return os.getpid()
