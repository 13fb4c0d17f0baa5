"""Workers that simulate chunks of drops: threads, processes, or a Dask cluster."""

import asyncio
import logging
import os
import pickle
import signal
import socket
import sys
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor
from contextlib import suppress
from importlib import import_module
from importlib.metadata import version
from itertools import islice
from multiprocessing.connection import Connection
from queue import SimpleQueue
from subprocess import DEVNULL, Popen, TimeoutExpired
from typing import Any, Protocol, TypeVar

from resting_aspects_ros import __version__
from resting_aspects_ros.errors import EngineError, InvalidValueError
from resting_aspects_ros.simulation.engine import drop_range
from resting_aspects_ros.simulation.job import BULLET, DropJob, RunDescription
from resting_aspects_ros.statistics.intervals import checkpoints
from resting_aspects_ros.statistics.poses import RestingPoses

# -- Chunks ---------------------------------------------------------------------------------------


# A run fails when this many workers died without a chunk being returned in between.
MAX_DEATHS = 3


class Workers(Protocol):
    """Workers that simulate chunks: those of this machine, or a cluster."""

    def lookahead(self) -> int:
        """Return how many chunks should be pending, so that no worker is idle."""

    def submit(self, job: DropJob, first: int, end: int) -> 'Future[Any]':
        """Start the simulation of the drops ``first`` to ``end - 1``."""

    def result(self, future: 'Future[Any]') -> RestingPoses:
        """Return the poses of a submitted chunk, or raise the error of its worker."""

    def deaths(self, error: Exception) -> int:
        """Return how many workers died if the error reports it, otherwise 0."""


class DeathCount:
    """Deaths of workers in a row: what died is repeated, until there are too many of them."""

    def __init__(self) -> None:
        self._count = 0

    def reset(self) -> None:
        """A chunk was returned."""
        self._count = 0

    def repeat(self, workers: Workers, error: Exception, where: str) -> str:
        """Return a warning if the error means that a worker died, so that a chunk is repeated.

        Raises EngineError if the error has another reason, or if MAX_DEATHS workers died in a
        row. ``where`` completes the messages, such as 'near drop 250 of l_bracket'.
        """
        if isinstance(error, CancelledError):
            raise EngineError(f'the workers became unavailable {where}') from None
        died = workers.deaths(error)
        self._count += died
        if died == 0:
            if isinstance(error, EngineError):
                raise error
            raise EngineError(f'a worker failed {where}: {error!r}') from error
        if self._count >= MAX_DEATHS:
            raise EngineError(f'{self._count} worker processes died in a row {where}') from None
        return f'a worker died {where}: its drops are repeated'


