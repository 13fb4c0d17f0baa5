"""The node that writes a log of every run, of drops or of actions, and logs of a feeder."""

import sys
import time
import uuid
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from datetime import datetime, timezone
from functools import partial
from pathlib import Path
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from resting_aspects_interfaces.msg import (
    DetectionArray,
    FeederAdvice,
    ObservedCounts,
    PartDescription,
    PickResult,
    Posterior,
    RestingPoses,
    SurroundingsDescription,
    TransitionMatrix,
)

from resting_aspects_ros.errors import InvalidValueError, LogError, RestingAspectsError
from resting_aspects_ros.input_files import printable
from resting_aspects_ros.logs.topics import DISTRIBUTION_TYPE, PART_TYPE, POSES_TYPE, Topic
from resting_aspects_ros.logs.writer import RunLog
from resting_aspects_ros.ros.callbacks import WorkTimer, guarded_task, subscribe
from resting_aspects_ros.ros.conversions import (
    NANOSECONDS,
    check_description,
    check_surroundings,
    nanoseconds,
    poses_from,
    run_from,
    surroundings_of,
)
from resting_aspects_ros.ros.distribution_conversions import check_transitions
from resting_aspects_ros.ros.file_worker import FileWorker
from resting_aspects_ros.ros.goal_client import DropClient, goal_of_run
from resting_aspects_ros.ros.health import (
    Diagnosis,
    DuplicateNodeDetector,
    RateCounter,
    TopicDiscovery,
    active_runs_text,
    count_text,
    progress_text,
    publish_diagnostics,
    run_values,
    type_name,
)
from resting_aspects_ros.ros.interface import (
    ALL_LATCHED,
    ASPECT_DISTRIBUTIONS,
    CELL,
    COUNTS,
    DETECTIONS,
    DROP_RECORDER,
    DROP_SIMULATOR,
    FEEDER_ADVICE,
    FRAME,
    LATCHED,
    OBSERVED_COUNTS,
    PARTS,
    PICK_RESULT,
    POSES,
    POSTERIOR,
    RESTING_POSES,
    SURROUNDINGS,
    SURROUNDINGS_QOS,
    TRANSITIONS,
    offered_qos,
)
from resting_aspects_ros.ros.program import Parameter, declare, run_node
from resting_aspects_ros.run_logs import RunRecorder, counted_distribution, whole_log
from resting_aspects_ros.simulation.job import RunDescription

