"""A run's drops, made in chunks by any executor and handed over in their order."""

import os
import signal
import sys
import threading
from collections import deque
from collections.abc import Callable, Generator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from multiprocessing import get_context, parent_process
from typing import ParamSpec, TypeVar

from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.poses import RestingPoses
from resting_aspects_ros.drops.engine import drop_chunk
from resting_aspects_ros.drops.job import DropJob
from resting_aspects_ros.drops.release import CHUNK

MOST_WORKERS = 1024

P = ParamSpec('P')
T = TypeVar('T')


def default_workers() -> int:
    """Cores this process may use."""
    return len(os.sched_getaffinity(0))


def submit_drops(
    job: DropJob, first_drop: int, drops: int, executor: Executor, lookahead: int
) -> Generator['Future[RestingPoses]', None, None]:
    """Futures of consecutive chunks of drops, in order, ``lookahead`` of them under way.

    Memory does not grow with the number of drops: a chunk is submitted only when an earlier one
    is taken. Closing the iterator cancels what has not begun.
    """
    if lookahead < 1:
        raise ValueError(f'lookahead is {lookahead}, allowed is 1 or more')
    pending: deque[Future[RestingPoses]] = deque()
    first, end = first_drop, first_drop + drops
    try:
        while first < end or pending:
            while first < end and len(pending) < lookahead:
                stop = min(end, (first // CHUNK + 1) * CHUNK)
                pending.append(executor.submit(drop_chunk, job, first, stop))
                first = stop
            yield pending.popleft()
    finally:
        for future in pending:
            future.cancel()


def make_pool(workers: int) -> ProcessPoolExecutor:
    """Worker processes for drops. Spawned: a fork of a process with threads is unsafe."""
    if not 1 <= workers <= MOST_WORKERS:
        raise InvalidValueError(f'workers is {workers}, allowed is 1 to {MOST_WORKERS}')
    pool = _Pool(workers, get_context('spawn'), initializer=_start_worker)
    # Workers begin with the first work that they get, and take a second to read their modules:
    # with this they do it now, and not while somebody waits for the first drops.
    for _ in range(workers):
        pool.submit(os.getpid)
    return pool


class _Pool(ProcessPoolExecutor):
    """Begins its workers, which submit does when they are needed, with Ctrl-C held off.

    It reaches every process of the terminal, and a worker can ignore it only when it has read its
    modules, after about a second; until then it would end in a traceback, and the pool with it.
    """

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> 'Future[T]':
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # processes inherit it
        try:
            return super().submit(fn, *args, **kwargs)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


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