def chunk_bounds(
    job: DropJob, first: int, end: int, cuts: Sequence[int] = ()
) -> Iterator[tuple[int, int]]:
    """Yield the chunks [first, end) of a range of drops: as many as a worker makes at once.

    They begin at multiples of that number, and at the ``cuts``.
    """
    while first < end:
        ends = [end, (first // job.chunk + 1) * job.chunk, *(cut for cut in cuts if cut > first)]
        stop = min(ends)
        yield first, stop
        first = stop


def submit_drops(
    job: DropJob, first_drop: int, drops: int, workers: Workers, cuts: Sequence[int] = ()
) -> Generator['Future[Any]', None, None]:
    """Yield futures of consecutive chunks in order, with ``lookahead()`` chunks pending.

    Memory does not grow with the number of drops: a chunk is submitted only after an earlier one
    was yielded. Closing the iterator cancels the chunks that were not started.
    """
    pending: deque[Future[Any]] = deque()
    chunks = chunk_bounds(job, first_drop, first_drop + drops, cuts)
    try:
        while True:
            for chunk in islice(chunks, max(1, workers.lookahead()) - len(pending)):
                pending.append(workers.submit(job, *chunk))
            if not pending:
                return
            yield pending.popleft()
    finally:
        for future in pending:
            future.cancel()


def drop_chunks(
    job: DropJob, run: RunDescription, workers: Workers, warn: Callable[[str], None]
) -> Generator['Future[RestingPoses] | RestingPoses', None, None]:
    """Yield the chunks of a run in ascending order, each after its future.

    The caller can wait for the future in its own way, for example in the event loop of a node. A
    caller that does not wait is blocked until the chunk is done. When a worker dies, the chunks
    that were not yielded are simulated again and ``warn`` is called with a message. The result is
    the same as without the failure, because poses depend only on the job and the index.

    Raises
    ------
    EngineError
        If a worker fails, or if MAX_DEATHS workers die in a row, which indicates a problem with
        the drops or the machine. The chunks yielded before remain valid.
    """
    first, deaths = run.first_drop, DeathCount()
    # A run ends at one of them, so no drop is made in vain.
    cuts = checkpoints(run.drops) if run.precision else []
    while first < run.end:
        futures = submit_drops(job, first, run.end - first, workers, cuts)
        try:
            for future in futures:
                yield future
                chunk = workers.result(future)
                first = chunk.end
                deaths.reset()
                yield chunk
        except Exception as error:  # noqa: BLE001 - raised again unless a worker died
            warn(deaths.repeat(workers, error, _near(first, run)))
        finally:
            futures.close()


def _near(drop: int, run: RunDescription) -> str:
    return f'near drop {drop} of {run.part}'


# -- Processes ------------------------------------------------------------------------------------


# A worker uses its parent's import path, independent of the content of the working directory.
_PROGRAM = (
    'import sys; sys.path[:] = sys.argv[2:]; '
    'from resting_aspects_ros.simulation.workers import serve; serve(int(sys.argv[1]))'
)
# Workers run at lower priority than other processes of this machine.
NICENESS = 5
_ENGINE = 'resting_aspects_ros.simulation.bullet_engine'
# The parent handles these signals. Workers block them, because a terminal sends them to all of
# its processes.
_PARENTS_SIGNALS = {signal.SIGINT, signal.SIGTERM, signal.SIGHUP}
# Timeout for a killed process to end, s. It ends at once unless the system is holding it.
_END_TIMEOUT = 5.0


class WorkerDiedError(EngineError):
    """The process that simulated a chunk has ended."""


class ProcessWorkers:
    """Worker processes, each with its own connection.

    When a worker dies, its chunk fails and the worker is replaced; one that died while it was idle
    is replaced before its next chunk. The other workers are not affected, because they share no
    lock and no pipe with it.

    count : int
        Number of processes.
    replaced : int
        Number of processes that died and were replaced.

    Raises
    ------
    EngineError
        If the system cannot start a process.
    """

    def __init__(self, count: int) -> None:
        self.count = count
        self.replaced = 0
        self._threads = ThreadPoolExecutor(count, thread_name_prefix='drops')
        self._idle: SimpleQueue[_Worker] = SimpleQueue()
        self._workers: set[_Worker] = set()
        self._lock = threading.Lock()
        self._stopped = False
        try:
            for _ in range(count):
                self._idle.put(self._start())
        except BaseException:
            self.stop()
            raise

    def submit(self, job: DropJob, first: int, end: int) -> 'Future[RestingPoses]':
        """Submit a chunk, which is simulated as soon as a process is idle."""
        return self._threads.submit(self._drop, job, first, end)

    def stop(self) -> None:
        """End the processes; unfinished chunks are discarded."""
        with self._lock:
            self._stopped = True
            workers, self._workers = self._workers, set()
        for worker in workers:
            worker.kill()
        # No thread waits for a process any more, because the connections are shut down.
        self._threads.shutdown(cancel_futures=True)
        for worker in workers:
            worker.wait()

    def _drop(self, job: DropJob, first: int, end: int) -> RestingPoses:
        worker = self._idle.get()
        try:
            if worker.has_ended():  # while it was idle, which says nothing about this chunk
                worker = self._replaced(worker)
            return worker.drop(job, first, end)
        except WorkerDiedError:
            worker = self._replaced(worker)
            raise
        finally:
            self._idle.put(worker)

    def _replaced(self, worker: '_Worker') -> '_Worker':
        """End a worker and return a new one."""
        with self._lock:
            self._workers.discard(worker)
            self.replaced += 1
        worker.kill()
        worker.wait()
        return self._start()

    def _start(self) -> '_Worker':
        with self._lock:
            if self._stopped:
                raise WorkerDiedError('the workers were stopped')
            try:
                worker = _Worker()
            except OSError as error:
                raise EngineError(f'cannot start a worker process: {error.strerror}') from None
            self._workers.add(worker)
            return worker


class _Worker:
    """A process that runs `serve`; it imports the engine before the first chunk arrives."""

    def __init__(self) -> None:
        self._job: DropJob | None = None
        self._socket, theirs = socket.socketpair()
        self._connection = Connection(os.dup(self._socket.fileno()))
        # A process inherits the signal mask of its parent.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, _PARENTS_SIGNALS)
        try:
            with theirs:
                self._process = Popen(
                    [sys.executable, '-c', _PROGRAM, str(theirs.fileno()), *sys.path],
                    pass_fds=[theirs.fileno()],
                    stdin=DEVNULL,
                    # Bullet prints to standard output.
                    stdout=DEVNULL,
                )
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)

    def drop(self, job: DropJob, first: int, end: int) -> RestingPoses:
        """Simulate a chunk; raises WorkerDiedError, or the exception of the worker."""
        try:
            # The job is sent only once, because it may be large and the engine caches its shape.
            self._connection.send((None if job is self._job else job, first, end))
            self._job = job
            answer = self._connection.recv()
        except (EOFError, OSError):
            raise WorkerDiedError('a worker process died') from None
        if isinstance(answer, Exception):
            raise answer
        poses: RestingPoses = answer
        return poses

    def has_ended(self) -> bool:
        """Return whether the process has ended."""
        return self._process.poll() is not None

    def kill(self) -> None:
        """Kill the process and shut down the connection, which ends all waiting for it."""
        with suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)
        self._process.kill()

    def wait(self) -> None:
        """Wait until a killed process has ended, or until the timeout, and release its socket."""
        with suppress(TimeoutExpired):
            self._process.wait(_END_TIMEOUT)
        self._socket.close()


def serve(descriptor: int) -> None:
    """Serve the connection with this file descriptor; never returns."""
    os.nice(NICENESS)
    connection = Connection(descriptor)
    tasks: SimpleQueue[bytes] = SimpleQueue()
    threading.Thread(target=_receive, args=(connection, tasks), daemon=True).start()
    with suppress(Exception):
        # Import the engine before the first task arrives. A failure is raised again by the task.
        import_module(_ENGINE)
    job = None
    while True:
        task = tasks.get()
        try:
            sent_job, first, end = pickle.loads(task)  # noqa: S301 - from the parent
            job = job if sent_job is None else sent_job
            answer: object = import_module(_ENGINE).drop_range(job, first, end)
        except Exception as error:  # noqa: BLE001 - the parent reports it
            answer = error
        connection.send(answer)


def _receive(connection: Connection, tasks: 'SimpleQueue[bytes]') -> None:
    """Queue incoming tasks, and exit when the parent exits, even in the middle of a chunk."""
    try:
        while True:
            tasks.put(connection.recv_bytes())
    except (EOFError, OSError):
        os._exit(0)


# -- This machine ---------------------------------------------------------------------------------


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


# -- A cluster ------------------------------------------------------------------------------------


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
