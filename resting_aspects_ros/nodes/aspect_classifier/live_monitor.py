"""Live counts of a machine: observed_counts/<part> in, posterior/<part> and drift out."""

from collections.abc import Iterator, Mapping

from rclpy.node import Node
from rclpy.publisher import Publisher
from resting_aspects_interfaces.msg import MachineTransitions, ObservedCounts, Posterior

from resting_aspects_ros.api.drift import drift_test
from resting_aspects_ros.arrays import Counts
from resting_aspects_ros.errors import InvalidValueError, RestingAspectsError
from resting_aspects_ros.nodes.aspect_classifier.distribution_store import (
    DistributionStore,
    Known,
)
from resting_aspects_ros.nodes.aspect_classifier.live_part import LivePart, default_window
from resting_aspects_ros.nodes.aspect_classifier.part_registry import PartRegistry
from resting_aspects_ros.nodes.aspect_classifier.transition_store import TransitionStore
from resting_aspects_ros.nodes.aspect_classifier.waiting_counts import WaitingCounts
from resting_aspects_ros.report.drift import drift_sentence
from resting_aspects_ros.ros.callbacks import advertise, guarded, guarded_task, steady_timer
from resting_aspects_ros.ros.count_conversions import (
    add_drift,
    machine_transitions_msg,
    posterior_msg,
    totals_from,
)
from resting_aspects_ros.ros.file_worker import FileWorker
from resting_aspects_ros.ros.interface import COUNTS, LATCHED, OBSERVED_COUNTS, POSTERIOR
from resting_aspects_ros.ros.parameters import Parameter
from resting_aspects_ros.ros.topic_discovery import TopicDiscovery
from resting_aspects_ros.ros.transition_conversions import transition_matrix_from
from resting_aspects_ros.statistics.counted_parts import PRIOR_WEIGHT, LiveCounts
from resting_aspects_ros.statistics.drift import LEVEL, MAX_LEVEL, MIN_LEVEL
from resting_aspects_ros.statistics.intervals import CONFIDENCE
from resting_aspects_ros.statistics.transitions import no_actions

PERIOD = 0.5
# Maximum number of parts that a parameter can state.
MAX_SET = 100_000
LIVE_PARAMETERS = (
    Parameter(
        'prior_weight',
        PRIOR_WEIGHT,
        'weight of the simulation in posterior/<part>, in parts',
        (0.001, float(MAX_SET)),
    ),
    Parameter(
        'drift_window',
        0,
        'minimum number of counted parts that are tested together; 0: as many as find a class '
        'that deviates by 5 points with a probability of 80 %',
        (0, MAX_SET),
    ),
    Parameter(
        'drift_level',
        LEVEL,
        'probability of a false alarm in each window of parts',
        (MIN_LEVEL, MAX_LEVEL),
    ),
)


