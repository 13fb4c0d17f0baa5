"""Live counts of a machine: observed_counts/<part> in, posterior/<part> and drift out."""

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from rclpy.node import Node
from resting_aspects_interfaces.msg import ObservedCounts as ObservedCountsMsg
from resting_aspects_interfaces.msg import Posterior

from resting_aspects_ros.api.compare import drift_test
from resting_aspects_ros.api.counts import single_groups
from resting_aspects_ros.arrays import Counts
from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.errors import InvalidValueError, RestingAspectsError
from resting_aspects_ros.nodes.aspect_classifier.counting import Tallies
from resting_aspects_ros.nodes.aspect_classifier.known import PartRegistry, TransitionStore
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.drift import drift_sentence
from resting_aspects_ros.ros.callbacks import PartTopics, WorkTimer, guarded_task, start_task
from resting_aspects_ros.ros.count_conversions import (
    add_action,
    add_drift,
    posterior_msg,
    time_label,
    totals_from,
)
from resting_aspects_ros.ros.distribution_conversions import transition_matrix_from
from resting_aspects_ros.ros.file_worker import FileWorker
from resting_aspects_ros.ros.health import TopicDiscovery
from resting_aspects_ros.ros.interface import COUNTS, LATCHED, OBSERVED_COUNTS, POSTERIOR
from resting_aspects_ros.ros.program import Parameter
from resting_aspects_ros.simulation.job import RunDescription
from resting_aspects_ros.statistics.counted_parts import (
    PRIOR_WEIGHT,
    BatchSeries,
    CountSessions,
    LiveCounts,
)
from resting_aspects_ros.statistics.distribution import Distribution
from resting_aspects_ros.statistics.drift import (
    LEVEL,
    MAX_LEVEL,
    MIN_LEVEL,
    DriftTest,
    TooFewDropsError,
    parts_needed,
)
from resting_aspects_ros.statistics.intervals import CONFIDENCE
from resting_aspects_ros.statistics.transitions import no_actions

# Maximum number of messages that wait for their part; they contain totals.
MAX_WAITING = 100


@dataclass(eq=False)
class LivePart:
    """A version of a part, and what has been counted of it.

    known : the run of the simulated drops and their distribution; None: no drops are known
    window : minimum number of parts in a window; 0 while it is not known
    tested : the test of the windows; None before the first full window
    attempted : number of parts in the windows that were tested last, or failed to be
    problem : why the last message was refused; empty if it was not
    test_problem : why drift is not tested; empty if it is
    changed : whether there is something new to be published
    """

    part: Part
    aspects: AspectSet
    sessions: CountSessions
    batches: BatchSeries = field(default_factory=BatchSeries)
    known: tuple[RunDescription, Distribution] | None = None
    window: int = 0
    tested: DriftTest | None = None
    attempted: int = 0
    problem: str = ''
    test_problem: str = ''
    changed: bool = False

    @property
    def ids(self) -> tuple[int, ...]:
        """Numbers of the symmetry classes."""
        return tuple(members[0].symmetry_class for members in self.aspects.classes())

    @property
    def can_drift(self) -> bool:
        """Whether there are drops to compare with, and more than one class."""
        return self.known is not None and bool(self.known[1].counts.any()) and len(self.ids) > 1

    @property
    def simulated(self) -> Counts:
        """(c,) simulated drops; one of each class if none is known, as a prior."""
        if self.known is None or not self.known[1].counts.any():
            return np.ones(len(self.ids), dtype=np.int64)
        return self.known[1].by_class().counts

    @property
    def is_drifting(self) -> bool:
        """Whether the newest parts deviate from the simulation."""
        if self.tested is None:
            return False
        drifted = self.tested.drifted
        return len(drifted) > 0 and drifted.stop == len(self.tested.windows)

    def live(self, weight: float) -> LiveCounts:
        """Return the counts with the simulation as the prior of a weight, in parts."""
        return LiveCounts(self.ids, self.simulated, self.sessions.supplied, weight)


def default_window(simulated: Counts, level: float) -> int:
    """Return the number of parts that find a class that deviates by 5 points.

    It is the number of drops if these are too few for it, and grows with them. Runs in a
    FileWorker.
    """
    try:
        return parts_needed(simulated, level=level)
    except TooFewDropsError:
        return int(simulated.sum())


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


