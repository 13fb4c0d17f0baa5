"""The folder of the logs, the log lines about them, and the latched topics of runs."""

import hashlib
import os
import socket
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from tempfile import TemporaryFile

from rclpy.node import Node
from rclpy.serialization import deserialize_message
from resting_aspects_interfaces.msg import SurroundingsDescription, TransitionMatrix

from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.input_files import is_printable
from resting_aspects_ros.logs.topics import Topic
from resting_aspects_ros.ros.conversions import nanoseconds, run_from
from resting_aspects_ros.ros.discovery import TopicDiscovery
from resting_aspects_ros.ros.formatting import progress_text
from resting_aspects_ros.ros.interface import (
    ALL_LATCHED,
    LATCHED,
    SURROUNDINGS,
    SURROUNDINGS_QOS,
    TRANSITIONS,
    offered_qos,
)
from resting_aspects_ros.ros.surroundings_conversions import check_surroundings
from resting_aspects_ros.ros.transition_conversions import check_transitions
from resting_aspects_ros.run_logs.recorder import RunRecorder
from resting_aspects_ros.simulation.job import RunDescription


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


class StatusLog:
    """Logs what happens to the logs of runs.

    error : text of the last error; empty again after the next complete log
    """

    def __init__(self, node: Node) -> None:
        self._logger = node.get_logger()
        self.error = ''

    def started(self, log: RunRecorder) -> None:
        """Report that a log was opened, or that an earlier log contains the run."""
        self.written(log)
        if log.earlier is not None:
            run = log.run
            self._logger.info(f'run {run.run_id} of {run.part} is already in {log.earlier}')

    def written(self, log: RunRecorder) -> None:
        """Report each error of a log once."""
        self._logger.debug(f'{log.drops} {log.unit} are in {log.folder}')
        if log.error and not log.reported:
            log.reported = True
            self.error = log.problem()
            self._logger.error(self.error)
        elif log.closed_whole:
            self.error = ''  # writing works again

    def closed(self, log: RunRecorder, folder: Path | None) -> None:
        """Report that a log was closed; folder : None if that failed, or no log was open."""
        self.written(log)
        if folder is None:
            return
        text = f'is in {folder}'
        if not log.closed_whole:
            state = 'is incomplete' if log.ended else 'was interrupted'
            progress = progress_text(log.run, log.drops, log.unit)
            text = f'{state}: the closed log {folder} has {progress}'
        self._logger.info(f'run {log.run.run_id} of {log.run.part} {text}')


class TransitionRecorder:
    """Subscribes to transitions/*, and writes every matrix to the log of its run.

    Parameters
    ----------
    log_of : returns the log of a run of actions, opened by the first call; None if the run has
        ended
    ended : called when the last matrix of a run was written
    reports : reports errors
    """

    def __init__(
        self,
        node: Node,
        log_of: Callable[[RunDescription], RunRecorder | None],
        ended: Callable[[RunRecorder], None],
        reports: StatusLog,
    ) -> None:
        self._log_of = log_of
        self._ended = ended
        self._reports = reports
        self._discovery = TopicDiscovery(
            node, TRANSITIONS, TransitionMatrix, self._record, raw=True, qos=ALL_LATCHED
        )

    def _record(self, part: str, data: bytes) -> None:
        message = deserialize_message(data, TransitionMatrix)
        check_transitions(message, part)
        if (log := self._log_of(run_from(message.run))) is None:
            return
        topic = Topic(self._discovery.topic(part), self._discovery.type_name, offered_qos(LATCHED))
        log.write(topic, data, time.time_ns(), nanoseconds(message.header.stamp))
        if log.being_written:
            log.drops = sum(message.actions)
        if message.ended:
            self._ended(log)
        self._reports.written(log)


# Maximum number of descriptions that are kept, with meshes. Those of a run can arrive before its
# first poses, and a log can be opened again for drops that were lost.
MAX_KEPT = 20


class SurroundingsRecorder:
    """Subscribes to surroundings/* and writes each description into the log of its run.

    Parameters
    ----------
    logs : the open logs by run id
    reports : reports errors
    """

    def __init__(self, node: Node, logs: Mapping[str, RunRecorder], reports: StatusLog) -> None:
        self._logs = logs
        self._reports = reports
        self._kept: dict[str, tuple[SurroundingsDescription, bytes]] = {}  # by run id
        self._watch = TopicDiscovery(
            node, SURROUNDINGS, SurroundingsDescription, self._take, raw=True, qos=SURROUNDINGS_QOS
        )

    def write(self, log: RunRecorder) -> None:
        """Write the surroundings of a run into its log, if they have arrived."""
        if log.has_surroundings or (kept := self._kept.get(log.run.run_id)) is None:
            return
        message, data = kept
        if (message.part, message.document) != (log.run.part, log.run.conditions.surroundings_key):
            return
        topic = Topic(
            self._watch.topic(message.part), self._watch.type_name, offered_qos(SURROUNDINGS_QOS)
        )
        log.write_surroundings(topic, data, message, time.time_ns())
        self._reports.written(log)

    def _take(self, part: str, data: bytes) -> None:
        message = deserialize_message(data, SurroundingsDescription)
        check_surroundings(message, part)
        self._kept[message.run_id] = message, data
        while len(self._kept) > MAX_KEPT:
            self._kept.pop(next(iter(self._kept)))
        if (log := self._logs.get(message.run_id)) is not None:
            self.write(log)
