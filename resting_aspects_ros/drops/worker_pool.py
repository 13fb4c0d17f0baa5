"""Drops in processes of this machine."""

import os
import signal
import sys
import threading
from collections.abc import Callable
from concurrent.futures import (
    BrokenExecutor,
    Executor,
    Future,
    InvalidStateError,
    ProcessPoolExecutor,
)
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from functools import partial
from multiprocessing import get_context, parent_process
from typing import Any, ParamSpec, TypeVar

from resting_aspects_ros.core.errors import InvalidValueError

MOST_WORKERS = 1024
# Workers run at lower priority than what else this machine does.
NICENESS = 5

P = ParamSpec('P')
T = TypeVar('T')


def default_workers() -> int:
    """Cores this process may use."""
    return len(os.sched_getaffinity(0))


class ProcessWorkers:
    """A pool of processes, and a new one when it breaks: Workers of a campaign, or of several.

    count : int
        How many processes.
    """

    def __init__(self, count: int) -> None:
        self.count = count
        self._pool = make_pool(count)

    @property
    def executor(self) -> ProcessPoolExecutor:
        """The pool."""
        return self._pool

    def lookahead(self) -> int:
        """One chunk that is dropped and one that waits, for each process."""
        return 2 * self.count

    def deaths(self, error: Exception) -> int:
        """A pool whose worker dies breaks, and with it all that was submitted."""
        return int(isinstance(error, BrokenExecutor))

    def replace(self, broken: Executor) -> None:
        """Make a new pool, unless another campaign has done so."""
        if self._pool is broken:
            stop_pool(self._pool)
            self._pool = make_pool(self.count)

    def stop(self) -> None:
        """End the processes; what they are dropping is given up."""
        stop_pool(self._pool)


def make_pool(workers: int) -> ProcessPoolExecutor:
    """Worker processes for drops. Spawned: a fork of a process with threads is unsafe."""
    if not 1 <= workers <= MOST_WORKERS:
        raise InvalidValueError(f'workers is {workers}, allowed is 1 to {MOST_WORKERS}')
    pool = _Pool(workers, get_context('spawn'), initializer=_start_worker)
    # Workers begin with the first work that they get, and take a second to read their modules:
    # with this they do it now, and not while somebody waits for the first drops. One that dies
    # meanwhile is noticed with the first drops.
    with suppress(BrokenExecutor):
        for _ in range(workers):
            pool.submit(os.getpid)
    return pool


class _Pool(ProcessPoolExecutor):
    """Begins its workers, which submit does when they are needed, with Ctrl-C held off.

    It reaches every process of the terminal, and a worker can ignore it only when it has read its
    modules, after about a second; until then it would end in a traceback, and the pool with it.

    Raises BrokenExecutor also for a worker that dies while it is begun.
    """

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> 'Future[T]':
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # processes inherit it
        try:
            future = super().submit(fn, *args, **kwargs)
        except (BrokenPipeError, ConnectionResetError) as error:
            # What a worker is begun with goes through a pipe to it.
            raise BrokenProcessPool('a worker died before it had begun') from error
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
        # A pool that breaks tells all its futures so, and in Python 3.11 the first one that was
        # cancelled ends that with an error: the others would be waited for for ever.
        future.set_exception = partial(_fail, future)  # type: ignore[method-assign]
        return future


def _fail(future: 'Future[Any]', error: BaseException | None) -> None:
    with suppress(InvalidStateError):
        Future.set_exception(future, error)


def stop_pool(pool: ProcessPoolExecutor) -> None:
    """End a pool now: what has not begun is cancelled, what is being dropped is given up."""
    # As kill_workers of Python 3.14 does; other pools of this process live on. Without it the
    # interpreter would wait for chunks that nobody wants any more.
    for worker in list((pool._processes or {}).values()):  # noqa: SLF001
        worker.kill()
    # Waits for the pool's thread: a pool that is collected while its thread closes their pipe
    # leaves a traceback.
    pool.shutdown(cancel_futures=True)


def _start_worker() -> None:
    # Whoever asks, and waits for an answer, comes before the drops.
    os.nice(NICENESS)
    # The parent decides what Ctrl-C means.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    # Bullet prints to standard output, where the parent's answer goes.
    sys.stdout.flush()
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    # A pool's workers wait for ever for a parent that was killed; these end with it.
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
