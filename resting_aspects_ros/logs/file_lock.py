"""Who writes a log holds a lock on its file until the process ends, however it ends."""

import fcntl
from contextlib import suppress
from typing import IO


def lock_file(file: IO[bytes]) -> None:
    """Lock a file that was just made; without one where the file system has no locks."""
    with suppress(OSError):
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)


def is_locked(file: IO[bytes]) -> bool:
    """Whether another process, or another stream of this one, is writing the file."""
    try:
        fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    fcntl.flock(file, fcntl.LOCK_UN)
    return False
