"""Workers that simulate chunks of drops: threads, processes, or a Dask cluster."""

import asyncio
import logging
import os
import sys
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    CancelledError,
    Future,
    ThreadPoolExecutor,
    wait,
)
from contextlib import closing, suppress
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from itertools import islice
from multiprocessing.connection import Connection, Pipe
from subprocess import DEVNULL, Popen, TimeoutExpired
from typing import Any, Protocol, TypeVar

from resting_aspects_ros import __version__
from resting_aspects_ros.errors import EngineError, InvalidValueError
from resting_aspects_ros.simulation.conditions import BULLET
from resting_aspects_ros.simulation.job import CHUNKS, DropJob, RunDescription
from resting_aspects_ros.statistics.intervals import checkpoints
from resting_aspects_ros.statistics.poses import RestingPoses
from resting_aspects_ros.system import blocked_signals

# -- Chunks ---------------------------------------------------------------------------------------


# How often a caller that waits for calls is asked whether it goes on, s.
WAIT = 0.1


T = TypeVar('T')


class WorkerDiedError(EngineError):
    """A process that simulated a chunk has ended."""


class Workers(Protocol):
    """Workers that simulate chunks: those of this machine, or a cluster."""

    def lookahead(self) -> int:
        """Return how many chunks should be pending, so that no worker is idle."""

    def submit(self, job: DropJob, first: int, end: int) -> 'Future[RestingPoses]':
        """Start the simulation of the drops ``first`` to ``end - 1``."""

    def call(self, function: Callable[..., T], *args: Any) -> 'Future[T]':
        """Start a function of a module, which can use Bullet, in a process of a worker."""


def drop_range(job: DropJob, first: int, end: int) -> RestingPoses:
    """Simulate the drops ``first`` to ``end - 1`` until they end, in the engine of the job.

    The pose of a drop depends only on the job and its index. Several threads can make drops of the
    kernel at the same time.
    """
    if not 0 <= first < end:
        raise ValueError(f'invalid drops {first} to {end - 1}: expected one or more from 0')
    # An engine is imported only if it is needed.
    if job.engine == BULLET:
        from resting_aspects_ros.simulation import bullet_engine

        return bullet_engine.drop_range(job, first, end)
    from resting_aspects_ros.simulation import kernel_engine

    return kernel_engine.drop_range(job, first, end)


