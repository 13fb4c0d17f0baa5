"""What a recorded topic is: name, type and the QoS that its publisher offered, as plain data."""

from __future__ import annotations

import re
from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

import yaml

from resting_aspects_ros.core.errors import LogError, shown
from resting_aspects_ros.core.yaml_file import parse_yaml

# The types of what a run's log holds.
POSES_TYPE = 'resting_aspects_interfaces/msg/RestingPoses'
PART_TYPE = 'resting_aspects_interfaces/msg/PartDescription'
DISTRIBUTION_TYPE = 'resting_aspects_interfaces/msg/AspectDistribution'

# The words of rmw on Jazzy, what ROS takes by default first. A rosbag2 player that meets another
# word offers nothing.
_HISTORIES = ('keep_last', 'keep_all')
_RELIABILITIES = ('reliable', 'best_effort')
_DURABILITIES = ('volatile', 'transient_local')

# What rosbag2 writes where it was not told: DDS hands on neither history nor depth.
_NOT_TOLD = ('unknown', 'system_default', 'best_available')

_TYPE_NAME = re.compile(r'[A-Za-z]\w*/msg/[A-Za-z]\w*', re.ASCII)
_TOPIC_NAME = re.compile(r'(/[A-Za-z_]\w*)+', re.ASCII)


@dataclass(frozen=True)
class Qos:
    """The quality of service that a publisher offers, in the words that rosbag2 stores.

    rclpy gives the same words: `profile.reliability.short_key`. Deadline, lifespan and liveliness
    have no field: the suite leaves them at their defaults.

    depth : int
        Messages that are kept for a reader, >= 0; of no meaning with `keep_all`.
    reliability : str
        `reliable` or `best_effort`.
    durability : str
        `volatile`, or `transient_local` for a latched topic.
    history : str
        `keep_last` or `keep_all`.
    """

    depth: int
    reliability: str = 'reliable'
    durability: str = 'volatile'
    history: str = 'keep_last'

    def __post_init__(self) -> None:
        if type(self.depth) is not int or not 0 <= self.depth < 2**31:
            raise LogError(
                f'invalid QoS depth {shown(self.depth)}: expected an integer from 0 to 2**31 - 1'
            )
        _require_one_of('reliability', self.reliability, _RELIABILITIES)
        _require_one_of('durability', self.durability, _DURABILITIES)
        _require_one_of('history', self.history, _HISTORIES)


@dataclass(frozen=True)
class Topic:
    """One recorded topic.

    name : str
        Absolute, as it is on the graph: `/resting_poses`.
    type : str
        `resting_aspects_interfaces/msg/RestingPoses`.
    """

    name: str
    type: str
    qos: Qos

    def __post_init__(self) -> None:
        if not _TOPIC_NAME.fullmatch(self.name):
            raise LogError(
                f'invalid topic name {self.name!r}: expected an absolute name like /resting_poses'
            )
        if not _TYPE_NAME.fullmatch(self.type):
            raise LogError(
                f'invalid type {self.type!r} of topic {self.name}: expected package/msg/Type'
            )


def qos_profiles(qos: Qos) -> list[dict[str, Any]]:
    """Give the `offered_qos_profiles` of a topic with one kind of publisher, all nine keys.

    Both the channel in the MCAP file and metadata.yaml are made from this: a reader that finds
    two different profiles takes them for two topics.
    """
    return [
        {
            'history': qos.history,
            'depth': qos.depth,
            'reliability': qos.reliability,
            'durability': qos.durability,
            'deadline': _infinite(),
            'lifespan': _infinite(),
            'liveliness': 'automatic',
            'liveliness_lease_duration': _infinite(),
            'avoid_ros_namespace_conventions': False,
        }
    ]


def recorded_qos(text: str) -> Qos | None:
    """Read the `offered_qos_profiles` of a topic; None if there are none.

    Of several publishers the most that one of them offered, which suits the readers of each. What
    was not told is what ROS takes: keep_last, reliable, volatile; the depth is 0 then.

    Raises LogError if it is no such text.
    """
    try:
        offered = [
            Qos(
                0 if each['history'] in _NOT_TOLD else each['depth'],
                _told(each['reliability'], _RELIABILITIES),
                _told(each['durability'], _DURABILITIES),
                _told(each['history'], _HISTORIES),
            )
            for each in parse_yaml(text, f'QoS {shown(text)}', LogError) or []
        ]
    except (LookupError, TypeError) as error:
        raise LogError(
            f'invalid QoS {shown(text)}: expected profiles as rosbag2 writes them; {shown(error)}'
        ) from None
    if not offered:
        return None
    return Qos(
        max(each.depth for each in offered),
        min((each.reliability for each in offered), key=_RELIABILITIES.index),
        max((each.durability for each in offered), key=_DURABILITIES.index),
        max((each.history for each in offered), key=_HISTORIES.index),
    )


def yaml_text(document: object) -> str:
    """Write plain data as YAML in block style, keys in their order.

    In ASCII, with escapes: rosbags reads metadata.yaml in the encoding of the reader's locale.
    """
    return str(yaml.safe_dump(document, sort_keys=False, default_flow_style=False))


def _infinite() -> dict[str, int]:
    # RMW_DURATION_INFINITE. A new one each time: PyYAML writes one that is used twice as an alias.
    return {'sec': 9223372036, 'nsec': 854775807}


def _told(word: str, words: tuple[str, ...]) -> str:
    return words[0] if word in _NOT_TOLD else word


def _require_one_of(what: str, value: str, allowed: Collection[str]) -> None:
    if value not in allowed:
        raise LogError(f'invalid QoS {what} {shown(value)}: expected {" or ".join(allowed)}')
