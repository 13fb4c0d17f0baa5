"""A run's drops, made in chunks by any executor and handed over in their order."""

import os
import signal
import sys
import threading
from collections import deque
from collections.abc import Generator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from multiprocessing import active_children, get_context, parent_process

from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.poses import RestingPoses
from resting_aspects_ros.drops.engine import CHUNK, DropJob, drop_chunk

MOST_WORKERS = 1024


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
    return ProcessPoolExecutor(workers, get_context('spawn'), initializer=_start_worker)


def stop_pool(pool: ProcessPoolExecutor) -> None:
    """End a pool now: what has not begun is cancelled, what is being dropped is given up."""
    pool.shutdown(wait=False, cancel_futures=True)
    # Or the interpreter would wait for chunks that nobody wants any more.
    for worker in active_children():
        worker.terminate()


def _start_worker() -> None:
    # Ctrl-C reaches every process of the terminal; the parent decides what it means.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
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