PARAMETERS = (
    Parameter(
        'log_folder', 'out/logs', 'folder of the logs, in which each run has a folder of its own'
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


# Limits of a log of a feeder. Until a file is closed, its index is in memory, about 1 kB for each
# message.
MAX_BYTES = 20_000_000
MAX_MESSAGES = 20_000
# Time between two checks whether a log of a feeder can be closed, s.
FEEDER_PERIOD = 10.0
# Time after an error until recording is tried again, s.
RETRY = 10.0
# A subscriber deeper than the publishers loses no message while the node is busy.
ALL = QoSProfile(depth=1000)
BY_PART = (
    (FEEDER_ADVICE, FeederAdvice, ALL_LATCHED),
    (OBSERVED_COUNTS, ObservedCounts, COUNTS),
    (POSTERIOR, Posterior, ALL_LATCHED),
)


class FeederRecorder:
    """Records the topics of a feeder: what was seen, advised, picked and counted.

    Every message is written at once, to logs of their own. A log ends when it has MAX_BYTES or
    MAX_MESSAGES, or after IDLE seconds without a message; the next message begins another one.
    Each log begins with the parts and the newest latched messages, so that it is complete in
    itself.

    Parameters
    ----------
    folder : of the logs
    parts : returns the serialized description of a part by name, or None

    Attributes
    ----------
    messages : int
        Number of messages that were written.
    error : str
        Why the last message was not written; empty if it was.
    """

    def __init__(self, node: Node, folder: Path, parts: Callable[[str], bytes | None]) -> None:
        self._node = node
        self._folder = folder
        self._parts = parts
        self._log: RunLog | None = None
        self._bytes = self._count = 0
        self._last = self._retry = 0.0
        self._described: set[str] = set()
        self._newest: dict[str, tuple[Topic, bytes]] = {}  # of the latched topics, by name
        self.messages = 0
        self.error = ''
        self._idle = WorkTimer(node, FEEDER_PERIOD, 'a log is not closed', self._close_idle)
        qos = offered_qos(CELL)
        for name, kind in ((DETECTIONS, DetectionArray), (PICK_RESULT, PickResult)):
            topic = Topic(node.resolve_topic_name(name), type_name(kind), qos)
            subscribe(node, kind, name, partial(self._record, topic), ALL, raw=True)
        self._discoveries = [
            TopicDiscovery(node, name, kind, partial(self._record_of, k), raw=True, qos=each)
            for k, (name, kind, each) in enumerate(BY_PART)
        ]

    @property
    def file(self) -> str:
        """Path of the log that is being written, or ''."""
        return '' if self._log is None else str(self._log.path)

    def _close_idle(self) -> bool:
        """Close the log if no message has arrived for a time; returns whether it is open."""
        if time.monotonic() - self._last > IDLE:
            self.close()
        return self._log is not None

    def close(self) -> None:
        """Close the log, if there is one."""
        log, self._log = self._log, None
        if log is None:
            return
        try:
            log.close()
        except LogError as error:
            self._fail(error)
            return
        written = count_text(self._count, 'message', 'messages')
        self._node.get_logger().info(f'{written} of the feeder are in {log.path.parent}')

    def _record_of(self, kind: int, part: str, data: bytes) -> None:
        topic = self._discoveries[kind].logged(part)
        self._record(topic, data, part)
        self._newest[topic.name] = topic, data

    def _record(self, topic: Topic, data: bytes, part: str = '') -> None:
        """Write a message, and what has to precede it."""
        self._last = time.monotonic()
        if self.error and self._last < self._retry:
            return
        try:
            if self._bytes >= MAX_BYTES or self._count >= MAX_MESSAGES:
                self.close()
            log = self._log or self._begin()
            self._write(log, topic, data, part)
            log.flush()
        except LogError as error:
            self._fail(error)
            return
        self.messages += 1
        self.error = ''

    def _begin(self) -> RunLog:
        """Return a log that begins with the newest latched messages; raises LogError."""
        # A run folder begins with the name of a part, which has no "-".
        # The fraction of the second sorts logs by their start.
        seconds, fraction = divmod(time.time_ns(), NANOSECONDS)
        started = datetime.fromtimestamp(seconds, timezone.utc)
        name = f'feeder-{started:%Y%m%dT%H%M%SZ}-{fraction:09d}{uuid.uuid4().hex[:4]}'
        self._bytes = self._count = 0
        self._described = set()
        self._idle.start()
        self._log = log = RunLog(self._folder, name)  # what fails from here on closes it
        log.add_metadata('feeder', {'namespace': self._node.get_namespace()})
        for topic, data in self._newest.values():
            self._write(log, topic, data, topic.name.rpartition('/')[2])
        return log

    def _write(self, log: RunLog, topic: Topic, data: bytes, part: str) -> None:
        """Write a message, after the description of its part if that is not in the log yet."""
        described = self._parts(part) if part and part not in self._described else None
        if described is not None:
            self._described.add(part)
            name = self._node.resolve_topic_name(f'{PARTS}/{part}')
            log.write(Topic(name, PART_TYPE, offered_qos(LATCHED)), described, time.time_ns())
            self._count += 1
        log.write(topic, data, time.time_ns())  # not ROS time, which can be paused
        self._count += 1
        self._bytes += len(data)  # without a large mesh, which would begin a log for every message

    def _fail(self, error: LogError) -> None:
        if not self.error:
            self._node.get_logger().error(f'the feeder is not recorded: {error}')
        self.error = f'the feeder is not recorded: {error}'
        self._retry = time.monotonic() + RETRY
        log, self._log = self._log, None
        if log is not None:
            with suppress(LogError):  # keeps the content of the file
                log.close()


def absolute_folder(path: str) -> Path:
    """Return the absolute path of a folder, which can be on a disk that is mounted later.

    Raises InvalidValueError if there is none, or if a ROS message cannot contain it.
    """
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


class DropRecorder(Node):
    """Records resting_poses, parts/*, surroundings/* and transitions/*.

    Each run of drop_part and of reorient_part has an MCAP log of its own. That of drops ends with
    their distribution, on aspect_distributions/<part>. The topics of a feeder, detections,
    pick_result, feeder_advice/*, observed_counts/* and posterior/*, have others.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__(DROP_RECORDER, **options)
        self._folder = absolute_folder(declare(self, PARAMETERS)['log_folder'])
        self._logs: dict[str, RunRecorder] = {}
        self._parts: dict[str, tuple[PartDescription, bytes]] = {}
        self._surroundings: dict[str, tuple[SurroundingsDescription, bytes]] = {}  # by run id
        self._drops = RateCounter()
        self._ended: deque[str] = deque(maxlen=MAX_ENDED)
        self._error = ''  # the last one; empty again after the next complete log
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
            self, self._folder, lambda part: self._parts.get(part, (None, None))[1]
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

    # Runs

    def _record_poses(self, data: bytes) -> None:
        message = deserialize_message(data, RestingPoses)
        poses, run = poses_from(message), run_from(message.run)
        if (log := self._log(run)) is None:
            return
        stamp = nanoseconds(message.header.stamp)
        self._drops.add(
            log.write_poses(self._poses, data, self._now(), stamp, poses.first_drop, poses.end)
        )
        self.get_logger().debug(f'{log.drops} drops are in {log.folder}')
        if message.last:
            self._ends(log, message.header.frame_id)

    def _record_transitions(self, part: str, data: bytes) -> None:
        message = deserialize_message(data, TransitionMatrix)
        check_transitions(message, part)
        if (log := self._log(run_from(message.run), 'actions')) is None:
            return
        topic = self._transition_topics.logged(part)
        if log.write(topic, data, self._now(), nanoseconds(message.header.stamp)):
            log.drops = sum(message.actions)
        if message.ended:
            self._ends(log)

    def _log(self, run: RunDescription, unit: str = 'drops') -> RunRecorder | None:
        """Return the log of a run, opened for the first message; None if the run is recorded.

        Raises InvalidValueError if earlier messages with this run id are of another run.
        """
        if (known := self._logs.get(run.run_id)) is not None:
            if (known.run.sequence(), known.unit) != (run.sequence(), unit):
                raise InvalidValueError(
                    f'a message of run {run.run_id} describes another run than its earlier '
                    'messages'
                )
            return known
        if run.run_id in self._ended:
            return None
        if (earlier := whole_log(self._folder, run)) is not None:
            self._ended.append(run.run_id)
            text = f'run {run.run_id} of {run.part} is already in {earlier}'
            self.get_logger().info(text)
            return None
        log = self._logs[run.run_id] = RunRecorder(self._folder, run, unit, self._on_failure)
        self._check.start()
        self._write_part(log)
        self._write_surroundings(log)
        return log

    def _on_failure(self, problem: str) -> None:
        self._error = problem
        self.get_logger().error(problem)

    def _ends(self, log: RunRecorder, frame: str = FRAME) -> None:
        """Complete and close the log of a run whose last message has arrived."""
        if not log.ended:
            log.ended = True
            assert self.executor is not None  # it calls this
            self.executor.create_task(self._end_run, log, frame)

    async def _end(self, log: RunRecorder, frame: str) -> None:
        whole = not log.missing()
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
        is_whole = log.close(whole=whole)
        if is_whole is None:
            return
        text = f'is in {log.folder}'
        if is_whole:
            self._error = ''  # writing works again
        else:
            state = 'is incomplete' if log.ended else 'was interrupted'
            progress = progress_text(log.run, log.drops, log.unit)
            text = f'{state}: the closed log {log.folder} has {progress}'
        self.get_logger().info(f'run {log.run.run_id} of {log.run.part} {text}')

    # Descriptions

    def _record_part(self, name: str, data: bytes) -> None:
        message = deserialize_message(data, PartDescription)
        check_description(message, name)
        self._parts[name] = message, data
        for log in self._logs.values():
            self._write_part(log)

    def _write_part(self, log: RunRecorder) -> None:
        part, data = self._parts.get(log.run.part, (None, b''))
        if part and not log.has_part and part.part_sha256 == log.run.part_sha256:
            log.write_part(self._part_topics.logged(part.name), data, part, self._now())

    def _record_around(self, part: str, data: bytes) -> None:
        message = deserialize_message(data, SurroundingsDescription)
        check_surroundings(message, part)
        self._surroundings[message.run_id] = message, data
        while len(self._surroundings) > MAX_KEPT:
            self._surroundings.pop(next(iter(self._surroundings)))
        if (log := self._logs.get(message.run_id)) is not None:
            self._write_surroundings(log)

    def _write_surroundings(self, log: RunRecorder) -> None:
        message, data = self._surroundings.get(log.run.run_id, (None, b''))
        if message is None or log.has_surroundings or message.part != log.run.part:
            return
        if surroundings_of(message.surroundings) == log.run.conditions.surroundings:
            topic = self._surroundings_topics.logged(message.part, SURROUNDINGS_QOS)
            log.write_surroundings(topic, data, message, self._now())

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
            'log files': ', '.join(files),
            'log folder': self._folder,
            **run_values(active),
        }
        state = active_runs_text(active)
        if files and not state:
            state = count_text(len(files), 'log open', 'logs open')
        gone = self._client.simulators.was_seen and self._client.source_is_gone
        errors = [each for each in (self._error, self._feeder.error) if each]
        return Diagnosis(state, values, [f'no {DROP_SIMULATOR}'] * gone, errors)

    def _now(self) -> int:
        return time.time_ns()  # not ROS time, which can be paused


def main() -> int:
    """Run the node alone in this process."""
    return run_node(DropRecorder, PARAMETERS)


if __name__ == '__main__':
    sys.exit(main())
