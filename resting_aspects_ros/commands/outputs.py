"""Files that a command writes: refused before the work if they cannot be, and never half there."""

import fcntl
import glob
import os
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from resting_aspects_ros.core.errors import InvalidValueError, RestingAspectsError


class OutputError(RestingAspectsError):
    """What was worked out cannot be written."""


def make_folder(flag: str, folder: Path) -> None:
    """Make a folder that a flag names; InvalidValueError if that cannot be."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:
        raise InvalidValueError(
            f'{flag} is {str(folder)!r}, allowed is a folder that is there or can be made: '
            f'{_reason(error)}'
        ) from None


def check_output(flag: str, path: Path | None) -> None:
    """Refuse now what could not be written when the work is done."""
    if path is None:
        return
    if not path.parent.is_dir():
        problem = f'the folder {str(path.parent)!r} does not exist'
    elif path.is_dir():
        problem = 'this is a folder'
    elif not os.access(path if path.exists() else path.parent, os.W_OK):
        problem = 'writing is not permitted'
    else:
        return
    raise InvalidValueError(
        f'{flag} is {str(path)!r}, allowed is a file that can be written: {problem}'
    )


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Where to write a file, which is moved to its place when it is whole.

    A file of that name stays as it was until then. A device or a pipe is written as it is. What
    killed programs left of the same file is removed.
    """
    target = path.resolve()  # a link stays a link
    ordinary = (path.is_file() or not path.exists()) and not path.is_relative_to('/dev')
    try:
        if not ordinary:
            yield path
            return
        _remove_abandoned(target)
        with _locked_part(target) as part:
            yield part
            part.replace(target)
    except OSError as error:
        raise OutputError(f'{str(path)!r} cannot be written: {_reason(error)}') from None


@contextmanager
def _locked_part(target: Path) -> Iterator[Path]:
    """A new file beside the target, locked while it is written, and removed if it stays."""
    while True:
        part = target.with_name(f'{target.stem}.{uuid.uuid4().hex[:8]}.part{target.suffix}')
        with part.open('xb') as file:
            with suppress(OSError):  # a file system without locks
                fcntl.flock(file, fcntl.LOCK_EX)
            if not part.exists():  # another program took it for abandoned before it was locked
                continue
            try:
                yield part
            finally:
                part.unlink(missing_ok=True)
            return


def _remove_abandoned(target: Path) -> None:
    """Remove unfinished files of the target that no program has locked."""
    name = f'{glob.escape(target.stem)}.{"[0-9a-f]" * 8}.part{glob.escape(target.suffix)}'
    for part in target.parent.glob(name):
        with suppress(OSError), part.open('rb') as file:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            part.unlink()


def _reason(error: Exception) -> str:
    return getattr(error, 'strerror', None) or str(error)
