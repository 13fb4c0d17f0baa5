"""The suite's own drops, timed from the process that takes the poses."""

import time
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from bench_case import Trial

from resting_aspects_ros.core.poses import DecidedBy, RestingPoses, RestStatus
from resting_aspects_ros.core.rotations import down_in_part
from resting_aspects_ros.simulation.chunks import submit_drops
from resting_aspects_ros.simulation.drop_job import DropJob
from resting_aspects_ros.simulation.initial_state import CHUNK, initial_states
from resting_aspects_ros.simulation.local_workers import LocalWorkers
from resting_aspects_ros.simulation.settling import REST_WINDOW

# Chunks per worker.
_WARM_UP = 10


@contextmanager
def running_workers(count: int, job: DropJob) -> Iterator[LocalWorkers]:
    """Yield worker processes that have all imported their modules."""
    workers = LocalWorkers(count)
    try:
        # More chunks than one worker can simulate while another one starts.
        for future in submit_drops(job, 0, _WARM_UP * count * CHUNK, workers):
            future.result()
        yield workers
    finally:
        workers.stop()


def suite(workers: LocalWorkers, job: DropJob, chunks: range) -> Trial:
    """Simulate the drops of some chunks, as the commands do."""
    first, drops = chunks.start * CHUNK, len(chunks) * CHUNK
    started = time.perf_counter()
    futures = submit_drops(job, first, drops, workers)
    poses = RestingPoses.join([future.result() for future in futures])
    seconds = time.perf_counter() - started
    settled = poses.status == RestStatus.SETTLED
    down = down_in_part(poses.orientation[settled])
    return Trial(drops, seconds, float(simulated(job, poses).sum() * job.steps_per_t), down)


def simulated(job: DropJob, poses: RestingPoses) -> np.ndarray:
    """Return the simulated times, (n,), T: without the free fall, with the rest window."""
    numbers = range(poses.first_drop // CHUNK, (poses.first_drop + len(poses) - 1) // CHUNK + 1)
    left_out = np.concatenate([initial_states(job, chunk).elapsed for chunk in numbers])
    begin = poses.first_drop - numbers.start * CHUNK
    still = (poses.decided_by == DecidedBy.STILLNESS) & (poses.status == RestStatus.SETTLED)
    times = poses.time_to_rest / job.time_unit - left_out[begin : begin + len(poses)]
    return np.nan_to_num(times) + REST_WINDOW * still
