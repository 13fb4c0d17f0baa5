"""Read input files: only regular files of limited size, never pipes or devices."""

import stat
from pathlib import Path

from resting_aspects_ros.core.errors import InvalidValueError, RestingAspectsError, one_line, shown

# Maximum length of a path in a message.
MAX_PATH = 300


def read_input(
    path: Path,
    max_bytes: int,
    what: str,
    error: type[RestingAspectsError] = InvalidValueError,
) -> bytes:
    """Return the content of a regular file of at most ``max_bytes``.

    The type and the size are checked before the file is opened, because opening a pipe blocks
    until a writer appears and reading a device may never end.

    Parameters
    ----------
    path : Path
        A regular file or a link to one.
    max_bytes : int
    what : str
        Kind of file for the error message, such as 'mesh' or 'surfaces file'.
    error : type
        Exception class; raised with a single line that names the file if the file does not exist,
        is a folder, a pipe, a device or a socket, is too large, or cannot be read.
    """
    label = named(what, path)
    try:
        status = path.stat()
        if not stat.S_ISREG(status.st_mode):
            raise error(f'{label} is {_kind(status.st_mode)}: expected a regular file')
        if status.st_size <= max_bytes:
            with path.open('rb') as file:
                data = file.read(max_bytes + 1)
            if len(data) <= max_bytes:
                return data
    except FileNotFoundError:
        raise error(f'{label} does not exist') from None
    except (OSError, ValueError) as cause:  # ValueError: a path with a null byte
        reason = getattr(cause, 'strerror', None) or one_line(str(cause))
        raise error(f'{label} cannot be read: {reason}') from None
    raise error(f'{label} is too large: expected at most {_size(max_bytes)}')


def is_file(path: Path) -> bool:
    """Return Path.is_file(), or False if it raises, as for a link to a name that is too long."""
    try:
        return path.is_file()
    except OSError:
        return False


def is_folder(path: Path) -> bool:
    """Return Path.is_dir(), or False if it raises."""
    try:
        return path.is_dir()
    except OSError:
        return False


def named(what: str, path: str | Path) -> str:
    """Return the name of a file in error messages: its kind and its path."""
    return f'{what} {shown(str(path), MAX_PATH)}'


def printable(name: str) -> str:
    r"""Return a file name as valid UTF-8; on Linux it can be any bytes: '\udcff' for byte 255."""
    return name.encode('utf-8', 'backslashreplace').decode('utf-8')


def is_printable(name: str) -> bool:
    """Return whether a file name is valid UTF-8."""
    return printable(name) == name


def _kind(mode: int) -> str:
    kinds = {
        stat.S_IFDIR: 'a folder',
        stat.S_IFIFO: 'a pipe (FIFO)',
        stat.S_IFCHR: 'a device',
        stat.S_IFBLK: 'a device',
        stat.S_IFSOCK: 'a socket',
    }
    return kinds.get(stat.S_IFMT(mode), 'not a file')


def _size(count: int) -> str:
    return f'{count >> 20} MiB' if count >= 1 << 20 else f'{count >> 10} KiB'
