"""A look at who else publishes what only one node should."""

from collections.abc import Sequence

from rclpy.node import Node

# How often it is looked, s. rclpy has no event for it.
PERIOD = 1.0


class OtherPublishers:
    """Warns once if another node publishes one of the topics that a node publishes, too.

    topics : their full names
    """

    def __init__(self, node: Node, topics: Sequence[str]) -> None:
        self._node = node
        self._topics = topics
        self._timer = node.create_timer(PERIOD, self._look)

    def _look(self) -> None:
        for topic in self._topics:
            found = self._node.get_publishers_info_by_topic(topic)
            if len(found) < 2:
                continue
            names = sorted(f'{e.node_namespace.rstrip("/")}/{e.node_name}' for e in found)
            self._node.get_logger().warning(
                f'{topic} has {len(found)} publishers, {", ".join(names)}: readers get both'
            )
            self._timer.cancel()
            return