class LiveMonitor:
    """Subscribes to observed_counts/*, publishes posterior/<part>, and tests drift.

    Parameters
    ----------
    known : the simulated drops
    transitions : the simulated transitions
    worker : tests drift, so that it does not block the node
    """

    def __init__(
        self,
        node: Node,
        parts: PartRegistry,
        known: DistributionStore,
        transitions: TransitionStore,
        worker: FileWorker,
    ) -> None:
        self._node = node
        self._parts = parts
        self._known = known
        self._transitions = transitions
        self._worker = worker
        self._weight, self._window, self._level = (
            node.get_parameter(each.name).value for each in LIVE_PARAMETERS
        )
        self._live: dict[str, LivePart] = {}
        self._waiting = WaitingCounts()
        self._outputs: dict[str, Publisher] = {}
        self._updating = False
        self._update_one = guarded_task(node, 'a posterior is not published', self._update_part)
        TopicDiscovery(node, OBSERVED_COUNTS, ObservedCounts, self._receive, qos=COUNTS)
        update = guarded(node, 'counts are not used', self._start_update)
        steady_timer(node, PERIOD, update)

    def counts(
        self, name: str, part_sha256: str
    ) -> tuple[LiveCounts, Mapping[str, Counts]] | None:
        """Return what was counted of a version of a part, and moved by action; None: nothing."""
        live = self._live.get(name)
        if live is None or live.part.part_sha256 != part_sha256:
            return None
        return live.live(self._weight), live.sessions.moved

    @property
    def counted(self) -> int:
        """Number of counted parts."""
        return sum(each.sessions.parts for each in self._live.values())

    def warnings(self) -> list[str]:
        """Return drift, failed tests, refused messages, and counts of parts not offered."""
        found = []
        for name, live in self._live.items():
            if live.is_drifting and live.tested is not None:
                found.append(f'{name}: {drift_sentence(live.tested)}')
            problems = live.problem, live.test_problem
            found += [f'{name}: {problem}' for problem in problems if problem]
        return found + [
            f'counts of {name} wait: no such part is offered' for name in self._waiting.names
        ]

    def _receive(self, name: str, message: ObservedCounts) -> None:
        self._take_waiting()  # those of the part arrived before
        if (live := self._current(name)) is None:
            self._waiting.add(name, message)
        else:
            self._take(live, message)

    def _take_waiting(self) -> None:
        for name, message in self._waiting.take(self._current):
            self._take(self._live[name], message)

    def _current(self, name: str) -> LivePart | None:
        """Return the state of the offered version of a part; None if it is not known yet."""
        offered, live = self._parts.get(name), self._live.get(name)
        if offered is None or (live and live.part.part_sha256 == offered.part_sha256):
            return live  # without a simulator, no part is offered
        if live is not None:
            self._node.get_logger().warning(
                f'{name} has changed (part_sha256 {offered.part_sha256}): its '
                f'{live.sessions.parts} counted parts are forgotten'
            )
        self._live[name] = LivePart.of(*self._parts.version(offered.part_sha256))
        return self._live[name]

    def _take(self, live: LivePart, message: ObservedCounts) -> None:
        """Add the parts of a message; a message that is not valid changes nothing."""
        now = int(self._node.get_clock().now().nanoseconds)
        name = live.part.name
        try:
            totals = totals_from(message, name, live.part.part_sha256)
            new = live.sessions.add(totals, now)
        except InvalidValueError as error:
            if live.problem != str(error):
                self._node.get_logger().warning(f'ignored counts of {name}: {error}')
            live.problem = str(error)
            return
        live.problem = ''
        live.batches.add(new, totals.time or now)
        live.changed = True

    def _start_update(self) -> None:
        self._take_waiting()
        if self._updating or not self._live:
            return
        self._updating = True
        assert self._node.executor is not None  # it calls this
        self._node.executor.create_task(self._update_all)

    async def _update_all(self) -> None:
        for name in list(self._live):
            await self._update_one(name)
        self._updating = False

    async def _update_part(self, name: str) -> None:
        """Test drift of a part, and publish its posterior if it has changed."""
        live = self._current(name)
        assert live is not None  # the name is known
        await self._update(live)
        if live.changed and self._live[name] is live:
            self._publish(name, live)

    async def _update(self, live: LivePart) -> None:
        """Follow the newest simulation, and test the windows that are new."""
        known, was_drifting = self._newest(live.part.part_sha256), live.is_drifting
        try:
            if known is not None and (live.known is None or known[1] is not live.known[1]):
                live.follow(known)
                size = self._window
                if live.can_drift and not size:
                    size = await self._worker.run(default_window, live.simulated, self._level)
                live.window = size
            if live.can_drift and not live.is_tested:
                test = await self._worker.run(
                    drift_test, live.observed(), live.simulated, live.window, self._level
                )
                live.add_test(test)
        except RestingAspectsError as error:  # the posterior is published in any case
            live.test_problem = f'drift is not tested: {error}'
            self._node.get_logger().warning(f'{live.part.name}: {live.test_problem}')
        if live.is_drifting and live.tested is not None and not was_drifting:
            self._node.get_logger().warning(f'{live.part.name}: {drift_sentence(live.tested)}')

    def _newest(self, part_sha256: str) -> Known | None:
        """Return the largest run under the conditions of the newest run."""
        newest = self._known.newest(part_sha256)
        if newest is None:
            return None
        return self._known.find(part_sha256, newest[0].conditions, 0, 0.0, None)

    def _publish(self, name: str, live: LivePart) -> None:
        live.changed = False
        message = posterior_msg(
            name,
            live.part.part_sha256,
            live.live(self._weight),
            live.known[0] if live.known else None,
            CONFIDENCE,
            self._node.get_clock().now().to_msg(),
        )
        message.level = self._level
        message.window = live.window if live.can_drift else 0
        if live.tested is not None:
            add_drift(message, live.tested)
        message.transitions = list(self._moved(live))
        if name not in self._outputs:
            topic = f'{POSTERIOR}/{name}'
            self._outputs[name] = advertise(self._node, Posterior, topic, LATCHED)
        self._outputs[name].publish(message)

    def _moved(self, live: LivePart) -> Iterator[MachineTransitions]:
        for action, counts in live.sessions.moved.items():
            known = self._transitions.find(live.part.name, live.part.part_sha256, action)
            matrix = transition_matrix_from(known) if known else no_actions(live.aspects)
            run_id = known.run.run_id if known else ''
            yield machine_transitions_msg(action, counts, matrix, run_id)
