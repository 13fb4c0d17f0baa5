"""Drops whose messages are missing are requested again, and the others are kept.

The simulator here is a fake that leaves messages out on purpose; the poses are the engine's.
"""

import itertools
import os

import pytest
from rclpy.action import ActionServer
from resting_aspects_interfaces.action import DropPart
from resting_aspects_interfaces.msg import PartDescription, RestingPoses, Status

from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.logs.bag import LogOutcome, recorded_outcome
from resting_aspects_ros.ros.conversions import part_msg, poses_msgs, time_msg
from resting_aspects_ros.ros.discovery import announce
from resting_aspects_ros.ros.interface import DROP_SIMULATOR, LATCHED, POSES
from resting_aspects_ros.simulation.job import plan_run
from resting_aspects_ros.simulation.workers import drop_range
from resting_aspects_ros.statistics.distribution import count_poses

DROPS = 40
SHORTER = {
    'ros.goal_client.ARRIVAL_TIMEOUT': 0.3,
    'nodes.aspect_classifier.services.ARRIVAL_TIMEOUT': 0.3,
    'nodes.aspect_classifier.services.COUNT_TIMEOUT': 0.3,
    'nodes.drop_recorder.node.IDLE_WITHOUT_SOURCE': 0.3,
    'nodes.drop_recorder.node.END_TIMEOUT': 2.0,
}


class FakeSimulator:
    """Offers the tetrahedron and answers each goal with the result of ``answer``.

    ``answer`` gets the run id, the first drop and the end that are requested, and returns a status
    and the messages to publish before it, each (run id, first drop, end, last).
    """

    def __init__(self, client, part, conditions):
        self.node, self._part, self._conditions = client.node, part, conditions
        self._out = self.node.create_publisher(RestingPoses, 'resting_poses', POSES)
        self._parts = self.node.create_publisher(PartDescription, 'parts/tetrahedron', LATCHED)
        self._parts.publish(part_msg(part))
        self._server = ActionServer(self.node, DropPart, 'drop_part', self._execute)
        self._presence = announce(self.node, DROP_SIMULATOR)

    def destroy(self):
        self._server.destroy()

    def disappear(self):
        """As DDS sees it when a simulator is killed."""
        self.node.destroy_publisher(self._presence)

    def begin(self, seed):
        """Use a seed and run ids that no other test uses."""
        self.answer = lambda name, first, end: (Status(), [])
        self.asked = []
        self.seed = seed
        job, self._run = plan_run(
            self._part, self._conditions, seed=seed, drops=DROPS, run_id='x', started=10**18
        )
        self._poses = drop_range(job, 0, DROPS)
        self.counts = count_poses(find_aspects(self._part), self._poses).counts.tolist()

    def run_id(self, name):
        return f'{name}_{self.seed}'

    def publish(self, name, first, end, last=False):
        poses = self._poses.between(first, end)
        (message,) = poses_msgs(poses, self._run, time_msg(1), last=last)
        message.run.run_id = self.run_id(name)
        self._out.publish(message)

    def _execute(self, handle):
        goal = handle.request
        name = goal.run_id.removesuffix(f'_{self.seed}')
        asked = name, goal.first_drop, goal.first_drop + goal.drops
        self.asked.append(asked)
        status, messages = self.answer(*asked)
        for each in messages:
            self.publish(*each)
        (handle.succeed if status.code == Status.OK else handle.abort)()
        run_id = self.run_id(messages[0][0]) if messages else goal.run_id
        return DropPart.Result(status=status, run_id=run_id, drops=goal.drops)


@pytest.fixture(scope='module')
def logs(tmp_path_factory):
    return tmp_path_factory.mktemp('logs')


@pytest.fixture(scope='module')
def client(connect, start, logs):
    namespace = f'/missing_{os.getpid()}'
    for node in ('aspect_classifier', 'drop_recorder'):
        start(node, namespace, {'log_folder': logs}, SHORTER)
    return connect(namespace)


