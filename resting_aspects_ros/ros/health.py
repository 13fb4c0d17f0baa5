"""The health of nodes: what else is on the network, and the status on /diagnostics.

Topics of parts are discovered, and other nodes that are alive, and other clocks.
"""

import time
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any
from weakref import WeakKeyDictionary

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
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

from resting_aspects_ros.logs.topics import Topic
from resting_aspects_ros.part.part import is_valid_name
from resting_aspects_ros.ros.callbacks import advertise, guarded, steady_timer, subscribe
from resting_aspects_ros.ros.interface import DIAGNOSTICS, LATCHED, PRESENCE, offered_qos
from resting_aspects_ros.simulation.job import RunDescription

# Absolute: nodes with use_sim_time subscribe to this name. Remap it for two clocks in one domain.
CLOCK = '/clock'


def clock_conflicts(node: Node) -> list[str]:
    """Return a warning if another node publishes simulated time too; call this often.

    The warning is logged once.
    """
    topic = node.resolve_topic_name(CLOCK)
    count = node.count_publishers(topic)
    if count < 2:
        return []
    problem = f'{count} nodes publish {topic}: stop one, or remap it with -r {CLOCK}:=<other name>'
    node.get_logger().warning(problem, once=True)
    return [problem]


# Time for which a killed or blocked node still counts as alive, s.
LEASE = 4.0
# Time after which two alive nodes are reported as duplicates, s. A killed node and its replacement
# both count as alive for at most LEASE.
DUPLICATE_DELAY = 1.5 * LEASE


class LivelinessMonitor:
    """The alive nodes of one kind in the namespace of a node, including its own process.

    was_seen : bool
        Whether any node of this kind has been alive.
    """

    def __init__(self, node: Node, kind: str) -> None:
        self.was_seen = False
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

    def logged(self, part: str, profile: QoSProfile = LATCHED) -> Topic:
        """Return the topic of a part as a log has it, with the QoS that its publisher offers."""
        return Topic(self.topic(part), type_name(self._type), offered_qos(profile))

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
    kind = type_name(message_type)
    return {
        name.removeprefix(parent)
        for name, types in topics
        if name.startswith(parent)
        and name.removeprefix(parent) not in known
        and is_valid_name(name.removeprefix(parent))
        and kind in types
        and node.count_publishers(name)
    }


def type_name(message_type: Any) -> str:
    """Return the name of a type, such as resting_aspects_interfaces/msg/PartDescription."""
    return f'{message_type.__module__.split(".")[0]}/msg/{message_type.__name__}'


# -- status ---------------------------------------------------------------------------------------


# Each callback of a timer costs rclpy 3 ms: 0.3 % of a core at 1 Hz.
DIAGNOSTICS_PERIOD = 2.0
# The value that diagnostic_updater uses without a device.
HARDWARE_ID = 'none'
# Maximum number of entries of a mapping that diagnostics show.
MAX_LISTED = 10


@dataclass(frozen=True)
class Diagnosis:
    """The status of a node.

    state : text describing the current work; empty if the node is idle
    values : further values by name
    warnings : problems that do not stop the node from working
    errors : problems through which data are lost
    """

    state: str
    values: Mapping[str, object]
    warnings: Sequence[str] = ()
    errors: Sequence[str] = ()


class RateCounter:
    """A counter of events, and of their rate per second."""

    def __init__(self) -> None:
        self.total = 0
        self._previous = (0, time.monotonic())

    def add(self, number: int) -> None:
        """Count a number of further events."""
        self.total += number

    def rate(self) -> str:
        """Return the events per second since the previous call."""
        (total, then), now = self._previous, time.monotonic()
        self._previous = (self.total, now)
        return f'{(self.total - total) / max(now - then, 1e-9):.0f}'


def publish_diagnostics(
    node: Node, diagnose: Callable[[], Diagnosis], duplicates: DuplicateNodeDetector | None = None
) -> None:
    """Publish the result of ``diagnose`` every two seconds from now on, under the node's name.

    duplicates : detector of other nodes of the same kind, which the status then reports
    """
    publisher = advertise(node, DiagnosticArray, DIAGNOSTICS, 10)

    def publish() -> None:
        found = diagnose()
        if duplicates is not None and (problem := duplicates.check()):
            if duplicates.harmless_reason:
                found = replace(found, warnings=[problem, *found.warnings])
            else:
                found = replace(found, errors=[problem, *found.errors])
        level = DiagnosticStatus.WARN if found.warnings else DiagnosticStatus.OK
        parts = [*found.errors, *found.warnings, *([found.state] if found.state else [])]
        status = DiagnosticStatus(
            level=DiagnosticStatus.ERROR if found.errors else level,
            name=node.get_fully_qualified_name().removeprefix('/'),
            message='; '.join(parts) or 'idle',
            hardware_id=HARDWARE_ID,
            values=[KeyValue(key=key, value=str(value)) for key, value in found.values.items()],
        )
        message = DiagnosticArray(status=[status])
        message.header.stamp = node.get_clock().now().to_msg()
        publisher.publish(message)

    steady_timer(node, DIAGNOSTICS_PERIOD, guarded(node, 'diagnostics are not published', publish))


# -- texts ----------------------------------------------------------------------------------------


def count_text(number: int, one: str, more: str) -> str:
    """Return a number with its noun: '1 run', '2 runs'."""
    return f'{number} {one if number == 1 else more}'


def progress_text(run: RunDescription, drops: int, unit: str = 'drops') -> str:
    """Return the progress of a run, such as '3000 of 20000 drops'."""
    bound = 'at most ' if run.precision else ''
    return f'{drops} of {bound}{count_text(run.drops, unit[:-1], unit)}'


def active_runs_text(runs: Sequence[tuple[RunDescription, int]]) -> str:
    """Return the progress of the first run and the number of others; empty without a run."""
    if not runs:
        return ''
    run, drops = runs[0]
    more = f', and {count_text(len(runs) - 1, "more run", "more runs")}' if runs[1:] else ''
    return f'{run.part}: {progress_text(run, drops)}{more}'


def run_values(runs: Sequence[tuple[RunDescription, int]]) -> dict[str, object]:
    """Return the number of active runs and the progress of each, for diagnostics."""
    each = {
        f'run {k}': f'{run.part}: {progress_text(run, drops)}, run {run.run_id}'
        for k, (run, drops) in enumerate(runs, 1)
    }
    return {'active runs': len(runs), **truncated(each)}


def truncated(values: Mapping[str, str]) -> dict[str, str]:
    """Return the first MAX_LISTED entries, and the number of entries left out."""
    shown = dict(list(values.items())[:MAX_LISTED])
    if len(values) > MAX_LISTED:
        shown['not shown'] = f'{len(values) - MAX_LISTED} more'
    return shown
