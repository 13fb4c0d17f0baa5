"""Files that a command writes: refused before the work if they cannot be, and never half there."""

import os
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
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

    A file of that name stays as it was until then. A device or a pipe is written as it is.
    """
    target = path.resolve()  # a link stays a link
    ordinary = (path.is_file() or not path.exists()) and not path.is_relative_to('/dev')
    own = uuid.uuid4().hex[:8]
    part = target.with_name(f'{target.stem}.{own}.part{target.suffix}') if ordinary else path
    try:
        yield part
        if ordinary:
            part.replace(target)
    except OSError as error:
        raise OutputError(f'{str(path)!r} cannot be written: {_reason(error)}') from None
    finally:
        if ordinary:
            part.unlink(missing_ok=True)


def _reason(error: Exception) -> str:
    return getattr(error, 'strerror', None) or str(error)
