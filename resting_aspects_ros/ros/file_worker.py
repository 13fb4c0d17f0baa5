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

from resting_aspects_ros.core.errors import RestingAspectsError
from resting_aspects_ros.ros.callbacks import await_future

T = TypeVar('T')

# Limits for one function: time, s, and memory in addition to that of the process, bytes.
MAX_SECONDS = 30.0
MAX_MEMORY = 2 * 1024**3
# Timeout for loading Python and its modules; sufficient on a very busy machine, s.
START_TIMEOUT = 120.0


class FileLimitError(RestingAspectsError):
    """A function takes too long, needs too much memory, fails, or ends its process."""


class FileWorker:
    """Runs functions one at a time in a spawned process, with limits of time and memory.

    A process that exceeds a limit, or dies, is replaced; only the function that it ran fails.

    Parameters
    ----------
    seconds : float
        Time limit of each function, s.
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
        """Send the function to the process and wait for its result; runs in the thread."""
        try:
            connection = self._ready()
            connection.send((function, arguments))
            if not connection.poll(START_TIMEOUT):  # until its module is imported
                raise EOFError
            connection.recv()
            if not connection.poll(self._seconds):
                raise FileLimitError(f'the time limit of {self._seconds:g} s was exceeded')
            outcome = connection.recv()
        except (EOFError, OSError):
            self._replace()
            raise FileLimitError('the worker process died') from None
        except FileLimitError:
            self._replace()
            raise
        if isinstance(outcome, BaseException):
            raise outcome
        result: T = outcome
        return result

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
        # stop() may have been called before the process existed.
        if self._stopped or not ours.poll(START_TIMEOUT):
            raise EOFError
        ours.recv()
        self._connection = ours
        return ours

    def _replace(self) -> None:
        """End the process; the next function starts a new one."""
        if self._process is not None:
            self._process.kill()
            self._process.join(1.0)
        if self._connection is not None:
            self._connection.close()
        self._process = self._connection = None


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