@pytest.fixture(scope='module')
def fake(client, part, surfaces):
    fake = FakeSimulator(client, part('tetrahedron'), surfaces.get())
    client.wait(lambda: 'tetrahedron' in client.parts(), 'part')
    yield fake
    fake.destroy()


@pytest.fixture
def simulator(fake, seeds=itertools.count(1)):  # noqa: B008 - one for all tests is meant
    fake.begin(next(seeds))
    return fake


@pytest.fixture
def known(client, simulator):
    """Wait until a number of drops is known, and return their distribution."""

    def known(drops=DROPS):
        def found():
            answer = client.ask(
                drops=drops, surface='rubber_mat', seed=[simulator.seed], only_known=True
            )
            return answer.status.code == Status.OK and answer.distribution

        return client.wait(found, 'drops known')

    return known


@pytest.fixture
def outcome(client, simulator, logs):
    """Return the outcome of the log of a run, once it is closed."""

    def outcome(name):
        pattern = f'*_{simulator.run_id(name)}/metadata.yaml'
        client.wait(lambda: list(logs.glob(pattern)), 'closed log')
        return recorded_outcome(next(logs.glob(pattern)).parent)

    return outcome


def again(name, first, end):
    """Answer as a simulator that publishes the requested drops again."""
    return Status(), [(name, first, end, False)]


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize(
    ('sent', 'asked'),
    [
        ([(20, 40)], {(0, 20)}),
        ([(0, 10), (15, 20), (25, 40)], {(10, 15), (20, 25)}),
        ([(0, 20), (0, 20), (10, 40)], set()),
    ],
    ids=['beginning', 'two gaps', 'none'],
)
def test_exactly_the_missing_drops_are_requested(simulator, known, outcome, sent, asked):
    simulator.answer = again
    for first, end in sent:
        simulator.publish('gap', first, end, last=end == DROPS)
    found = known()
    assert [aspect.count for aspect in found.aspects] == simulator.counts
    assert outcome('gap') == LogOutcome(DROPS, whole=True)
    # Both nodes request them, unless the drops for the other have arrived before.
    assert set(simulator.asked) == {('gap', *each) for each in asked}


def test_request_whose_messages_are_lost_requests_them_again(simulator, client):
    def lossy(name, first, end):
        lost = not name and (first, end) == (0, DROPS)
        return Status(), [('lost', first, first if lost else end, lost)]

    simulator.answer = lossy
    answer = client.ask(drops=DROPS, surface='rubber_mat', seed=[simulator.seed])
    assert answer.status.code == Status.OK, answer.status.message
    assert [aspect.count for aspect in answer.distribution.aspects] == simulator.counts
    assert simulator.asked == [('', 0, DROPS), ('lost', 0, DROPS)]


def test_drops_before_unrecoverable_ones_are_known(simulator, client, known, outcome):
    refusal = Status(code=Status.FAILED, message='the engine is broken')
    holed = [('made', 0, 10, False), ('made', 20, 40, True)]
    simulator.answer = lambda name, *_: (refusal, []) if name else (Status(), holed)
    answer = client.ask(drops=DROPS, surface='rubber_mat', seed=[simulator.seed])
    assert answer.status.code == Status.FAILED
    run_id = simulator.run_id('made')
    assert answer.status.message == f'the drops of run {run_id} could not be counted'
    assert known(10).drops == 10
    assert outcome('made') == LogOutcome(30, whole=False)
    # A later request makes what is missing.
    simulator.answer = lambda _, first, end: (Status(), [('rest', first, end, True)])
    answer = client.ask(drops=DROPS, surface='rubber_mat', seed=[simulator.seed])
    assert answer.status.code == Status.OK, answer.status.message
    assert ('', 10, DROPS) in simulator.asked
    assert [aspect.count for aspect in answer.distribution.aspects] == simulator.counts


# Last: the simulator is gone.
def test_log_of_an_interrupted_run_is_closed(simulator, known, outcome):
    simulator.publish('short', 0, 25)
    assert known(25).drops == 25
    simulator.disappear()
    assert outcome('short') == LogOutcome(25, whole=False)
