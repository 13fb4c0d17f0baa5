"""Subscriptions to all topics <prefix>/<part>, including topics that appear later."""

from collections.abc import Callable
from functools import partial
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile

from resting_aspects_ros.part.part import is_valid_name
from resting_aspects_ros.ros.callbacks import guarded, steady_timer, subscribe
from resting_aspects_ros.ros.interface import LATCHED

# Interval of the search for new topics, s. rclpy has no event for them.
PERIOD = 0.2

Topics = list[tuple[str, list[str]]]
# Attribute of a node: the updates of all its discoveries.
_UPDATES = '_topic_discoveries'


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
        _start(node, self)

    def topic(self, part: str) -> str:
        """Return the full name of the topic of a part."""
        return self._node.resolve_topic_name(f'{self._prefix}/{part}')

    @property
    def type_name(self) -> str:
        """The message type, such as resting_aspects_interfaces/msg/PartDescription."""
        return _type_name(self._type)

    def update(self, topics: Topics) -> None:
        """Subscribe to new topics, and remove subscriptions to topics without a publisher."""
        published = published_parts(self._node, self._prefix, self._type, topics)
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


def published_parts(
    node: Node, prefix: str, message_type: Any, topics: Topics | None = None
) -> set[str]:
    """Return the parts whose topic <prefix>/<part> of the message type has a publisher.

    topics : all topics; None: they are requested
    """
    parent = node.resolve_topic_name(f'{prefix}/part').removesuffix('part')
    return {
        name.removeprefix(parent)
        for name, types in (node.get_topic_names_and_types() if topics is None else topics)
        if name.startswith(parent)
        and is_valid_name(name.removeprefix(parent))
        and _type_name(message_type) in types
        and node.count_publishers(name)
    }


def _start(node: Node, discovery: TopicDiscovery) -> None:
    """Update a discovery regularly; all discoveries of a node share one timer and one request."""
    update = guarded(node, 'topic discovery failed', discovery.update)
    updates: list[Callable[[Topics], None]] | None = getattr(node, _UPDATES, None)
    if updates is not None:
        updates.append(update)
        return
    updates = [update]
    setattr(node, _UPDATES, updates)

    def update_all() -> None:
        topics = node.get_topic_names_and_types()
        for each in updates:
            each(topics)

    steady_timer(node, PERIOD, guarded(node, 'topic discovery failed', update_all))


def _type_name(message_type: Any) -> str:
    return f'{message_type.__module__.split(".")[0]}/msg/{message_type.__name__}'
