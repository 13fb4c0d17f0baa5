"""The machine: locks of files, signals, the cores of a process, and the installed files."""

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

# Signals that ask a program to end: Ctrl-C, a service manager, a terminal that closes. Windows has
# no SIGHUP.
SIGNALS = tuple(
    getattr(signal, name) for name in ('SIGINT', 'SIGTERM', 'SIGHUP') if hasattr(signal, name)
)
PACKAGE = 'resting_aspects_ros'


def config_folder() -> Path:
    """Return the folder config of the source tree if there is one, otherwise the installed one."""
    here = Path(__file__).resolve()
    root = here.parents[1]
    source = root / 'config'
    if source.is_dir() and (root / 'package.xml').is_file():
        return source
    for parent in here.parents:
        installed = parent / 'share' / PACKAGE / 'config'
        if installed.is_dir():
            return installed
    raise FileNotFoundError(f'the folder config of {PACKAGE} is not installed near {here}')


def parts_folder() -> Path:
    """Return the folder of the example parts."""
    return config_folder() / 'parts'


def lock_file(file: IO[bytes], *, shared: bool = False) -> bool | None:
    """Lock a file until it is closed, at the latest until the process ends.

    Several programs may have a ``shared`` lock. Returns whether it is locked now: False if another
    program has locked it, and None if the file system or the operating system (Windows) has no
    such locks.
    """
    try:
        import fcntl
    except ImportError:
        return None
    try:
        fcntl.flock(file, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        return None
    return True


def unlock_file(file: IO[bytes]) -> None:
    """Release the lock of a file that `lock_file` has locked."""
    import fcntl

    fcntl.flock(file, fcntl.LOCK_UN)


def available_cores() -> int:
    """Return the number of cores that this process may use."""
    if hasattr(os, 'sched_getaffinity'):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@contextmanager
def blocked_signals() -> Iterator[None]:
    """Keep SIGNALS pending in this thread, and in processes that it starts, during the `with`."""
    if not hasattr(signal, 'pthread_sigmask'):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def catch(handler: Any) -> dict[signal.Signals, Any]:
    """Install a handler, except for ignored signals; returns the previous handlers."""
    before = {number: signal.getsignal(number) for number in SIGNALS}
    before = {number: old for number, old in before.items() if old is not signal.SIG_IGN}
    for number in before:
        signal.signal(number, handler)
    return before


class Interruption:
    """Deferred interruption: signals are noted during `with`, and checked at safe points.

    Once the work ends because of a signal, further signals are ignored, so that a second Ctrl-C
    does not corrupt the results that are being saved.
    """

    def __init__(self) -> None:
        self.asked = False
        self._before: dict[signal.Signals, Any] = {}

    def __enter__(self) -> 'Interruption':  # noqa: PYI034 - Self is newer than Python 3.10
        self._before = catch(self._note)
        return self

    def check(self) -> None:
        """Raise KeyboardInterrupt if a signal was received."""
        if self.asked:
            raise KeyboardInterrupt

    def _note(self, *_: object) -> None:
        self.asked = True

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, signal.SIG_IGN if self.asked else handler)
