"""Open a part in a process of its own, so that it can be cancelled and slows down no other tab."""

import contextlib
import os
import signal
import socket
import sys
import threading
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path
from subprocess import DEVNULL, Popen
from typing import Any

from resting_aspects_ros.aspects.find import find_aspects, keep_aspects
from resting_aspects_ros.errors import RestingAspectsError, StoppedError, one_line
from resting_aspects_ros.part.library import load_part
from resting_aspects_ros.part.loading import load_part as load_mesh
from resting_aspects_ros.part.part import Part, valid_name
from resting_aspects_ros.studio.rows import Opened, Source, empty_rows

# Below the priority of the server, so that opening a large file does not slow down another tab.
NICENESS = 5
# Files that are opened at the same time; further ones wait.
MAX_OPENING = 2
# More triangles make opening take clearly longer than a second.
MANY_TRIANGLES = 100_000
# A part that opens quickly.
WARM_UP = 'tetrahedron'
WAIT = 0.1  # s, between checks whether the user has cancelled
PROGRAM = (
    'import sys; sys.path[:] = sys.argv[2:]; '
    'from resting_aspects_ros.studio.opening import serve; serve(int(sys.argv[1]))'
)


def open_part(source: Source, step: Callable[[str], None] = lambda _: None) -> Opened:
    """Load a part, find its aspects and draw its pictures; raises RestingAspectsError.

    ``step`` is called with a sentence before each step.
    """
    step(f'Reading {source.given} and checking that it is a solid ...')
    part = _loaded(source)
    count = f'{len(part.faces):,} triangles'
    if len(part.faces) > MANY_TRIANGLES:
        count += ', which takes a while; a simplified mesh has the same aspects'
    step(f'Finding the aspects ({count}) ...')
    aspects = find_aspects(part)
    step('Drawing the pictures ...')
    return empty_rows(source, part, aspects)


def _loaded(source: Source) -> Part:
    if source.path is None:
        return load_part(source.given)
    try:
        name = valid_name(Path(source.given).stem)
        return load_mesh(source.path, name, unit=source.unit, body=source.body)
    except RestingAspectsError as error:
        # The user knows the file by its own name.
        text = str(error).replace(str(source.path), source.given)
        error.args = (text.replace(source.path.name, source.given),)
        raise


# -- The process ----------------------------------------------------------------------------------


class OpeningProcess:
    """A process that opens one part. It imports everything before the part is known."""

    def __init__(self) -> None:
        self._socket, theirs = socket.socketpair()
        # The terminal sends Ctrl-C to all of its processes; this one ends with its parent.
        ignored = {signal.SIGINT, signal.SIGTERM, signal.SIGHUP}
        before = signal.pthread_sigmask(signal.SIG_BLOCK, ignored)
        try:
            with theirs:
                self._process = Popen(
                    [sys.executable, '-c', PROGRAM, str(theirs.fileno()), *sys.path],
                    pass_fds=[theirs.fileno()],
                    stdin=DEVNULL,
                    stdout=DEVNULL,
                )
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
        self._connection = Connection(os.dup(self._socket.fileno()))

    def open(
        self, source: Source, step: Callable[[str], None], stopped: Callable[[], bool]
    ) -> Opened:
        """Open a part; raises RestingAspectsError, and StoppedError if it was stopped."""
        try:
            self._connection.send(source)
            while True:
                while not self._connection.poll(WAIT):
                    if stopped():
                        raise StoppedError('cancelled')
                kind, value = self._connection.recv()
                if kind == 'step':
                    step(value)
                elif kind == 'error':
                    raise value
                else:
                    keep_aspects(value.part, value.aspects)
                    return value
        except (EOFError, OSError):
            raise RestingAspectsError(
                f'{source.given} could not be opened: the process that read it ended, perhaps '
                'because there is not enough memory'
            ) from None

    def end(self) -> None:
        """Kill the process."""
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)
        self._process.kill()
        self._process.wait()
        self._connection.close()
        self._socket.close()


class Opener:
    """Opens parts, each in a new process, of which one is ready before it is needed."""

    def __init__(self) -> None:
        self._slots = threading.Semaphore(MAX_OPENING)
        self._lock = threading.RLock()
        self._ready: OpeningProcess | None = None
        self._ended = False

    def prepare(self) -> None:
        """Start the process for the next part."""
        with self._lock:
            if self._ready is None and not self._ended:
                self._ready = OpeningProcess()

    def open(
        self, source: Source, step: Callable[[str], None], stopped: Callable[[], bool]
    ) -> Opened:
        """Open a part; see OpeningProcess.open."""
        while not self._slots.acquire(timeout=WAIT):
            step('Waiting until other files are opened ...')
            if stopped():
                raise StoppedError('cancelled')
        try:
            # In one step, so that no other thread takes the process.
            with self._lock:
                self.prepare()
                process, self._ready = self._ready, None
            if process is None:
                raise StoppedError('the server ends')
            try:
                return process.open(source, step, stopped)
            finally:
                process.end()
                self.prepare()
        finally:
            self._slots.release()

    def end(self) -> None:
        """End the process that waits."""
        with self._lock:
            self._ended = True
            process, self._ready = self._ready, None
        if process is not None:
            process.end()


def serve(descriptor: int) -> None:
    """Open the part that the connection with this file descriptor names, and end."""
    os.nice(NICENESS)
    connection = Connection(descriptor)
    try:
        # With the first picture, all modules that opening a part needs are imported.
        open_part(Source(WARM_UP))
        source: Source = connection.recv()
        answer: tuple[str, Any] = (
            'opened',
            open_part(source, lambda text: connection.send(('step', text))),
        )
    except (EOFError, OSError):
        return  # the server ended, or has no need of this process
    except RestingAspectsError as error:
        answer = ('error', error)
    except Exception as error:  # noqa: BLE001 the server reports it
        reason = one_line(f'{type(error).__name__}: {error}')
        answer = ('error', RestingAspectsError(f'the file could not be opened ({reason})'))
    with contextlib.suppress(OSError):
        connection.send(answer)
