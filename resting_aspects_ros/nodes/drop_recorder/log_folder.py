"""Checks and locks the folder in which a recorder writes its logs."""

import hashlib
import os
import socket
from pathlib import Path
from tempfile import TemporaryFile

from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.input_files import is_printable


def absolute_folder(path: str) -> Path:
    """Return the absolute path; raises InvalidValueError if a ROS message cannot contain it."""
    try:
        folder = Path(path).absolute()
    except FileNotFoundError:
        raise InvalidValueError(
            f'invalid log_folder {path!r}: expected an absolute path, because the working folder '
            'no longer exists'
        ) from None
    if not is_printable(str(folder)):
        raise InvalidValueError(
            f'invalid log_folder {str(folder)!r}: expected UTF-8 text, as ROS messages require'
        )
    return folder


def check_log_folder(path: str) -> Path:
    """Make the folder, check that files can be written in it, and return its absolute path.

    Raises InvalidValueError with the reason if that fails. The folder is not checked when the
    recorder starts, because it can be on a disk that is mounted later.
    """
    try:
        if not path:
            raise ValueError('the name is empty')
        folder = absolute_folder(path)
        folder.mkdir(parents=True, exist_ok=True)
        with TemporaryFile(dir=folder):
            return folder
    except (OSError, ValueError) as error:  # ValueError: the name has a null byte
        reason = getattr(error, 'strerror', None) or error
        raise InvalidValueError(
            f'invalid log_folder {path!r}: expected a folder that exists or can be made: {reason}'
        ) from None


class FolderLock:
    """Lock that prevents a second recorder of the same namespace from using the same folder.

    Both would write a log of every run. Recorders of different namespaces may share a folder. The
    lock is an abstract socket, which leaves no file and ends with the process.
    """

    def __init__(self, namespace: str) -> None:
        self._suite = f'{os.environ.get("ROS_DOMAIN_ID", "0")} {namespace}'
        self._folder: Path | None = None
        self._socket: socket.socket | None = None

    def take(self, folder: Path) -> None:
        """Lock a folder and release the previous one; raises InvalidValueError if it is locked."""
        if folder == self._folder:
            return
        name = hashlib.sha256(os.fsencode(f'{self._suite} {os.path.realpath(folder)}')).hexdigest()
        lock = socket.socket(socket.AF_UNIX)
        try:
            lock.bind(f'\0resting_aspects/drop_recorder/{name}')
        except OSError:
            lock.close()
            raise InvalidValueError(
                f'invalid log_folder {str(folder)!r}: expected a folder in which no other '
                'drop_recorder of this namespace writes logs'
            ) from None
        self.release()
        self._folder, self._socket = folder, lock

    def release(self) -> None:
        """Release the folder."""
        if self._socket is not None:
            self._socket.close()
        self._folder = self._socket = None
