"""Under which names, types and QoS the topics of a log are published again."""

import importlib
import posixpath
import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from resting_aspects_ros.core.errors import LogError, one_line
from resting_aspects_ros.logs.message_reader import check_definition
from resting_aspects_ros.logs.playback_reader import RecordedTopic, Recording
from resting_aspects_ros.ros.interface import (
    ASPECT_DISTRIBUTIONS,
    LATCHED,
    PARTS,
    POSES,
    RESTING_POSES,
)

_MESSAGES = 'resting_aspects_interfaces/msg'
# The suite's topics by how their names begin: type, and QoS as far as the log does not say it.
_SUITE = {
    RESTING_POSES: (f'{_MESSAGES}/RestingPoses', POSES),
    PARTS: (f'{_MESSAGES}/PartDescription', LATCHED),
    ASPECT_DISTRIBUTIONS: (f'{_MESSAGES}/AspectDistribution', LATCHED),
}
_PLACE = re.compile(
    rf'(?P<namespace>(?:/\w+)*)/(?:{RESTING_POSES}|(?:{PARTS}|{ASPECT_DISTRIBUTIONS})/\w+)',
    re.ASCII,
)
# For a topic of others of which the log does not say it, as rosbag2 has it.
_OTHERS = QoSProfile(depth=10)

# A name that ROS allows and that is not hidden, as those that an action is made of are.
_NAME = re.compile(r'(/[A-Za-z]\w*)+', re.ASCII)
_LONGEST_NAME = 247  # DDS ends a program that takes a longer one
_TYPE = re.compile(r'[A-Za-z]\w*/msg/[A-Za-z]\w*', re.ASCII)


@dataclass(frozen=True)
class ReplayedTopic:
    """How a topic of the log is published.

    recorded : its name in the log
    name : relative to the replayer's namespace
    message : class of its messages
    """

    recorded: str
    name: str
    type: str
    message: Any
    qos: QoSProfile

    @property
    def describes_part(self) -> bool:
        """Whether it is parts/<part>."""
        return self.type == _SUITE[PARTS][0]

    @property
    def holds_poses(self) -> bool:
        """Whether it is resting_poses."""
        return self.type == _SUITE[RESTING_POSES][0]


def replayed_topics(recording: Recording) -> tuple[list[ReplayedTopic], list[str]]:
    """The topics that can be published, and for each of the others what it is and why it cannot.

    A topic's new name is the recorded one without the namespace in which the suite was recorded.
    Of several suites it is the namespace that is common to them.

    Raises LogError if there is none, or if a type is not installed, or is by now another than that
    of the log.
    """
    namespace = _namespace(recording.topics.values())
    replayed, skipped = [], []
    for topic in recording.topics.values():
        reason = _reason_against(topic, namespace)
        if reason:
            skipped.append(one_line(f'{topic.name}: {reason}'))
            continue
        check_definition(recording.path, topic.type, topic.type_hash)
        name = topic.name.removeprefix(namespace).removeprefix('/')
        message = _message_class(recording, topic)
        replayed.append(ReplayedTopic(topic.name, name, topic.type, message, _qos(topic)))
    if not replayed:
        raise LogError(f'log {str(recording.path)!r} has nothing to replay: {"; ".join(skipped)}')
    return replayed, skipped


def _namespace(topics: Iterable[RecordedTopic]) -> str:
    """The namespace of the recorded suite, such as '/cell_1' or '/'."""
    found = {
        place['namespace'] or '/'
        for topic in topics
        if (place := _PLACE.fullmatch(topic.name)) and topic.type in _types()
    }
    return posixpath.commonpath(found) if found else '/'


def _types() -> set[str]:
    return {type_name for type_name, _ in _SUITE.values()}


def _reason_against(topic: RecordedTopic, namespace: str) -> str:
    if not topic.name.startswith(f'{namespace.rstrip("/")}/'):
        return f'not in {namespace}, the namespace of the suite in the log'
    if not _NAME.fullmatch(topic.name) or len(topic.name) > _LONGEST_NAME:
        return 'hidden, or no name of a topic of ROS'
    if topic.encoding != 'cdr' or not _TYPE.fullmatch(topic.type):
        return f'no messages of ROS 2 ({topic.type or "of no type"}, in {topic.encoding})'
    return ''


def _message_class(recording: Recording, topic: RecordedTopic) -> Any:
    package, _, short = topic.type.partition('/msg/')
    try:
        return getattr(importlib.import_module(f'{package}.msg'), short)
    except (ImportError, AttributeError) as error:
        raise LogError(
            f'log {str(recording.path)!r} has topic {topic.name} of type {topic.type}, of which '
            f'no Python class is installed: {error}'
        ) from None


def _qos(topic: RecordedTopic) -> QoSProfile:
    usual = dict(_SUITE.values()).get(topic.type, _OTHERS)
    recorded = topic.qos
    if recorded is None:
        return usual
    return QoSProfile(
        depth=recorded.depth or usual.depth,
        history=HistoryPolicy.get_from_short_key(recorded.history),
        reliability=ReliabilityPolicy.get_from_short_key(recorded.reliability),
        durability=DurabilityPolicy.get_from_short_key(recorded.durability),
    )
