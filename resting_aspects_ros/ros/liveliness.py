"""Which nodes of the suite are alive in a namespace, as DDS notices it, within seconds.

In the graph of ROS a node that was killed is there for 20 s more. So each node has a publisher on
a hidden topic of its kind, which never publishes, and DDS tells who subscribes how many of those
are alive.
"""

import math
import time

from rclpy.duration import Duration
from rclpy.event_handler import (
    QoSLivelinessChangedInfo,
    QoSSubscriptionMatchedInfo,
    SubscriptionEventCallbacks,
)
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import LivelinessPolicy, QoSProfile
from std_msgs.msg import Empty

from resting_aspects_ros.ros.callbacks import advertise
from resting_aspects_ros.ros.interface import PRESENCE

# A node that was killed, or is held up as a whole, is taken for alive so long, s.
LEASE = 4.0
# One that was killed and the one that was started in its place are not two: both are alive for
# LEASE at most. Two are two after so long, s.
SURE = 1.5 * LEASE


class LivelinessMonitor:
    """The nodes of a kind that are alive in the namespace of a node, also of its own process.

    was_there : bool
        Whether there has been one.
    replaced : float
        When a further one appeared after the first, on the monotonic clock, s.
    """

    def __init__(self, node: Node, kind: str) -> None:
        self.was_there = False
        self.replaced = -math.inf
        self._there = self._dead = 0
        node.create_subscription(
            Empty,
            f'{PRESENCE}/{kind}',
            lambda _: None,
            _qos(),
            event_callbacks=SubscriptionEventCallbacks(
                matched=self._matched, liveliness=self._changed, use_default_callbacks=False
            ),
        )

    @property
    def count(self) -> int:
        """How many there are now."""
        return max(0, self._there - self._dead)

    def _matched(self, event: QoSSubscriptionMatchedInfo) -> None:
        self._there = event.current_count
        if self.was_there and event.total_count_change > 0:
            self.replaced = time.monotonic()
        self.was_there = True

    def _changed(self, event: QoSLivelinessChangedInfo) -> None:
        # Those of its own process are not among the living here: DDS knows that they are.
        self._dead = event.not_alive_count


class DuplicateNodeDetector:
    """Announces a node, and notices others of its kind in its namespace.

    harmless : what it means that there are several; empty: requests are answered by chance
    """

    def __init__(self, node: Node, kind: str, harmless: str = '') -> None:
        announce(node, kind)
        self._node = node
        self._kind = kind
        self._living = LivelinessMonitor(node, kind)
        self.harmless = harmless
        self._since: float | None = None
        self._told = False

    def look(self) -> str:
        """What is wrong, in words; to be asked often. Logged once, and again if it comes back."""
        now = time.monotonic()
        if self._living.count < 2:
            self._since, self._told = None, False
            return ''
        self._since = now if self._since is None else self._since
        if now - self._since < SURE:
            return ''
        words = (
            f'{self._living.count} {self._kind}s in namespace {self._node.get_namespace()}: '
            f'{self.harmless or "use another namespace or ROS_DOMAIN_ID"}'
        )
        if not self._told:
            self._node.get_logger().warning(words)
            self._told = True
        return words


def announce(node: Node, kind: str) -> Publisher:
    """Let others see that the node is alive, until it is destroyed."""
    return advertise(node, Empty, f'{PRESENCE}/{kind}', _qos())


def _qos() -> QoSProfile:
    return QoSProfile(
        depth=1,
        liveliness=LivelinessPolicy.AUTOMATIC,
        liveliness_lease_duration=Duration(seconds=LEASE),
    )
