"""Drops on a Dask cluster: the only module that imports distributed, an optional dependency."""

import asyncio
import logging
from concurrent.futures import Future
from importlib.metadata import version
from typing import Any, TypeVar

from resting_aspects_ros import __version__
from resting_aspects_ros.core.errors import EngineError, InvalidValueError
from resting_aspects_ros.core.poses import RestingPoses
from resting_aspects_ros.simulation.drop_job import DropJob

# Timeout for the scheduler to answer, and again for the first worker to connect, s.
TIMEOUT = 4.0

T = TypeVar('T')


class ClusterWorkers:
    """The workers of a Dask cluster, whose number may change at any time; implements Workers.

    The scheduler assigns the chunks of a worker that dies to other workers. If no worker is left,
    the drops wait for new ones.

    scheduler : str
        Address of the scheduler, such as ``tcp://10.0.0.5:8786``.

    Raises
    ------
    InvalidValueError
        If distributed is not installed, or if the address has no scheduler with workers.
    """

    def __init__(self, scheduler: str) -> None:
        self._client = _connect(scheduler)
        self._count = self._counted_for = 0
        # With pure=True, Dask would return the failure of an identical task of another client.
        self._executor = self._client.get_executor(pure=False)
        self._job: DropJob | None = None
        self._remote_job: Any = None

    def lookahead(self) -> int:
        """Return two chunks for each connected worker."""
        # Counting takes a round trip to the scheduler, so it is not repeated for every chunk.
        if self._counted_for == 0:
            self._count = self._counted_for = max(1, len(self._client.nthreads()))
        self._counted_for -= 1
        return 2 * self._count

    def submit(self, job: DropJob, first: int, end: int) -> 'Future[Any]':
        """Submit a chunk to the cluster."""
        if job is not self._job:
            # The job is a task of its own, so that each worker receives it once. Unlike scattered
            # data, Dask creates it again when the workers that hold it die.
            self._job, self._remote_job = job, self._client.submit(_identity, job, pure=False)
        future: Future[Any] = self._executor.submit(_drop, self._remote_job, first, end)
        return future

    def result(self, future: 'Future[Any]') -> RestingPoses:
        """Return the poses of a chunk; EngineError if the worker has different versions."""
        poses, worker, versions = future.result()
        for name, here in worker_versions().items():
            if versions[name] != here:
                raise EngineError(
                    f'invalid worker {worker}: expected {name} {here}, not {versions[name]}'
                )
        chunk: RestingPoses = poses
        return chunk

    def deaths(self, error: Exception) -> int:
        """Return how many workers died with the same chunk before Dask gave up; otherwise 0."""
        from distributed.scheduler import KilledWorker

        return error.allowed_failures + 1 if isinstance(error, KilledWorker) else 0

    def stop(self) -> None:
        """Disconnect from the cluster, which cancels the chunks that were not started."""
        self._client.close(timeout=TIMEOUT)


def _identity(job: T) -> T:
    return job


def _drop(job: DropJob, first: int, end: int) -> tuple[RestingPoses, str, dict[str, str]]:
    """Return the poses of a chunk, the worker's address and its versions."""
    from distributed import get_worker

    from resting_aspects_ros.simulation.engine import drop_range

    return drop_range(job, first, end), get_worker().address, worker_versions()


def worker_versions() -> dict[str, str]:
    """Return the versions of the packages that affect the poses, in this process."""
    return {
        'resting_aspects_ros': __version__,
        'numba': version('numba'),
        'pybullet': version('pybullet'),
        'numpy': version('numpy'),
    }


def _connect(scheduler: str) -> Any:
    """Return a client of a scheduler that has workers; raises InvalidValueError."""
    try:
        from distributed import Client
    except ImportError:
        raise InvalidValueError(
            f'scheduler {scheduler!r} needs Dask, which is not installed: pip install distributed'
        ) from None
    # This function reports connection errors itself, so the log messages are silenced.
    for name in ('distributed', 'distributed.client', 'tornado.application'):
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    try:
        # A Client that connects to anything but a scheduler prints a traceback; this call does
        # not.
        role = asyncio.run(asyncio.wait_for(_role(scheduler), TIMEOUT))
        if role != 'Scheduler':
            raise InvalidValueError(f'this is a {role.lower()}')
        client = Client(scheduler, timeout=TIMEOUT, set_as_default=False)
    except Exception as error:  # noqa: BLE001 - the address may belong to any kind of server
        reason = str(error) or f'no answer within {TIMEOUT:g} s'
        raise InvalidValueError(
            f'invalid scheduler {scheduler!r}: expected the address of a Dask scheduler; {reason}'
        ) from None
    try:
        client.wait_for_workers(1, timeout=TIMEOUT)
    except asyncio.TimeoutError:
        client.close(timeout=TIMEOUT)
        raise InvalidValueError(
            f'invalid scheduler {scheduler!r}: expected a scheduler that has workers; none '
            f'connected within {TIMEOUT:g} s'
        ) from None
    return client


async def _role(address: str) -> str:
    """Return the type of the Dask server at an address: Scheduler, Worker or Nanny."""
    from distributed import Security, rpc

    credentials = Security().get_connection_args('client')
    async with rpc(address, connection_args=credentials) as server:
        return str((await server.identity())['type'])