@dataclass(eq=False)
class LiveMonitor:
    """Subscribes to observed_counts/*, publishes posterior/<part>, and tests drift.

    worker : tests drift, so that it does not block the node
    """

    node: Node
    parts: PartRegistry
    known: Tallies
    transitions: TransitionStore
    worker: FileWorker

    def __post_init__(self) -> None:
        self._weight, self._window, self._level = (
            self.node.get_parameter(each.name).value for each in LIVE_PARAMETERS
        )
        self._live: dict[str, LivePart] = {}
        self._waiting: deque[tuple[str, ObservedCountsMsg]] = deque(maxlen=MAX_WAITING)
        self._topics = PartTopics(self.node, Posterior, POSTERIOR, LATCHED)
        self._updating = False
        TopicDiscovery(self.node, OBSERVED_COUNTS, ObservedCountsMsg, self._receive, qos=COUNTS)
        self._timer = WorkTimer(self.node, PERIOD, 'counts are not used', self._start_update)

    def counts(self, part: Part) -> tuple[LiveCounts, Mapping[str, Counts]] | None:
        """Return what was counted of a version of a part, and moved by action; None: nothing."""
        live = self._live.get(part.name)
        if live is None or live.part.part_sha256 != part.part_sha256:
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
        waiting = sorted({name for name, _ in self._waiting})
        return found + [f'counts of {name} wait: no such part is offered' for name in waiting]

    def _receive(self, name: str, message: ObservedCountsMsg) -> None:
        self._waiting.append((name, message))
        self._take_waiting()
        self._timer.start()

    def _take_waiting(self) -> None:
        """Take the messages of parts that are offered, in their order; the others wait."""
        waiting, self._waiting = self._waiting, deque(maxlen=MAX_WAITING)
        for name, message in waiting:
            live = self._current(name)
            if live is None:
                self._waiting.append((name, message))
            else:
                self._take(live, message)

    def _current(self, name: str) -> LivePart | None:
        """Return the state of the offered version of a part; None if it is not known yet."""
        offered, live = self.parts.get(name), self._live.get(name)
        if offered is None or (live and live.part.part_sha256 == offered.part_sha256):
            return live  # without a simulator, no part is offered
        if live is not None:
            self.node.get_logger().warning(
                f'{name} has changed (part_sha256 {offered.part_sha256}): its '
                f'{live.sessions.parts} counted parts are forgotten'
            )
        part, aspects = self.parts.version(offered.part_sha256)
        self._live[name] = LivePart(part, aspects, CountSessions(len(aspects.classes())))
        return self._live[name]

    def _take(self, live: LivePart, message: ObservedCountsMsg) -> None:
        """Add the parts of a message; a message that is not valid changes nothing."""
        now = int(self.node.get_clock().now().nanoseconds)
        name = live.part.name
        try:
            totals = totals_from(message, name, live.part.part_sha256)
            new = live.sessions.add(totals, now)
        except InvalidValueError as error:
            if live.problem != str(error):
                self.node.get_logger().warning(f'ignored counts of {name}: {error}')
            live.problem = str(error)
            return
        live.problem = ''
        live.batches.add(new, totals.time or now)
        live.changed = True

    def _start_update(self) -> bool:
        """Start an update; returns whether there are counts, which new drops affect too."""
        self._take_waiting()
        if self._live and not self._updating:
            self._updating = True
            start_task(self.node, 'posteriors are not published', self._update_all)
        return bool(self._live or self._waiting)

    async def _update_all(self) -> None:
        for name in list(self._live):
            update = guarded_task(self.node, 'a posterior is not published', self._update_part)
            await update(name)
        self._updating = False

    async def _update_part(self, name: str) -> None:
        """Follow the newest simulation, test the new windows, and publish a changed posterior."""
        live = self._current(name)
        assert live is not None  # the name is known
        newest = self.known.newest(live.part.part_sha256, ended=True)
        was_drifting = live.is_drifting
        try:
            if newest and (live.known is None or newest.counted is not live.known[1]):
                live.known, live.tested, live.attempted = (newest.run, newest.counted), None, 0
                live.test_problem, live.changed = '', True
                size = self._window
                if live.can_drift and not size:
                    size = await self.worker.run(default_window, live.simulated, self._level)
                live.window = size
            untested = live.batches.parts - live.attempted
            if live.can_drift and untested >= max(live.window, 1):  # a failed test is not repeated
                await self._test(live)
        except RestingAspectsError as error:  # the posterior is published in any case
            live.test_problem = f'drift is not tested: {error}'
            self.node.get_logger().warning(f'{live.part.name}: {live.test_problem}')
        if live.is_drifting and live.tested is not None and not was_drifting:
            self.node.get_logger().warning(f'{live.part.name}: {drift_sentence(live.tested)}')
        if live.changed and self._live[name] is live:
            self._publish(name, live)

    async def _test(self, live: LivePart) -> None:
        """Test all full windows; further ones can become full meanwhile."""
        observed = live.batches.observed(single_groups(live.ids), time_label)
        live.attempted = int(observed.windows(live.window)[1][-1])
        live.tested = await self.worker.run(
            drift_test, observed, live.simulated, live.window, self._level
        )
        live.test_problem, live.changed = '', True

    def _publish(self, name: str, live: LivePart) -> None:
        live.changed = False
        message = posterior_msg(
            name,
            live.part.part_sha256,
            live.live(self._weight),
            live.known[0] if live.known else None,
            CONFIDENCE,
            self.node.get_clock().now().to_msg(),
        )
        message.level = self._level
        message.window = live.window if live.can_drift else 0
        if live.tested is not None:
            add_drift(message, live.tested)
        for action, counts in live.sessions.moved.items():
            known = self.transitions.find(name, live.part.part_sha256, action)
            matrix = transition_matrix_from(known) if known else no_actions(live.aspects)
            add_action(message, action, counts, matrix, known.run.run_id if known else '')
        self._topics.publish(name, message)