def chunk_bounds(
    job: DropJob, first: int, end: int, cuts: Sequence[int] = ()
) -> Iterator[tuple[int, int]]:
    """Yield the chunks [first, end) of a range of drops: as many as a worker makes at once.

    They begin at multiples of that number, and at the ``cuts``.
    """
    size = CHUNKS[job.engine]
    while first < end:
        stop = min(end, (first // size + 1) * size, *(cut for cut in cuts if cut > first))
        yield first, stop
        first = stop


def submit_drops(
    job: DropJob, first_drop: int, drops: int, workers: Workers, cuts: Sequence[int] = ()
) -> Generator['Future[RestingPoses]', None, None]:
    """Yield futures of consecutive chunks in order, with ``lookahead()`` chunks pending.

    Memory does not grow with the number of drops: a chunk is submitted only after an earlier one
    was yielded. Closing the iterator cancels the chunks that were not started.
    """
    pending: deque[Future[RestingPoses]] = deque()
    chunks = chunk_bounds(job, first_drop, first_drop + drops, cuts)
    try:
        while True:
            for chunk in islice(chunks, max(0, max(1, workers.lookahead()) - len(pending))):
                pending.append(workers.submit(job, *chunk))
            if not pending:
                return
            yield pending.popleft()
    finally:
        for future in pending:
            future.cancel()


def drop_chunks(
    job: DropJob, run: RunDescription, workers: Workers
) -> Generator['Future[RestingPoses] | RestingPoses', None, None]:
    """Yield the chunks of a run in ascending order, each after its future.

    The caller can wait for the future in its own way, for example in the event loop of a node. A
    caller that does not wait is blocked until the chunk is done. Raises EngineError if a worker
    fails; the chunks yielded before remain valid.
    """
    # A run ends at one of them, so no drop is made in vain.
    cuts = checkpoints(run.drops) if run.precision else []
    first = run.first_drop
    with closing(submit_drops(job, first, run.drops, workers, cuts)) as futures:
        for future in futures:
            yield future
            poses = _result(future, f'near drop {first} of {run.part}')
            yield poses
            first += len(poses)


def call_each(
    workers: Workers,
    function: Callable[..., T],
    values: Sequence[tuple[Any, ...]],
    where: str,
    waiting: Callable[[int], None],
) -> list[T]:
    """Call a function of a module with each of some arguments in workers; return the results.

    Calls that were not started are discarded at an error. Raises EngineError if a worker fails.

    where : str
        Where it fails, for errors, such as 'at a trap'.
    waiting : callable
        Called often with the number of calls that are done; an exception of it ends the work.
    """
    futures = [workers.call(function, *each) for each in values]
    try:
        pending = set(futures)
        while pending:
            done, pending = wait(pending, WAIT, FIRST_COMPLETED)
            for future in done:
                _result(future, where)
            waiting(len(futures) - len(pending))
        return [future.result() for future in futures]
    finally:
        for future in futures:
            future.cancel()


def _result(future: 'Future[T]', where: str) -> T:
    """Return the result of a future; raises EngineError."""
    try:
        return future.result()
    except CancelledError:
        raise EngineError(f'the workers became unavailable {where}') from None
    except WorkerDiedError as error:
        raise EngineError(f'{error} {where}') from None
    except EngineError:
        raise
    except Exception as error:
        raise EngineError(f'a worker failed {where}: {error!r}') from error


# -- This machine ---------------------------------------------------------------------------------


MAX_WORKERS = 1024
# A chunk fails when this many processes died with it.
MAX_DEATHS = 3
# A worker process uses its parent's import path, independent of the content of the working
# directory.
_PROGRAM = (
    'import sys; sys.path[:] = sys.argv[2:]; '
    'from resting_aspects_ros.simulation.workers import serve; serve(int(sys.argv[1]))'
)
# Workers run at lower priority than other processes of this machine.
NICENESS = 5
_ENGINE = 'resting_aspects_ros.simulation.bullet_engine'
# Timeout for a killed process to end, s. It ends at once unless the system is holding it.
_END_TIMEOUT = 5.0


class LocalWorkers:
    """Threads that make drops in the kernel, or let a process of their own make them in Bullet.

    Implements Workers for any number of runs at the same time. When a process dies, its chunk is
    made again in another one, with the same result, because poses depend only on the job and the
    index. The other processes are not affected, because they share no lock and no pipe with it.

    count : int
        Number of threads, and maximum number of processes.

    Raises InvalidValueError if the count is out of bounds.
    """

    def __init__(self, count: int) -> None:
        if not 1 <= count <= MAX_WORKERS:
            raise InvalidValueError(f'invalid workers {count}: expected 1 to {MAX_WORKERS}')
        self.count = count
        self._threads = ThreadPoolExecutor(count, thread_name_prefix='drops')
        self._own = threading.local()  # the process of each thread
        self._processes: list[_Process] = []
        self._lock = threading.Lock()
        self._stopped = False

    @property
    def replaced(self) -> int:
        """Number of processes that died."""
        return sum(not process.alive for process in self._processes)

    def lookahead(self) -> int:
        """Return two chunks per worker: one that is simulated and one that is waiting."""
        return 2 * self.count

    def submit(self, job: DropJob, first: int, end: int) -> 'Future[RestingPoses]':
        """Submit a chunk, which is simulated as soon as a thread is idle."""
        if job.engine == BULLET:
            return self.call(drop_range, job, first, end)
        return self._threads.submit(drop_range, job, first, end)

    def call(self, function: Callable[..., T], *args: Any) -> 'Future[T]':
        """Call a function of a module in the process of a thread, as soon as one is idle."""
        return self._threads.submit(self._call, function, *args)

    def _call(self, function: Callable[..., T], *args: Any) -> T:
        for _ in range(MAX_DEATHS):
            with suppress(WorkerDiedError):
                return self._process().call(function, *args)
        raise WorkerDiedError(f'{MAX_DEATHS} worker processes died in a row')

    def stop(self) -> None:
        """End the workers; chunks that were not started are discarded."""
        with self._lock:
            self._stopped = True
        for process in self._processes:
            process.kill()
        # No thread waits for a process any more, because its end of the connection is closed.
        self._threads.shutdown(cancel_futures=True)
        for process in self._processes:
            process.wait()

    def _process(self) -> '_Process':
        """Return the process of this thread, which is started if there is none."""
        process: _Process | None = getattr(self._own, 'process', None)
        if process is None or not process.alive:
            with self._lock:
                if self._stopped:
                    raise WorkerDiedError('the workers were stopped')
                try:
                    process = self._own.process = _Process()
                except OSError as error:
                    raise EngineError(f'cannot start a worker process: {error.strerror}') from None
                self._processes.append(process)
        return process


class _Process:
    """A process that runs `serve`; it imports the engine before the first chunk arrives."""

    def __init__(self) -> None:
        if os.name != 'posix':
            raise EngineError('Bullet runs in processes that need Linux or macOS')
        self._connection, theirs = Pipe()
        # The parent handles the signals. A terminal sends them to all of its processes, and a
        # process inherits the signals that its parent blocks.
        with blocked_signals(), theirs:
            self._process = Popen(
                [sys.executable, '-c', _PROGRAM, str(theirs.fileno()), *sys.path],
                pass_fds=[theirs.fileno()],
                stdin=DEVNULL,
                # Bullet prints to standard output.
                stdout=DEVNULL,
            )

    def call(self, function: Callable[..., T], *args: Any) -> T:
        """Call a function; raises WorkerDiedError, or the exception of the process."""
        try:
            self._connection.send((function, args))
            answer = self._connection.recv()
        except (EOFError, OSError):
            self.kill()
            self.wait()
            raise WorkerDiedError('a worker process died') from None
        if isinstance(answer, Exception):
            raise answer
        result: T = answer
        return result

    @property
    def alive(self) -> bool:
        """Whether the process can simulate another chunk."""
        return self._process.poll() is None

    def kill(self) -> None:
        """Kill the process, which closes its end of the connection: nothing waits for it."""
        self._process.kill()

    def wait(self) -> None:
        """Wait until a killed process has ended, or until the timeout."""
        with suppress(TimeoutExpired):
            self._process.wait(_END_TIMEOUT)


def serve(descriptor: int) -> None:
    """Serve the connection with this file descriptor until the parent has ended."""
    if hasattr(os, 'nice'):
        os.nice(NICENESS)
    connection = Connection(descriptor)
    with suppress(Exception):
        # Import the engine before the first task arrives. A failure is raised again by the task.
        import_module(_ENGINE)
    with suppress(EOFError, OSError):
        while True:
            function, args = connection.recv()
            try:
                answer: object = function(*args)
            except Exception as error:  # noqa: BLE001 - the parent reports it
                answer = error
            connection.send(answer)


# -- A cluster ------------------------------------------------------------------------------------


# Timeout for the scheduler to answer, and again for the first worker to connect, s.
TIMEOUT = 4.0


class ClusterWorkers:
    """The workers of a Dask cluster, whose number may change at any time.

    Implements Workers for any number of runs at the same time.

    The scheduler assigns the chunks of a worker that dies to other workers. If no worker is left,
    the drops wait for new ones.

    scheduler : str
        Address of the scheduler, such as ``tcp://10.0.0.5:8786``.

    Raises InvalidValueError if distributed is not installed, or if the address has no scheduler
    with workers.
    """

    def __init__(self, scheduler: str) -> None:
        self._client = _connect(scheduler)
        # With pure=True, Dask would return the failure of an identical task of another client.
        self._executor = self._client.get_executor(pure=False)
        self._job: DropJob | None = None
        self._remote_job: Any = None
        self._lock = threading.Lock()

    def lookahead(self) -> int:
        """Return two chunks for each connected worker."""
        return 2 * len(self._client.nthreads())

    def submit(self, job: DropJob, first: int, end: int) -> 'Future[RestingPoses]':
        """Submit a chunk; it fails with EngineError if the worker has different versions."""
        with self._lock:  # several runs can submit at the same time
            if job is not self._job:
                # The job is a task of its own, so that each worker receives it once. Unlike
                # scattered data, Dask creates it again when the workers that hold it die.
                self._job, self._remote_job = job, self._client.submit(_identity, job, pure=False)
            remote = self._remote_job
        future: Future[RestingPoses] = self._executor.submit(
            _drop, remote, first, end, worker_versions()
        )
        return future

    def call(self, function: Callable[..., T], *args: Any) -> 'Future[T]':
        """Call a function of a module in a worker."""
        found: Future[T] = self._executor.submit(_call, function, args, worker_versions())
        return found

    def stop(self) -> None:
        """Disconnect from the cluster, which cancels the chunks that were not started."""
        self._client.close(timeout=TIMEOUT)


def _identity(job: T) -> T:
    return job


def _drop(job: DropJob, first: int, end: int, versions: dict[str, str]) -> RestingPoses:
    return _call(drop_range, (job, first, end), versions)


def _call(function: Callable[..., T], args: tuple[Any, ...], versions: dict[str, str]) -> T:
    """Call a function; EngineError if this worker has other versions."""
    from distributed import get_worker

    for name, here in worker_versions().items():
        expected = versions.get(name, 'not installed')
        if here != expected:
            raise EngineError(
                f'invalid worker {get_worker().address}: expected {name} {expected}, not {here}'
            )
    return function(*args)


def worker_versions() -> dict[str, str]:
    """Return the versions of the installed packages that affect the poses, in this process."""
    found = {'resting_aspects_ros': __version__}
    for name in ('numba', 'pybullet', 'numpy'):
        with suppress(PackageNotFoundError):
            found[name] = version(name)
    return found


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
