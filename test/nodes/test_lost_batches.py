"""Lost batches are detected, requested again and, if that fails, reported in a message.

The simulator here is a fake that loses batches on purpose; the poses are the engine's.
"""

import itertools
import math
import os

import pytest
from rclpy.action import ActionServer
from resting_aspects_interfaces.action import DropPart
from resting_aspects_interfaces.msg import (
    PartDescription,
    RestingPoses,
    Status,
)

from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.ros.conversions import conditions_msg, part_msg, poses_msg, time_msg
from resting_aspects_ros.ros.interface import DROP_SIMULATOR, LATCHED, POSES
from resting_aspects_ros.ros.liveliness import announce
from resting_aspects_ros.simulation.job import plan_run
from resting_aspects_ros.simulation.workers import drop_range
from resting_aspects_ros.statistics.distribution import count_poses

DROPS = 40
QUICK = {
    'nodes.run_tracking.tracker.CHECK_PERIOD': 0.2,
    'nodes.run_tracking.tracker.GRACE': 0.5,
    'nodes.run_tracking.tracker.REPLACED_GRACE': 1.0,
    'run_logs.recorder.END_TIMEOUT': 2.0,
}
QUIET = {'nodes.aspect_classifier.part_registry.QUIET_PERIOD': 1.0}


class FakeSimulator:
    """Offers the tetrahedron and answers each goal with the result of ``answer``.

    ``answer`` gets the run's name, the first drop and the end that are asked for, and gives a
    status and the batches to publish before it, each (run's name, first drop, end, last).
    """

    def __init__(self, client, part, conditions):
        node, self._tetrahedron, self.conditions = client.node, part, conditions
        self._aspects = find_aspects(part)
        self._out = node.create_publisher(RestingPoses, 'resting_poses', POSES)
        self._part = node.create_publisher(PartDescription, 'parts/tetrahedron', LATCHED)
        self._part.publish(part_msg(part))
        self._server = ActionServer(node, DropPart, 'drop_part', self._execute)
        self.node = node
        self.appear()

    def destroy(self):
        self._server.destroy()

    def appear(self):
        """Announce a simulator that is ready."""
        self._presence = announce(self.node, DROP_SIMULATOR)

    def disappear(self):
        """As DDS sees it when a simulator is killed."""
        self.node.destroy_publisher(self._presence)

    def begin(self, seed):
        """Take a seed and names of runs that no test before had."""
        self.answer = lambda name, first, end: (Status(), [])
        self.asked = []
        self.seed = seed
        job, self._run = plan_run(
            self._tetrahedron, self.conditions, seed=seed, drops=DROPS, run_id='', started=10**18
        )
        self._poses = drop_range(job, 0, DROPS)
        counted = count_poses(self._aspects, self._poses)
        self.counts = counted.counts.tolist()

    def run_id(self, name):
        return f'{name}_{self.seed}'

    def publish(self, name, first, end, last=False, **changes):
        batch = poses_msg(self._poses.between(first, end), self._run, time_msg(1), last)
        batch.run.run_id = self.run_id(name)
        for field, value in changes.items():
            setattr(batch.run, field, value)
        self._out.publish(batch)

    def _execute(self, handle):
        goal = handle.request
        status, batches = Status(), []
        if goal.seed == self.seed:  # else of a run that an earlier test left without its end
            name = goal.run_id.removesuffix(f'_{self.seed}')
            asked = (name, goal.first_drop, goal.first_drop + goal.drops)
            self.asked.append(asked)
            status, batches = self.answer(*asked)
        for batch in batches:
            self.publish(*batch)
        (handle.succeed if status.code == Status.OK else handle.abort)()
        run_id = self.run_id(batches[0][0]) if batches else ''
        return DropPart.Result(status=status, run_id=run_id, drops=goal.drops)


@pytest.fixture(scope='module')
def namespace():
    return f'/lost_{os.getpid()}'


@pytest.fixture(scope='module')
def client(connect, namespace):
    return connect(namespace)


@pytest.fixture(scope='module')
def fake(client, part, surfaces):
    fake = FakeSimulator(client, part('tetrahedron'), surfaces.get())
    yield fake
    fake.destroy()


@pytest.fixture
def simulator(fake, seeds=itertools.count(1)):  # noqa: B008 - one for all tests is meant
    fake.begin(next(seeds))
    return fake


@pytest.fixture(scope='module')
def classifier(start, namespace):
    return start('aspect_classifier', namespace, constants=QUICK | QUIET)


@pytest.fixture
def known(client, classifier, simulator):
    """Wait until all drops are known, and give their distribution."""

    def known():
        def found():
            answer = client.ask(
                drops=DROPS, surface='rubber_mat', seed=[simulator.seed], only_known=True
            )
            return answer.status.code == Status.OK and answer.distribution

        return client.wait(found, 'drops known')

    return known


def assert_whole(distribution, simulator):
    assert distribution.drops == DROPS
    assert [aspect.count for aspect in distribution.aspects] == simulator.counts


def repaired(name, first, end):
    """What a simulator that is whole does when it is asked for drops again."""
    return Status(), [(name, first, end, False)]


def whole_run(_, first, end):
    """A run without a gap."""
    return Status(), [('second', first, end, True)]


@pytest.mark.parametrize(
    ('sent', 'asked'),
    [
        ([(0, 10), (30, 40)], [(10, 30)]),
        ([(20, 40)], [(0, 20)]),
        ([(0, 10), (15, 20), (25, 40)], [(10, 15), (20, 25)]),
    ],
    ids=['middle', 'beginning', 'two gaps'],
)
def test_exactly_the_missing_drops_are_requested(simulator, known, sent, asked):
    simulator.answer = repaired
    for first, end in sent:
        simulator.publish('gapped', first, end, last=end == DROPS)
    assert_whole(known(), simulator)
    assert simulator.asked == [('gapped', *drops) for drops in asked]


