"""A process that reads files and computes for a node, so that neither can block or end it."""

import math
import os
import resource
import signal
import threading
import time
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
# A function hangs if it takes so many times its limit; on a busy machine, it waits for a
# processor.
MAX_WAIT = 10
# How often a function is started whose process dies or hangs.
ATTEMPTS = 3


class FileLimitError(RestingAspectsError):
    """A function takes too long, needs too much memory, fails, hangs, or ends its process."""


class FileWorker:
    """Runs functions one at a time in a spawned process, with limits of time and memory.

    A process that exceeds a limit, hangs, or dies is replaced. If it died or hung, the function
    runs again in the new process, at most ATTEMPTS times; then only this function fails.

    Parameters
    ----------
    seconds : float
        Limit of the processor time of each function, s.
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
                connection = self._ready()
                connection.send((function, arguments))
                if connection.poll(MAX_WAIT * self._seconds):
                    outcome = connection.recv()
                    if isinstance(outcome, BaseException):
                        raise outcome
                    result: T = outcome
                    return result
                failure = f'the worker process hung {ATTEMPTS} times'
            except (EOFError, OSError):
                failure = f'the worker process died {ATTEMPTS} times'
            if self._replace() == -signal.SIGXCPU:
                seconds = f'{self._seconds:g} s of processor time'
                raise FileLimitError(f'the limit of {seconds} was exceeded')
        raise FileLimitError(failure)

    def _ready(self) -> Connection:
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
        limits = self._seconds, self._memory
        process = context.Process(target=_serve, args=(theirs, *limits), daemon=True)
        process.start()
        self._process = process
        theirs.close()  # otherwise the end of the process would not be detected
        self._connection = ours
        if self._stopped:  # before the process existed
            raise EOFError
        return ours

    def _replace(self) -> int | None:
        """End the process, and return its exit code; the next function starts a new one."""
        process, connection = self._process, self._connection
        self._process = self._connection = None
        if connection is not None:
            connection.close()
        if process is None:
            return None
        process.kill()
        process.join(1.0)
        return process.exitcode


def _serve(connection: Connection, seconds: float, memory: int) -> None:
    """Run the received functions until the node closes the connection; runs in the process."""
    threading.Thread(target=_end_with_parent, daemon=True).start()
    _limit(resource.RLIMIT_CORE, 0)
    while True:
        try:
            function, arguments = connection.recv()  # imports its module
        except EOFError:
            return
        pages = int(Path('/proc/self/statm').read_text().split()[0])
        _limit(resource.RLIMIT_AS, pages * resource.getpagesize() + memory)
        _limit(resource.RLIMIT_CPU, math.ceil(time.process_time() + seconds))  # ends the process
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
        _limit(resource.RLIMIT_CPU, resource.RLIM_INFINITY)
        connection.send(outcome)


def _limit(kind: int, value: int) -> None:
    """Set a limit of this process, up to the hard one."""
    _, hard = resource.getrlimit(kind)
    bounds = [each for each in (value, hard) if each != resource.RLIM_INFINITY]
    resource.setrlimit(kind, (min(bounds, default=resource.RLIM_INFINITY), hard))


def _end_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
