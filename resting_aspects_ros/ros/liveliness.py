"""Node liveliness, detected through DDS within seconds.

The ROS graph lists a killed node for another 20 s. Therefore each node has a publisher on a hidden
topic for its kind of node. It never publishes; DDS reports the number of alive publishers to
subscribers of the topic.
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

# Time for which a killed or blocked node still counts as alive, s.
LEASE = 4.0
# Time after which two alive nodes are reported as duplicates, s. A killed node and its replacement
# both count as alive for at most LEASE.
DUPLICATE_DELAY = 1.5 * LEASE


class LivelinessMonitor:
    """The alive nodes of one kind in the namespace of a node, including its own process.

    was_seen : bool
        Whether any node of this kind has been alive.
    replaced_at : float
        Time at which the most recent node after the first one appeared, on the monotonic clock, s.
    """

    def __init__(self, node: Node, kind: str) -> None:
        self.was_seen = False
        self.replaced_at = -math.inf
        self._matched = self._dead = 0
        node.create_subscription(
            Empty,
            f'{PRESENCE}/{kind}',
            lambda _: None,
            _qos(),
            event_callbacks=SubscriptionEventCallbacks(
                matched=self._on_matched,
                liveliness=self._on_liveliness,
                use_default_callbacks=False,
            ),
        )

    @property
    def count(self) -> int:
        """The number of nodes that are alive now."""
        return max(0, self._matched - self._dead)

    def _on_matched(self, event: QoSSubscriptionMatchedInfo) -> None:
        self._matched = event.current_count
        # A single event can report the first node and its replacement.
        if event.total_count_change > (0 if self.was_seen else 1):
            self.replaced_at = time.monotonic()
        self.was_seen = True

    def _on_liveliness(self, event: QoSLivelinessChangedInfo) -> None:
        # alive_count excludes the nodes of this process: DDS knows that they are alive.
        self._dead = event.not_alive_count


class DuplicateNodeDetector:
    """Announces a node, and detects other nodes of the same kind in its namespace.

    harmless_reason : why duplicates do no harm; empty: any of them may answer a request
    part : the part of a node that is for one part only, of which there may be one for each part
    """

    def __init__(
        self, node: Node, kind: str, harmless_reason: str = '', *, part: str = ''
    ) -> None:
        topic = f'{kind}/{part}' if part else kind
        announce(node, topic)
        self._node = node
        self._kinds = f'{kind}s of {part}' if part else f'{kind}s'
        self._monitor = LivelinessMonitor(node, topic)
        self.harmless_reason = harmless_reason
        self._since: float | None = None
        self._logged = False

    def check(self) -> str:
        """Return a description of the duplicates, or ''; call this often.

        The description is logged once each time that duplicates appear.
        """
        now = time.monotonic()
        if self._monitor.count < 2:
            self._since, self._logged = None, False
            return ''
        self._since = now if self._since is None else self._since
        if now - self._since < DUPLICATE_DELAY:
            return ''
        problem = (
            f'{self._monitor.count} {self._kinds} in namespace {self._node.get_namespace()}: '
            f'{self.harmless_reason or "use another namespace or ROS_DOMAIN_ID"}'
        )
        if not self._logged:
            self._node.get_logger().warning(problem)
            self._logged = True
        return problem


def announce(node: Node, kind: str) -> Publisher:
    """Return the publisher that shows that the node is alive, until it is destroyed."""
    return advertise(node, Empty, f'{PRESENCE}/{kind}', _qos())


def _qos() -> QoSProfile:
    return QoSProfile(
        depth=1,
        liveliness=LivelinessPolicy.AUTOMATIC,
        liveliness_lease_duration=Duration(seconds=LEASE),
    )
