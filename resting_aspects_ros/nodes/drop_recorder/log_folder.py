"""The folder of a recorder's logs."""

import hashlib
import os
import socket
from pathlib import Path
from tempfile import TemporaryFile

from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.input_file import is_printable


def absolute_folder(path: str) -> Path:
    """The folder with its full name; InvalidValueError if that cannot be said in a message."""
    try:
        folder = Path(path).absolute()
    except FileNotFoundError:
        raise InvalidValueError(
            f'invalid log_folder {path!r}: expected a full name, as the working folder is gone'
        ) from None
    if not is_printable(str(folder)):
        raise InvalidValueError(
            f'log_folder is {str(folder)!r}, allowed is a full name in UTF-8: ROS takes no other'
        )
    return folder


def check_log_folder(path: str) -> Path:
    """Make the folder, write into it, and return it with its full name.

    Raises InvalidValueError with the reason if it cannot be done.

    At the start it may not be there yet, as a disk that is mounted later; it is told then.
    """
    try:
        if not path:
            raise ValueError('it has no name')
        folder = absolute_folder(path)
        folder.mkdir(parents=True, exist_ok=True)
        with TemporaryFile(dir=folder):
            return folder
    except (OSError, ValueError) as error:  # the second: a name that has a zero byte
        reason = getattr(error, 'strerror', None) or error
        raise InvalidValueError(
            f'log_folder is {path!r}, allowed is a folder that is there or can be made: {reason}'
        ) from None


class FolderLock:
    """Keeps a second recorder of the same namespace out of a folder, while this process lives.

    Both would write a log of every run. Recorders of two namespaces may share a folder. The lock
    is an abstract socket: the kernel frees it however the process ends, and it leaves no file.
    """

    def __init__(self, namespace: str) -> None:
        self._suite = f'{os.environ.get("ROS_DOMAIN_ID", "0")} {namespace}'
        self._folder: Path | None = None
        self._socket: socket.socket | None = None

    def take(self, folder: Path) -> None:
        """Lock a folder in place of the one before; raises InvalidValueError if another has it."""
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
                'drop_recorder of this namespace writes its logs: end one of the two'
            ) from None
        self.release()
        self._folder, self._socket = folder, lock

    def release(self) -> None:
        """Let another recorder have the folder."""
        if self._socket is not None:
            self._socket.close()
        self._folder = self._socket = None