def test_duplicate_batch_is_counted_once(simulator, known):
    for first, end in [(0, 20), (0, 20), (10, 30), (20, 40)]:
        simulator.publish('twice', first, end, last=end == DROPS)
    assert_whole(known(), simulator)
    assert simulator.asked == []


def test_failed_repair_is_retried(simulator, known):
    answers = [(Status(code=Status.BUSY, message='try later'), []), (Status(), [])]
    simulator.answer = lambda *asked: answers.pop() if answers else repaired(*asked)
    simulator.publish('gapped', 0, 10)
    simulator.publish('gapped', 20, 40, last=True)
    assert_whole(known(), simulator)
    assert simulator.asked == [('gapped', 10, 20)] * 3


def test_unrecoverable_drops_fail_the_request(simulator, client, classifier):
    refusal = Status(code=Status.FAILED, message='the engine is broken')
    holed = [('made', 0, 10, False), ('made', 20, 40, True)]
    simulator.answer = lambda name, *_: (refusal, []) if name else (Status(), holed)
    answer = client.ask(drops=DROPS, surface='rubber_mat', seed=[simulator.seed])
    assert answer.status.code == Status.FAILED
    assert answer.status.message == (
        f'run {simulator.run_id("made")} of tetrahedron is missing 10 of 40 drops, which could '
        'not be recovered'
    )
    assert simulator.asked == [('', 0, DROPS)] + [('made', 10, 20)] * 3
    assert 'the engine is broken' in classifier.output
    # What is not whole does not pass for known.
    assert (
        client.ask(
            drops=1, surface='rubber_mat', seed=[simulator.seed], only_known=True
        ).status.code
        == Status.NOT_AVAILABLE
    )
    simulator.answer = whole_run
    answer = client.ask(drops=DROPS, surface='rubber_mat', seed=[simulator.seed])
    assert answer.status.code == Status.OK
    assert_whole(answer.distribution, simulator)


@pytest.mark.parametrize(
    'end',
    [
        *(pytest.param(end, marks=pytest.mark.slow) for end in ('gone', 'replaced')),
        'replaced, late batch',
    ],
)
def test_drops_before_a_simulator_died_are_kept(
    simulator, client, connect, start, namespace, classifier, tmp_path, end
):
    """As they are after a restart, from its log."""
    recorder = start('drop_recorder', namespace, {'log_folder': tmp_path}, constants=QUICK)
    # The classifier and the recorder notice a restart only of a simulator that they know.
    client.wait(lambda: simulator._presence.get_subscription_count() >= 2, 'both know it')
    simulator.publish('short', 0, 10)
    late = end == 'replaced, late batch'
    if not late:
        simulator.publish('short', 10, 25)
    run_id = simulator.run_id('short')
    client.wait(lambda: list(tmp_path.glob(f'*_{run_id}')), 'log')

    def found(drops=25, client=client):
        answer = client.ask(
            drops=drops, seed=[simulator.seed], surface='rubber_mat', only_known=True
        )
        return answer.status.code == Status.OK and answer.distribution

    assert not found()
    if end == 'gone':
        simulator.disappear()
    else:
        gone = simulator._presence
        simulator.appear()
        if late:
            client.wait(
                lambda: simulator._presence.get_subscription_count() >= 2, 'both know the other'
            )
            simulator.publish('short', 10, 25)
        client.node.destroy_publisher(gone)
    before = client.wait(found, 'first drops')
    if end == 'gone':
        simulator.appear()
    assert not found(26)
    client.wait(lambda: list(tmp_path.glob(f'*_{run_id}/metadata.yaml')), 'closed log')
    assert recorder.end() == 0
    assert simulator.asked == []
    again = f'{namespace}_again_{simulator.seed}'
    start('aspect_classifier', again, {'log_folder': tmp_path}, QUIET)
    other = connect(again)
    after = other.wait(lambda: found(client=other), 'first drops')
    assert not found(26, other)
    before.header.stamp = after.header.stamp
    assert before == after


def test_recorder_closes_the_log_after_unrecoverable_loss(
    simulator, client, start, namespace, tmp_path
):
    recorder = start('drop_recorder', namespace, {'log_folder': tmp_path}, constants=QUICK)
    simulator.answer = lambda *_: (Status(code=Status.FAILED, message='no'), [])
    simulator.publish('gapped', 0, 10)
    simulator.publish('gapped', 20, 40, last=True)
    run_id = simulator.run_id('gapped')
    client.wait(lambda: list(tmp_path.glob(f'*_{run_id}/metadata.yaml')), 'closed log')
    drops = f'drops 10 to 19 of run {run_id} (tetrahedron)'
    for expected in ('were lost and are requested again', 'are not available: no'):
        client.wait(lambda expected=expected: f'{drops} {expected}' in recorder.output, expected)
    assert recorder.running


def test_batch_that_contradicts_its_run_is_rejected(simulator, known, classifier):
    simulator.publish('twofold', 0, 20)
    simulator.publish('twofold', 20, 40, seed=10**6)
    simulator.publish('twofold', 20, 40, last=True)
    assert_whole(known(), simulator)
    assert (
        f'a batch of run {simulator.run_id("twofold")} describes another run' in classifier.output
    )


def test_batch_with_invalid_conditions_is_not_counted(simulator, known, classifier):
    impossible = conditions_msg(simulator.conditions)
    impossible.gravity = math.nan
    simulator.publish('impossible', 0, 40, last=True, conditions=impossible)
    simulator.publish('good', 0, 40, last=True)
    assert_whole(known(), simulator)
