"""Recording of the topics of a feeder: what was seen, advised, picked and counted.

The messages go to logs of their own, beside those of runs. A log ends when it has MAX_BYTES or
MAX_MESSAGES, or after IDLE seconds without a message; the next message begins another one. Each
log begins with the parts and the newest latched messages, so that it is complete in itself.
"""

import time
import uuid
from collections.abc import Callable
from contextlib import suppress
from datetime import datetime, timezone
from functools import partial
from pathlib import Path

from rclpy.node import Node
from rclpy.qos import QoSProfile
from resting_aspects_interfaces.msg import (
    DetectionArray,
    FeederAdvice,
    ObservedCounts,
    PickResult,
    Posterior,
)

from resting_aspects_ros.errors import LogError
from resting_aspects_ros.logs.topics import PART_TYPE, Topic
from resting_aspects_ros.logs.writer import RunLog
from resting_aspects_ros.ros.callbacks import WorkTimer, subscribe
from resting_aspects_ros.ros.conversions import NANOSECONDS
from resting_aspects_ros.ros.diagnostics import count_text
from resting_aspects_ros.ros.discovery import TopicDiscovery, type_name
from resting_aspects_ros.ros.interface import (
    ALL_LATCHED,
    CELL,
    COUNTS,
    DETECTIONS,
    FEEDER_ADVICE,
    LATCHED,
    OBSERVED_COUNTS,
    PARTS,
    PICK_RESULT,
    POSTERIOR,
    offered_qos,
)

# Limits of a log. Until a file is closed, its index is in memory, about 1 kB for each message.
MAX_BYTES = 20_000_000
MAX_MESSAGES = 20_000
# Time without a message after which a log is closed, so that other programs can read it, s.
IDLE = 600.0
# Time between two checks for it, s.
CLOSE_PERIOD = 10.0
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
    """Subscribes to the topics of a feeder, and writes every message at once.

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
        self._idle = WorkTimer(node, CLOSE_PERIOD, 'a log is not closed', self._close_idle)
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
