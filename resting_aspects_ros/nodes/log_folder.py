"""Whether logs can be written to a folder."""

from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryFile

from resting_aspects_ros.core.errors import InvalidValueError


def check_log_folder(path: str) -> None:
    """Make the folder, write into it, and leave nothing of that.

    Raises InvalidValueError with the reason if it cannot be done.

    At the start it may not be there yet, as a disk that is mounted later; it is told then.
    """
    made: list[Path] = []
    try:
        if not path:
            raise ValueError('it has no name')
        folder = Path(path).absolute()
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
