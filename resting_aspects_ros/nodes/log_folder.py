"""Whether logs can be written to a folder."""

from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryFile

from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.file_names import is_printable


def absolute_folder(path: str) -> Path:
    """The folder with its full name; InvalidValueError if that cannot be said in a message."""
    folder = Path(path).absolute()
    if not is_printable(str(folder)):
        raise InvalidValueError(
            f'log_folder is {str(folder)!r}, allowed is a full name in UTF-8: ROS takes no other'
        )
    return folder


def check_log_folder(path: str) -> None:
    """Make the folder, write into it, and leave nothing of that.

    Raises InvalidValueError with the reason if it cannot be done.

    At the start it may not be there yet, as a disk that is mounted later; it is told then.
    """
    made: list[Path] = []
    try:
        if not path:
            raise ValueError('it has no name')
        folder = absolute_folder(path)
        for each in reversed([each for each in (folder, *folder.parents) if not each.exists()]):
            each.mkdir()
            made.append(each)
        with TemporaryFile(dir=folder):
            pass
    except (OSError, ValueError) as error:  # the second: a name that has a zero byte
        reason = getattr(error, 'strerror', None) or error
        raise InvalidValueError(
            f'log_folder is {path!r}, allowed is a folder that is there or can be made: {reason}'
        ) from None
    finally:
        with suppress(OSError):  # somebody has begun to use it
            for each in reversed(made):
                each.rmdir()
