"""A worker process: drops the chunks that its parent sends, until the parent is gone.

The parent, worker_pool, sends (pickled job or None, first drop, end); None stands for the job that
was sent before. The answer is the resting poses, or the exception.
"""

import os
import pickle
import threading
from contextlib import suppress
from importlib import import_module
from multiprocessing.connection import Connection
from queue import SimpleQueue

# Workers run at lower priority than other processes of this machine.
NICENESS = 5
_ENGINE = 'resting_aspects_ros.drops.engine'


def main(descriptor: int) -> None:
    """Serve the connection with this file descriptor; never returns."""
    os.nice(NICENESS)
    connection = Connection(descriptor)
    tasks: SimpleQueue[bytes] = SimpleQueue()
    threading.Thread(target=_receive, args=(connection, tasks), daemon=True).start()
    with suppress(Exception):
        # Before the first task arrives; what fails here fails again there.
        import_module(_ENGINE)
    job = None
    while True:
        task = tasks.get()
        try:
            sent_job, first, end = pickle.loads(task)  # noqa: S301 - from the parent
            job = job if sent_job is None else sent_job
            answer: object = import_module(_ENGINE).drop_chunk(job, first, end)
        except Exception as error:  # noqa: BLE001 - the parent reports it
            answer = error
        connection.send(answer)


def _receive(connection: Connection, tasks: 'SimpleQueue[bytes]') -> None:
    """Queue what arrives. End the process with its parent, also in the middle of a chunk."""
    try:
        while True:
            tasks.put(connection.recv_bytes())
    except (EOFError, OSError):
        os._exit(0)
