"""The workers of this machine: threads for the kernel, processes for Bullet."""

import os
import threading
from concurrent.futures import Future, ThreadPoolExecutor

from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.poses import RestingPoses
from resting_aspects_ros.simulation.drop_job import DropJob
from resting_aspects_ros.simulation.engine import drop_range
from resting_aspects_ros.simulation.process_workers import ProcessWorkers, WorkerDiedError
from resting_aspects_ros.simulation.run_description import BULLET

MAX_WORKERS = 1024


def default_workers() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0))


class LocalWorkers:
    """Threads that make drops in the kernel, and as many processes as soon as Bullet is needed.

    Implements Workers for any number of runs at the same time.

    count : int
        Number of threads, and of processes.

    Raises
    ------
    InvalidValueError
        If the count is out of bounds.
    """

    def __init__(self, count: int) -> None:
        if not 1 <= count <= MAX_WORKERS:
            raise InvalidValueError(f'invalid workers {count}: expected 1 to {MAX_WORKERS}')
        self.count = count
        self._threads = ThreadPoolExecutor(count, thread_name_prefix='drops')
        self._processes: ProcessWorkers | None = None
        self._lock = threading.Lock()

    @property
    def replaced(self) -> int:
        """Number of processes that died and were replaced."""
        return 0 if self._processes is None else self._processes.replaced

    def lookahead(self) -> int:
        """Return two chunks per worker: one that is simulated and one that is waiting."""
        return 2 * self.count

    def submit(self, job: DropJob, first: int, end: int) -> 'Future[RestingPoses]':
        """Submit a chunk; raises EngineError if a process cannot be started."""
        if job.engine != BULLET:
            return self._threads.submit(drop_range, job, first, end)
        with self._lock:
            if self._processes is None:
                self._processes = ProcessWorkers(self.count)
        return self._processes.submit(job, first, end)

    def result(self, future: 'Future[RestingPoses]') -> RestingPoses:
        """Return the poses of a chunk."""
        return future.result()

    def deaths(self, error: Exception) -> int:
        """Return 1 for the error of a process that died, otherwise 0."""
        return int(isinstance(error, WorkerDiedError))

    def stop(self) -> None:
        """End the workers; chunks that were not started are discarded."""
        if self._processes is not None:
            self._processes.stop()
        self._threads.shutdown(cancel_futures=True)
