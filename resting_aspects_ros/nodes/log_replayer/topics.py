"""Names, types and QoS with which the topics of a log are replayed."""

import importlib
import posixpath
import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from resting_aspects_ros.errors import LogError, one_line
from resting_aspects_ros.logs.reader import RecordedTopic, Recording
from resting_aspects_ros.logs.topics import check_definition
from resting_aspects_ros.ros.interface import (
    ASPECT_DISTRIBUTIONS,
    CELL,
    DETECTIONS,
    FEEDER_ADVICE,
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
)

_MESSAGES = 'resting_aspects_interfaces/msg'
# Type of the suite's topics, by the beginning of their names, and their QoS if the log has none.
_SUITE = {
    RESTING_POSES: (f'{_MESSAGES}/RestingPoses', POSES),
    PARTS: (f'{_MESSAGES}/PartDescription', LATCHED),
    SURROUNDINGS: (f'{_MESSAGES}/SurroundingsDescription', SURROUNDINGS_QOS),
    ASPECT_DISTRIBUTIONS: (f'{_MESSAGES}/AspectDistribution', LATCHED),
    TRANSITIONS: (f'{_MESSAGES}/TransitionMatrix', LATCHED),
    DETECTIONS: (f'{_MESSAGES}/DetectionArray', CELL),
    PICK_RESULT: (f'{_MESSAGES}/PickResult', CELL),
    FEEDER_ADVICE: (f'{_MESSAGES}/FeederAdvice', LATCHED),
    OBSERVED_COUNTS: (f'{_MESSAGES}/ObservedCounts', LATCHED),
    POSTERIOR: (f'{_MESSAGES}/Posterior', LATCHED),
}
_SINGLE = (RESTING_POSES, DETECTIONS, PICK_RESULT)
_SUITE_TOPIC = re.compile(
    rf'(?P<namespace>(?:/\w+)*)/'
    rf'(?:{"|".join(_SINGLE)}|(?:{"|".join(_SUITE.keys() - set(_SINGLE))})/\w+)',
    re.ASCII,
)
# QoS of other topics if the log has none, as in rosbag2.
_OTHERS = QoSProfile(depth=10)

# A topic name that is valid in ROS and not hidden; the topics of an action are hidden.
_NAME = re.compile(r'(/[A-Za-z]\w*)+', re.ASCII)
_MAX_NAME_LENGTH = 247  # DDS terminates a program that uses a longer name
_TYPE = re.compile(r'[A-Za-z]\w*/msg/[A-Za-z]\w*', re.ASCII)


@dataclass(frozen=True)
class ReplayedTopic:
    """A topic of the log, with the name and QoS with which it is published.

    recorded : name in the log
    name : name relative to the replayer's namespace
    message : class of the messages
    """

    recorded: str
    name: str
    type: str
    message: Any
    qos: QoSProfile

    @property
    def describes_run(self) -> bool:
        """Whether the topic is parts/<part> or surroundings/<part>."""
        return self.type in (_SUITE[PARTS][0], _SUITE[SURROUNDINGS][0])

    @property
    def holds_poses(self) -> bool:
        """Whether the topic is resting_poses."""
        return self.type == _SUITE[RESTING_POSES][0]


def replayed_topics(recording: Recording) -> tuple[list[ReplayedTopic], list[str]]:
    """Return the topics that can be replayed, and for each other topic its name and the reason.

    The namespace in which the suite was recorded is removed from the names. If several suites were
    recorded, it is their common namespace.

    Raises LogError if no topic can be replayed, or if the type of a topic is not installed or its
    definition differs from that in the log.
    """
    namespace = _namespace(recording.topics.values())
    replayed, skipped = [], []
    for topic in recording.topics.values():
        reason = _skip_reason(topic, namespace)
        if reason:
            skipped.append(one_line(f'{topic.name}: {reason}'))
            continue
        check_definition(recording.path, topic.type, topic.type_hash)
        name = topic.name.removeprefix(namespace).removeprefix('/')
        message = _message_class(recording, topic)
        replayed.append(ReplayedTopic(topic.name, name, topic.type, message, _qos(topic)))
    if not replayed:
        raise LogError(
            f'log {str(recording.path)!r} has no topic that can be replayed: {"; ".join(skipped)}'
        )
    return replayed, skipped


def _namespace(topics: Iterable[RecordedTopic]) -> str:
    """Return the namespace of the recorded suite, such as '/cell_1' or '/'."""
    namespaces = {
        match['namespace'] or '/'
        for topic in topics
        if (match := _SUITE_TOPIC.fullmatch(topic.name)) and topic.type in _types()
    }
    return posixpath.commonpath(namespaces) if namespaces else '/'


def _types() -> set[str]:
    return {type_name for type_name, _ in _SUITE.values()}


def _skip_reason(topic: RecordedTopic, namespace: str) -> str:
    if not topic.name.startswith(f'{namespace.rstrip("/")}/'):
        return f'not in {namespace}, the namespace of the suite in the log'
    if not _NAME.fullmatch(topic.name) or len(topic.name) > _MAX_NAME_LENGTH:
        return 'hidden, or not a valid ROS topic name'
    if topic.encoding != 'cdr' or not _TYPE.fullmatch(topic.type):
        return f'not ROS 2 messages (type {topic.type or "missing"}, encoding {topic.encoding})'
    return ''


def _message_class(recording: Recording, topic: RecordedTopic) -> Any:
    package, _, short = topic.type.partition('/msg/')
    try:
        return getattr(importlib.import_module(f'{package}.msg'), short)
    except (ImportError, AttributeError) as error:
        raise LogError(
            f'log {str(recording.path)!r} has topic {topic.name} of type {topic.type}, but the '
            f'Python class of this type is not installed: {error}'
        ) from None


def _qos(topic: RecordedTopic) -> QoSProfile:
    default = dict(_SUITE.values()).get(topic.type, _OTHERS)
    recorded = topic.qos
    if recorded is None:
        return default
    return QoSProfile(
        depth=recorded.depth or default.depth,
        history=HistoryPolicy.get_from_short_key(recorded.history),
        reliability=ReliabilityPolicy.get_from_short_key(recorded.reliability),
        durability=DurabilityPolicy.get_from_short_key(recorded.durability),
    )
