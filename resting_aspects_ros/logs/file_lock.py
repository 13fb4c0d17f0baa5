"""Who writes or recovers a log holds a lock on its file, until the process ends at the latest."""

import fcntl
from typing import IO


def lock_file(file: IO[bytes]) -> bool:
    """Lock a file; False if another has. Where the file system has no locks none is taken."""
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        pass
    return True


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
