"""The node that writes a log of every run, of drops or of actions, with its part."""

import hashlib
import os
import socket
import sys
import time
from collections import deque
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

from rclpy.node import Node
from rclpy.serialization import deserialize_message
from resting_aspects_interfaces.msg import (
    PartDescription,
    RestingPoses,
    SurroundingsDescription,
    TransitionMatrix,
)

from resting_aspects_ros.errors import InvalidValueError, RestingAspectsError
from resting_aspects_ros.input_files import printable
from resting_aspects_ros.logs.topics import DISTRIBUTION_TYPE, POSES_TYPE, Topic
from resting_aspects_ros.nodes.drop_recorder.feeder_recorder import FeederRecorder
from resting_aspects_ros.ros.callbacks import WorkTimer, guarded_task, subscribe
from resting_aspects_ros.ros.conversions import (
    check_description,
    check_surroundings,
    nanoseconds,
    poses_from,
    run_from,
    surroundings_of,
)
from resting_aspects_ros.ros.diagnostics import (
    Diagnosis,
    RateCounter,
    active_runs_text,
    count_text,
    progress_text,
    publish_diagnostics,
    run_values,
)
from resting_aspects_ros.ros.discovery import DuplicateNodeDetector, TopicDiscovery
from resting_aspects_ros.ros.distribution_conversions import check_transitions
from resting_aspects_ros.ros.file_worker import FileWorker
from resting_aspects_ros.ros.goal_client import DropClient, goal_of_run
from resting_aspects_ros.ros.interface import (
    ALL_LATCHED,
    ASPECT_DISTRIBUTIONS,
    DROP_RECORDER,
    DROP_SIMULATOR,
    FRAME,
    LATCHED,
    PARTS,
    POSES,
    RESTING_POSES,
    SURROUNDINGS,
    SURROUNDINGS_QOS,
    TRANSITIONS,
    offered_qos,
)
from resting_aspects_ros.ros.program import Parameter, declare, on_change, run_node
from resting_aspects_ros.run_logs.contents import counted_distribution
from resting_aspects_ros.run_logs.recorder import RunRecorder
from resting_aspects_ros.simulation.job import RunDescription
from resting_aspects_ros.simulation.surroundings import Surroundings


def absolute_folder(path: str) -> Path:
    """Return the absolute path; raises InvalidValueError if a ROS message cannot contain it."""
    try:
        folder = Path(path).absolute()
    except FileNotFoundError:
        raise InvalidValueError(
            f'invalid log_folder {path!r}: expected an absolute path, because the working folder '
            'no longer exists'
        ) from None
    if printable(str(folder)) != str(folder):
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


PARAMETERS = (
    Parameter(
        'log_folder',
        'out/logs',
        'folder of the logs, in which each run has a folder of its own',
        allowed='a folder that exists or can be made',
        changeable=True,
    ),
)
# Time between two checks for logs of interrupted runs, which are then closed, s.
CLOSE_PERIOD = 0.2
# Timeout for the part and the surroundings to arrive after the end of a run, s.
END_TIMEOUT = 10.0
# Time without a message after which the log of an unfinished run is closed, s: while no simulator
# and no replayer is alive, and otherwise.
IDLE_WITHOUT_SOURCE = 5.0
IDLE = 600.0
# Maximum number of finished runs that are remembered, because their messages can arrive again.
MAX_ENDED = 10_000
# Maximum number of descriptions of surroundings that are kept, with meshes. Those of a run can
# arrive before its first poses, and a log can be opened again for drops that were lost.
MAX_KEPT = 20


