"""Subscribe to every topic <prefix>/<part> that there is, and to those that come later."""

from collections.abc import Callable
from functools import partial
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile

from resting_aspects_ros.core.part import is_valid_name
from resting_aspects_ros.ros.callbacks import guarded, steady_timer, subscribe
from resting_aspects_ros.ros.interface import LATCHED

# How often new topics are looked for, s. rclpy has no event for it.
PERIOD = 0.2


class TopicDiscovery:
    """Latched topics of one type below a prefix, each subscribed to while somebody publishes it.

    Parameters
    ----------
    prefix : str
        Relative to the node's namespace, such as 'parts'.
    received : called with the part's name and the message (bytes if ``raw``)
    gone : called with the part's name when nobody publishes the topic any more
    qos : deeper than the publisher's for who must not miss what comes in quick succession
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
        steady_timer(node, PERIOD, guarded(node, 'topics are not looked for', self.look))

    def topic(self, part: str) -> str:
        """The topic's full name."""
        return self._node.resolve_topic_name(f'{self._prefix}/{part}')

    @property
    def type_name(self) -> str:
        """Such as resting_aspects_interfaces/msg/PartDescription."""
        return _type_name(self._type)

    def look(self) -> None:
        """Look for new topics now."""
        published = published_parts(self._node, self._prefix, self._type)
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
    """The parts of which somebody publishes a topic <prefix>/<part> of that type."""
    beginning = node.resolve_topic_name(f'{prefix}/part').removesuffix('part')
    return {
        name.removeprefix(beginning)
        for name, types in node.get_topic_names_and_types()
        if name.startswith(beginning)
        and is_valid_name(name.removeprefix(beginning))
        and _type_name(message_type) in types
        and node.count_publishers(name)
    }


def _type_name(message_type: Any) -> str:
    return f'{message_type.__module__.split(".")[0]}/msg/{message_type.__name__}'
