"""A process that reads files and computes for a node, so that neither can block or end it."""

import os
import resource
import signal
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from multiprocessing import get_context, parent_process, resource_tracker
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from pathlib import Path
from typing import Any, TypeVar

from rclpy.node import Node

from resting_aspects_ros.errors import RestingAspectsError
from resting_aspects_ros.ros.callbacks import await_future

T = TypeVar('T')

# Limits for one function: processor time, s, and memory in addition to that of the process, bytes.
MAX_SECONDS = 30.0
MAX_MEMORY = 2 * 1024**3
# Maximum processor time for loading Python and its modules, s.
MAX_START = 120.0
# How often a function is started whose process dies or hangs.
ATTEMPTS = 3
# How often the processor time is read, s.
CHECK_PERIOD = 1.0


class FileLimitError(RestingAspectsError):
    """A function takes too long, needs too much memory, fails, hangs, or ends its process."""


class FileWorker:
    """Runs functions one at a time in a spawned process, with limits of time and memory.

    A process that exceeds a limit, hangs, or dies is replaced. If it died or hung, the function
    runs again in the new process, at most ATTEMPTS times; then only this function fails.

    Parameters
    ----------
    seconds : float
        Limit of the processor time of each function, s. A function that sleeps for so long hangs.
    memory : int
        Memory that a function may allocate, bytes.
    """

    def __init__(self, node: Node, seconds: float = MAX_SECONDS, memory: int = MAX_MEMORY) -> None:
        self._node = node
        self._seconds = seconds
        self._memory = memory
        self._thread = ThreadPoolExecutor(1, 'file_worker')
        self._process: SpawnProcess | None = None
        self._connection: Connection | None = None
        self._stopped = False

    async def run(self, function: Callable[..., T], *arguments: Any) -> T:
        """Return the result of a module-level function, or raise its RestingAspectsError.

        Raises FileLimitError for any other exception of the function.
        """
        future = self._thread.submit(self._call, function, arguments)
        result: T = await await_future(self._node, future)
        return result

    def stop(self) -> None:
        """End the process and abandon the function that it runs."""
        self._stopped = True
        if (process := self._process) is not None:
            process.kill()
        self._thread.shutdown(wait=False, cancel_futures=True)

    def _call(self, function: Callable[..., T], arguments: tuple[Any, ...]) -> T:
        """Run the function in the process until it has a result; runs in the thread."""
        failure = 'the node ends'
        for _ in range(ATTEMPTS):
            if self._stopped:
                break
            try:
                outcome = self._attempt(function, arguments)
            except FileLimitError:
                self._replace()
                raise
            except TimeoutError:
                failure = f'the worker process hung {ATTEMPTS} times'
            except (EOFError, OSError):
                failure = f'the worker process died {ATTEMPTS} times'
            else:
                if isinstance(outcome, BaseException):
                    raise outcome
                result: T = outcome
                return result
            self._replace()
        raise FileLimitError(failure)

    def _attempt(self, function: Callable[..., Any], arguments: tuple[Any, ...]) -> Any:
        """Send the function to the process and return its result or its exception."""
        connection = self._ready()
        connection.send((function, arguments))
        self._receive(connection, MAX_START)  # until its module is imported
        return self._receive(connection, self._seconds)

    def _receive(self, connection: Connection, seconds: float) -> Any:
        """Return what the process sends next.

        Raises FileLimitError if it needs more processor time than ``seconds``, and TimeoutError
        if it sleeps for so long. On a busy machine, it waits for a processor instead.
        """
        assert self._process is not None
        start = used = _activity(self._process)[0]
        asleep = 0.0
        while not connection.poll(CHECK_PERIOD):
            before = used
            used, sleeps = _activity(self._process)
            asleep = asleep + CHECK_PERIOD if sleeps and used == before else 0.0
            if used - start > seconds:
                raise FileLimitError(f'the limit of {seconds:g} s of processor time was exceeded')
            if asleep >= seconds:
                raise TimeoutError
        return connection.recv()

    def _ready(self) -> Connection:
        """Return the connection to a running process."""
        if self._process is not None and not self._process.is_alive():
            self._replace()  # it was killed between two functions
        if self._connection is not None:
            return self._connection
        # The process inherits the blocked signal: Ctrl-C in a terminal reaches it too, but the
        # node ends it. The resource tracker, which starts with the first process, would unblock
        # the signal; therefore it starts before.
        resource_tracker.ensure_running()
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        context = get_context('spawn')
        ours, theirs = context.Pipe()
        process = context.Process(target=_serve, args=(theirs, self._memory), daemon=True)
        process.start()
        self._process = process
        theirs.close()  # otherwise the end of the process would not be detected
        self._connection = ours
        if self._stopped:  # before the process existed
            raise EOFError
        self._receive(ours, MAX_START)
        return ours

    def _replace(self) -> None:
        """End the process; the next function starts a new one."""
        if self._process is not None:
            self._process.kill()
            self._process.join(1.0)
        if self._connection is not None:
            self._connection.close()
        self._process = self._connection = None


def _activity(process: SpawnProcess) -> tuple[float, bool]:
    """Return the processor time of a process, s, and whether it sleeps."""
    fields = Path(f'/proc/{process.pid}/stat').read_text().rpartition(')')[2].split()
    ticks = int(fields[11]) + int(fields[12])
    return ticks / os.sysconf('SC_CLK_TCK'), fields[0] == 'S'


def _serve(connection: Connection, memory: int) -> None:
    """Run the received functions until the node closes the connection; runs in the process."""
    threading.Thread(target=_end_with_parent, daemon=True).start()
    connection.send(None)
    while True:
        try:
            function, arguments = connection.recv()
        except EOFError:
            return
        connection.send(None)
        _limit_memory(memory)
        try:
            outcome: Any = function(*arguments)
        except RestingAspectsError as error:
            outcome = error
        except MemoryError:
            outcome = FileLimitError(
                f'the memory limit of {memory / 1024**2:.0f} MiB was exceeded'
            )
        except Exception as error:  # noqa: BLE001 - other functions must still run
            outcome = FileLimitError(f'unexpected error {error!r:.300}')
        connection.send(outcome)


def _limit_memory(memory: int) -> None:
    """Limit the memory to a number of bytes above the currently mapped size."""
    pages = int(Path('/proc/self/statm').read_text().split()[0])
    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    limit = pages * resource.getpagesize() + memory
    if hard != resource.RLIM_INFINITY:
        limit = min(limit, hard)
    resource.setrlimit(resource.RLIMIT_AS, (limit, hard))


def _end_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
