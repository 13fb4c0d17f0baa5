"""Worker processes on this machine, for Bullet, which makes one drop after the other.

The parent sends (job or None, first drop, end), where None means the job that was sent before. A
worker replies with the resting poses or the exception. It exits when its parent exits.
"""

import os
import pickle
import signal
import socket
import sys
import threading
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from importlib import import_module
from multiprocessing.connection import Connection
from queue import SimpleQueue
from subprocess import DEVNULL, Popen, TimeoutExpired

from resting_aspects_ros.core.errors import EngineError
from resting_aspects_ros.core.poses import RestingPoses
from resting_aspects_ros.simulation.drop_job import DropJob

# A worker uses its parent's import path, independent of the content of the working directory.
_PROGRAM = (
    'import sys; sys.path[:] = sys.argv[2:]; '
    'from resting_aspects_ros.simulation.process_workers import serve; serve(int(sys.argv[1]))'
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
