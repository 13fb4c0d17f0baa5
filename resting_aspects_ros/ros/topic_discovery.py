"""Subscriptions to all topics <prefix>/<part>, including topics that appear later.

Each node has one timer that looks for the topics of all of its subscriptions.
"""

from collections.abc import Callable, Collection, Iterable
from functools import partial
from typing import Any
from weakref import WeakKeyDictionary

from rclpy.node import Node
from rclpy.qos import QoSProfile

from resting_aspects_ros.part.part import is_valid_name
from resting_aspects_ros.ros.callbacks import guarded, steady_timer, subscribe
from resting_aspects_ros.ros.interface import LATCHED

# Interval of the search for new topics, s. rclpy has no event for them.
PERIOD = 0.5

Topics = list[tuple[str, list[str]]]
# The updates of the subscriptions of each node.
_SEARCHES: 'WeakKeyDictionary[Node, list[Callable[[Topics], None]]]' = WeakKeyDictionary()


class TopicDiscovery:
    """Subscribes to each latched topic of one type below a prefix while it has a publisher.

    Parameters
    ----------
    prefix : str
        Relative to the namespace of the node, such as 'parts'.
    received : called with the name of the part and the message (bytes if ``raw``)
    gone : called with the name of the part when the topic has no publisher any more
    qos : for a subscriber that needs every message, deeper than the QoS of the publisher
    """

    def __init__(
        self,
        node: Node,
        prefix: str,
        message_type: Any,
        received: Callable[[str, Any], None],
        *,
        gone: Callable[[str], None] = lambda _: None,
        raw: bool = False,
        qos: QoSProfile = LATCHED,
    ) -> None:
        self._node = node
        self._prefix = prefix
        self._type = message_type
        self._received = received
        self._gone = gone
        self._raw = raw
        self._qos = qos
        self._subscriptions: dict[str, Any] = {}
        searches = _SEARCHES.setdefault(node, [])
        searches.append(guarded(node, 'topic discovery failed', self._update))
        if len(searches) == 1:
            steady_timer(node, PERIOD, partial(_search, node, searches))

    def topic(self, part: str) -> str:
        """Return the full name of the topic of a part."""
        return self._node.resolve_topic_name(f'{self._prefix}/{part}')

    @property
    def type_name(self) -> str:
        """The message type, such as resting_aspects_interfaces/msg/PartDescription."""
        return _type_name(self._type)

    def _update(self, topics: Topics) -> None:
        """Subscribe to new topics, and remove subscriptions to topics without a publisher."""
        matched = {
            part for part, each in self._subscriptions.items() if each.get_publisher_count()
        }
        published = matched | _parts_of(self._node, topics, self._prefix, self._type, matched)
        for part in published - set(self._subscriptions):
            self._subscriptions[part] = subscribe(
                self._node,
                self._type,
                self.topic(part),
                partial(self._received, part),
                self._qos,
                raw=self._raw,
            )
        for part in set(self._subscriptions) - published:
            self._node.destroy_subscription(self._subscriptions.pop(part))
            self._gone(part)


def published_parts(node: Node, prefix: str, message_type: Any) -> set[str]:
    """Return the parts whose topic <prefix>/<part> of the message type has a publisher."""
    return _parts_of(node, node.get_topic_names_and_types(), prefix, message_type)


def _search(node: Node, updates: Iterable[Callable[[Topics], None]]) -> None:
    """Look for topics, which takes longer than the updates, and call the updates."""
    topics = node.get_topic_names_and_types()
    for update in updates:
        update(topics)


def _parts_of(
    node: Node, topics: Topics, prefix: str, message_type: Any, known: Collection[str] = ()
) -> set[str]:
    """Return the published parts that are not known yet."""
    parent = node.resolve_topic_name(f'{prefix}/part').removesuffix('part')
    type_name = _type_name(message_type)
    return {
        name.removeprefix(parent)
        for name, types in topics
        if name.startswith(parent)
        and name.removeprefix(parent) not in known
        and is_valid_name(name.removeprefix(parent))
        and type_name in types
        and node.count_publishers(name)
    }


def _type_name(message_type: Any) -> str:
    return f'{message_type.__module__.split(".")[0]}/msg/{message_type.__name__}'
