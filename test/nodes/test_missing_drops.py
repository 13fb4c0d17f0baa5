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
from resting_aspects_ros.ros.health import announce
from resting_aspects_ros.ros.interface import DROP_SIMULATOR, LATCHED, POSES
from resting_aspects_ros.simulation.job import plan_run
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

    def __init__(self, client, logs, part, conditions):
        self.client, self._logs, self._part, self._conditions = client, logs, part, conditions
        node = client.node
        self._out = node.create_publisher(RestingPoses, 'resting_poses', POSES)
        self._parts = node.create_publisher(PartDescription, 'parts/tetrahedron', LATCHED)
        self._parts.publish(part_msg(part))
        self._server = ActionServer(node, DropPart, 'drop_part', self._execute)
        self._presence = announce(node, DROP_SIMULATOR)
        self.destroy = self._server.destroy

    def disappear(self):
        """As DDS sees it when a simulator is killed."""
        self.client.node.destroy_publisher(self._presence)

    def begin(self, seed, poses):
        """Use a seed and run ids that no other test uses."""
        self.answer = lambda name, first, end: (Status(), [])
        self.asked = []
        self.seed, self._poses = seed, poses
        given = {'seed': seed, 'drops': DROPS, 'run_id': 'x', 'started': 10**18}
        self._run = plan_run(self._part, self._conditions, **given)[1]
        self.counts = count_poses(find_aspects(self._part), poses).counts.tolist()

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

    def request(self):
        """Request all drops; return the response, and check the counts of a good one."""
        answer = self.client.ask(drops=DROPS, surface='rubber_mat', seed=[self.seed])
        if answer.status.code == Status.OK:
            self.check(answer.distribution)
        return answer.status

    def check(self, distribution):
        assert [aspect.count for aspect in distribution.aspects] == self.counts

    def known(self, drops=DROPS):
        return self.client.known(drops=drops, surface='rubber_mat', seed=[self.seed])

    def outcome(self, name):
        """Return the outcome of the log of a run, once it is closed."""
        pattern = f'*_{self.run_id(name)}/metadata.yaml'
        found = self.client.wait(lambda: list(self._logs.glob(pattern)), 'closed log')
        return recorded_outcome(found[0].parent)


@pytest.fixture(scope='module')
def fake(connect, start, part, surfaces, tmp_path_factory):
    namespace, logs = f'/missing_{os.getpid()}', tmp_path_factory.mktemp('logs')
    for node in ('aspect_classifier', 'drop_recorder'):
        start(node, namespace, {'log_folder': logs}, SHORTER)
    fake = FakeSimulator(connect(namespace), logs, part('tetrahedron'), surfaces.get())
    fake.client.wait(lambda: 'tetrahedron' in fake.client.parts(), 'part')
    yield fake
    fake.destroy()


@pytest.fixture
def simulator(fake, engine, seeds=itertools.count(1)):  # noqa: B008 - one for all tests is meant
    seed = next(seeds)
    fake.begin(seed, engine(DROPS, seed))
    return fake


@pytest.mark.parametrize(
    ('sent', 'asked'),
    [
        ([(0, 10), (15, 20), (25, 40)], {(10, 15), (20, 25)}),
        ([(20, 40)], {(0, 20)}),
        ([(0, 20), (0, 20), (10, 40)], set()),
    ],
)
def test_exactly_the_missing_drops_are_requested(simulator, sent, asked):
    simulator.answer = lambda name, first, end: (Status(), [(name, first, end, False)])
    for first, end in sent:
        simulator.publish('gap', first, end, last=end == DROPS)
    simulator.check(simulator.known())
    assert simulator.outcome('gap') == LogOutcome(DROPS, whole=True)
    # Both nodes request them, unless the drops for the other have arrived before.
    assert set(simulator.asked) == {('gap', *each) for each in asked}


def test_request_whose_messages_are_lost_requests_them_again(simulator):
    def lossy(name, first, end):
        lost = not name and (first, end) == (0, DROPS)
        return Status(), [('lost', first, first if lost else end, lost)]

    simulator.answer = lossy
    assert simulator.request().code == Status.OK
    assert simulator.asked == [('', 0, DROPS), ('lost', 0, DROPS)]


def test_drops_before_unrecoverable_ones_are_known(simulator):
    refusal = Status(code=Status.FAILED, message='the engine is broken')
    holed = [('made', 0, 10, False), ('made', 20, 40, True)]
    simulator.answer = lambda name, *_: (refusal, []) if name else (Status(), holed)
    assert simulator.request().code == Status.FAILED
    assert simulator.known(10).drops == 10
    assert simulator.outcome('made') == LogOutcome(30, whole=False)
    # A later request makes what is missing.
    simulator.answer = lambda _, first, end: (Status(), [('rest', first, end, True)])
    assert simulator.request().code == Status.OK
    assert ('', 10, DROPS) in simulator.asked


# Last: the simulator is gone.
def test_log_of_an_interrupted_run_is_closed(simulator):
    simulator.publish('short', 0, 25)
    assert simulator.known(25).drops == 25
    simulator.disappear()
    assert simulator.outcome('short') == LogOutcome(25, whole=False)
