"""Transition matrices: those that a simulator or a replayer publishes, and those in logs."""

from collections.abc import Callable

from rclpy.node import Node
from rclpy.publisher import Publisher
from resting_aspects_interfaces.msg import TransitionMatrix
from resting_aspects_interfaces.srv import GetTransitions

from resting_aspects_ros.errors import shown
from resting_aspects_ros.nodes.aspect_classifier.part_registry import PartRegistry
from resting_aspects_ros.ros.callbacks import advertise
from resting_aspects_ros.ros.interface import LATCHED, TRANSITIONS
from resting_aspects_ros.ros.status import NotAvailableError, unknown_part
from resting_aspects_ros.ros.topic_discovery import TopicDiscovery
from resting_aspects_ros.ros.transition_conversions import check_numbering, check_transitions

# Maximum number of kept matrices.
MAX_KNOWN = 1000


class TransitionStore:
    """Subscribes to transitions/*, and keeps the newest matrix of each part and action.

    The simulator publishes the matrices of its runs. While no node publishes those of a part, the
    store does, so that late subscribers receive what was known before the simulator was restarted.
    """

    def __init__(self, node: Node, parts: PartRegistry) -> None:
        self._node = node
        self._parts = parts
        self._known: dict[tuple[str, str, str], TransitionMatrix] = {}
        self._published: dict[str, tuple[Publisher, str]] = {}  # by part, with the run id
        self._discovery = TopicDiscovery(
            node, TRANSITIONS, TransitionMatrix, self._receive, gone=self.publish
        )

    def __len__(self) -> int:
        """Return the number of known matrices."""
        return len(self._known)

    def add(self, message: TransitionMatrix) -> None:
        """Add a valid matrix."""
        key = (message.run.part, message.run.part_sha256, message.action.name)
        candidates = [message, self._known.pop(key, message)]
        self._known[key] = max(candidates, key=_order)
        while len(self._known) > MAX_KNOWN:
            self._known.pop(next(iter(self._known)))

    def find(self, part: str, part_sha256: str, action: str) -> TransitionMatrix | None:
        """Return the newest matrix of an action on a version of a part, or None."""
        return self._known.get((part, part_sha256, action))

    def publish(self, part: str) -> None:
        """Publish the newest matrix of a part, unless another node publishes its matrices."""
        known = [each for each in self._of(part) if each.ended]
        topic = self._discovery.topic(part)
        if not known or part in self._published or self._node.count_publishers(topic):
            return
        newest = max(known, key=_order)
        publisher = advertise(self._node, TransitionMatrix, topic, LATCHED)
        publisher.publish(newest)
        self._published[part] = (publisher, newest.run.run_id)

    async def answer(
        self, request: GetTransitions.Request, simulator_is_ready: Callable[[], bool]
    ) -> TransitionMatrix:
        """Return the requested matrix; raises RestingAspectsError."""
        name, action = request.part, request.action
        offered = await self._parts.usable(name, simulator_is_ready)
        of_part = self._of(name, offered[name].part_sha256 if name in offered else '')
        if name not in offered and (simulator_is_ready() or (offered and not of_part)):
            raise unknown_part(name, offered)
        known = [each for each in of_part if action in ('', each.action.name)]
        if known:
            return max(known, key=_order)
        actions = ', '.join(sorted(each.action.name for each in of_part))
        asked = f' by action {shown(action)}' if action else ''
        others = f'; known actions: {actions}' if actions else ''
        raise NotAvailableError(
            f'no transitions of {shown(name)}{asked} are known, request reorient_part{others}'
        )

    def _of(self, part: str, part_sha256: str = '') -> list[TransitionMatrix]:
        """Return the matrices of a version of a part; by default the offered one, else of all."""
        if not part_sha256 and (described := self._parts.get(part)) is not None:
            part_sha256 = described.part_sha256
        return [
            each
            for (name, sha, _), each in self._known.items()
            if name == part and part_sha256 in ('', sha)
        ]

    def _receive(self, part: str, message: TransitionMatrix) -> None:
        check_transitions(message, part)
        check_numbering(message)
        self.add(message)
        if part in self._published and message.run.run_id != self._published[part][1]:
            self._node.destroy_publisher(self._published.pop(part)[0])  # another node publishes


def _order(message: TransitionMatrix) -> tuple[object, ...]:
    """Sort key: complete matrices first, then by start, and within a run by progress."""
    started = message.run.started
    made = sum(message.actions)
    return (
        message.complete,
        started.sec,
        started.nanosec,
        message.run.run_id,
        made,
        message.ended,
    )