class DropRecorder(Node):
    """Records resting_poses, parts/*, surroundings/* and transitions/*.

    Each run of drop_part and of reorient_part has an MCAP log of its own. That of drops ends with
    their distribution, on aspect_distributions/<part>. The topics of a feeder, detections,
    pick_result, feeder_advice/*, observed_counts/* and posterior/*, have others.

    Parameters
    ----------
    options : of rclpy.node.Node, such as the namespace and the context
    """

    def __init__(self, **options: Any) -> None:
        super().__init__(DROP_RECORDER, **options)
        values = declare(self, PARAMETERS)
        self._lock = FolderLock(self.get_namespace())
        self._set_folder(values['log_folder'])
        on_change(self, 'log_folder', self._check_folder, self._set_folder)
        self._logs: dict[str, RunRecorder] = {}
        self._parts: dict[str, tuple[PartDescription, bytes]] = {}
        self._drops = RateCounter()
        self._ended: deque[str] = deque(maxlen=MAX_ENDED)
        self._error = ''  # the last one; empty again after the next complete log
        # By run id: the description, its surroundings, and its bytes.
        self._kept: dict[str, tuple[SurroundingsDescription, Surroundings | None, bytes]] = {}
        self._client = DropClient(self)
        self._files = FileWorker(self)
        self._check = WorkTimer(self, CLOSE_PERIOD, 'logs are not closed', self._close_interrupted)
        self._end_run = guarded_task(self, 'a run is not ended', self._end)
        self._part_topics, self._surroundings_topics, self._transition_topics = (
            TopicDiscovery(self, prefix, kind, record, raw=True, qos=qos)
            for prefix, kind, record, qos in (
                (PARTS, PartDescription, self._record_part, LATCHED),
                (SURROUNDINGS, SurroundingsDescription, self._record_around, SURROUNDINGS_QOS),
                (TRANSITIONS, TransitionMatrix, self._record_transitions, ALL_LATCHED),
            )
        )
        self._feeder = FeederRecorder(
            self, lambda: self._folder, lambda part: self._parts.get(part, (None, None))[1]
        )
        self._poses = Topic(self.resolve_topic_name(RESTING_POSES), POSES_TYPE, offered_qos(POSES))
        subscribe(self, RestingPoses, RESTING_POSES, self._record_poses, POSES, raw=True)
        duplicates = DuplicateNodeDetector(
            self, DROP_RECORDER, harmless_reason='each writes a log of every run'
        )
        publish_diagnostics(self, self._diagnose, duplicates)
        self.get_logger().info(f'ready: logs are written to {self._folder}')

    def close(self) -> None:
        """Close the logs of unfinished runs, so that they are readable."""
        self._client.destroy()
        for log in list(self._logs.values()):
            self._close(log, whole=log.ended and not log.missing())
        self._files.stop()
        self._feeder.close()
        self._lock.release()

    def _set_folder(self, path: str) -> None:
        self._folder = absolute_folder(path)
        self._lock.take(self._folder)

    def _check_folder(self, path: str) -> None:
        self._lock.take(check_log_folder(path))

    def _record_poses(self, data: bytes) -> None:
        message = deserialize_message(data, RestingPoses)
        poses, run = poses_from(message), run_from(message.run)
        if (log := self._log(run)) is None:
            return
        if run.sequence() != log.run.sequence():
            raise InvalidValueError(
                f'a message of run {run.run_id} describes another run than its earlier messages'
            )
        stamp = nanoseconds(message.header.stamp)
        self._drops.add(
            log.write_poses(self._poses, data, self._now(), stamp, poses.first_drop, poses.end)
        )
        self._report(log)
        if message.last:
            self._ends(log, message.header.frame_id)

    def _record_transitions(self, part: str, data: bytes) -> None:
        message = deserialize_message(data, TransitionMatrix)
        check_transitions(message, part)
        if (log := self._log(run_from(message.run), 'actions')) is None:
            return
        stamp = nanoseconds(message.header.stamp)
        log.write(self._transition_topics.logged(part), data, self._now(), stamp)
        if log.being_written:
            log.drops = sum(message.actions)
        if message.ended:
            self._ends(log)
        self._report(log)

    def _ends(self, log: RunRecorder, frame: str = FRAME) -> None:
        """Complete and close the log of a run whose last message has arrived."""
        if not log.ended:
            log.ended = True
            assert self.executor is not None  # it calls this
            self.executor.create_task(self._end_run, log, frame)

    async def _end(self, log: RunRecorder, frame: str) -> None:
        whole = log.earlier is not None or not log.missing()
        if not whole:
            whole = await self._client.request_again(goal_of_run(log.run), log.missing)
        await self._client.arrived(lambda: log.is_described or not log.being_written, END_TIMEOUT)
        if log.unit == 'drops' and log.drops and log.is_described and log.being_written:
            await self._write_distribution(log, frame)
        if log.run.run_id in self._logs:  # otherwise the node has ended
            self._close(log, whole=whole)

    async def _write_distribution(self, log: RunRecorder, frame: str) -> None:
        """Write the distribution of the drops in a log, so that it is complete in itself."""
        now = self._now()
        try:
            data = await self._files.run(counted_distribution, log.folder, now, frame)
        except RestingAspectsError as error:
            self.get_logger().warning(f'log {log.folder} has no distribution: {error}')
            return
        name = self.resolve_topic_name(f'{ASPECT_DISTRIBUTIONS}/{log.run.part}')
        log.write(Topic(name, DISTRIBUTION_TYPE, offered_qos(LATCHED)), data, now, now)
        self._report(log)

    def _log(self, run: RunDescription, unit: str = 'drops') -> RunRecorder | None:
        """Return the log of a run, opened for the first message; None if the run has ended."""
        if run.run_id in self._ended:
            return None
        if run.run_id not in self._logs:
            log = self._logs[run.run_id] = RunRecorder(self._folder, run, unit)
            self._report(log)
            if log.earlier is not None:
                text = f'run {run.run_id} of {run.part} is already in {log.earlier}'
                self.get_logger().info(text)
            self._check.start()
            if run.part in self._parts:
                self._write_part(log, *self._parts[run.part])
            self._write_surroundings(log)
        return self._logs[run.run_id]

    def _record_part(self, name: str, data: bytes) -> None:
        message = deserialize_message(data, PartDescription)
        check_description(message, name)
        self._parts[name] = (message, data)
        for log in self._logs.values():
            if log.run.part == name:
                self._write_part(log, *self._parts[name])

    def _write_part(self, log: RunRecorder, part: PartDescription, data: bytes) -> None:
        if log.has_part or part.part_sha256 != log.run.part_sha256:
            return
        log.write_part(self._part_topics.logged(log.run.part), data, part, self._now())
        self._report(log)

    def _record_around(self, part: str, data: bytes) -> None:
        message = deserialize_message(data, SurroundingsDescription)
        check_surroundings(message, part)
        self._kept[message.run_id] = message, surroundings_of(message.surroundings), data
        while len(self._kept) > MAX_KEPT:
            self._kept.pop(next(iter(self._kept)))
        if (log := self._logs.get(message.run_id)) is not None:
            self._write_surroundings(log)

    def _write_surroundings(self, log: RunRecorder) -> None:
        if log.has_surroundings or (kept := self._kept.get(log.run.run_id)) is None:
            return
        message, found, data = kept
        if (message.part, found) != (log.run.part, log.run.conditions.surroundings):
            return
        topic = self._surroundings_topics.logged(message.part, SURROUNDINGS_QOS)
        log.write_surroundings(topic, data, message, self._now())
        self._report(log)

    def _close_interrupted(self) -> bool:
        """Close the logs of runs that were interrupted; returns whether other logs are open."""
        idle = IDLE_WITHOUT_SOURCE if self._client.source_is_gone else IDLE
        begin = time.monotonic() - idle
        for log in list(self._logs.values()):
            if not log.ended and log.heard < begin:
                self._close(log, whole=False)
        return bool(self._logs)

    def _close(self, log: RunRecorder, *, whole: bool) -> None:
        del self._logs[log.run.run_id]
        if log.ended:
            self._ended.append(log.run.run_id)
        folder = log.close(whole=whole)
        self._report(log)
        if folder is None:
            return  # that failed, or an earlier log has the run
        text = f'is in {folder}'
        if not log.closed_whole:
            state = 'is incomplete' if log.ended else 'was interrupted'
            progress = progress_text(log.run, log.drops, log.unit)
            text = f'{state}: the closed log {folder} has {progress}'
        self.get_logger().info(f'run {log.run.run_id} of {log.run.part} {text}')

    def _report(self, log: RunRecorder) -> None:
        """Report each error of a log once."""
        self.get_logger().debug(f'{log.drops} {log.unit} are in {log.folder}')
        if log.error and not log.reported:
            log.reported = True
            self._error = log.problem()
            self.get_logger().error(self._error)
        elif log.closed_whole:
            self._error = ''  # writing works again

    def _diagnose(self) -> Diagnosis:
        active = [
            (log.run, log.drops)
            for log in self._logs.values()
            if log.unit == 'drops' and not log.ended
        ]
        files = [str(log.folder) for log in self._logs.values() if log.being_written]
        files += [self._feeder.file] if self._feeder.file else []
        values = {
            'drops recorded': self._drops.total,
            'drops per second': self._drops.rate(),
            'messages of the feeder recorded': self._feeder.messages,
            'logs open': len(files),
            'log files': ', '.join(files),
            'log folder': self._folder,
            'drop_simulators': self._client.simulators.count,
            **run_values(active),
        }
        state = active_runs_text(active)
        if files and not state:
            state = count_text(len(files), 'log open', 'logs open')
        gone = self._client.simulators.was_seen and self._client.source_is_gone
        errors = [each for each in (self._error, self._feeder.problem) if each]
        return Diagnosis(state, values, [f'no {DROP_SIMULATOR}'] * gone, errors)

    def _now(self) -> int:
        return time.time_ns()  # not ROS time, which can be paused


def main() -> int:
    """Run the node alone in this process."""
    return run_node(DropRecorder, PARAMETERS)


if __name__ == '__main__':
    sys.exit(main())
