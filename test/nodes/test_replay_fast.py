"""At full speed nothing is lost to subscribers with the documented depth."""

import signal
import sys

import pytest
from rclpy.serialization import deserialize_message, serialize_message
from resting_aspects_interfaces.msg import Aspect, AspectDistribution, RestingPoses, Status

from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.logs.topics import Qos, Topic
from resting_aspects_ros.logs.writer import RunLog
from resting_aspects_ros.ros.conversions import poses_from
from resting_aspects_ros.ros.interface import MIN_BATCH, POSES
from resting_aspects_ros.statistics.distribution import count_poses

pytestmark = pytest.mark.slow

DROPS = 200_000
COUNT = 300


@pytest.fixture(scope='module')
def written(batches):
    return list(batches(DROPS // MIN_BATCH))


def test_200_000_drops_are_all_received_and_counted(
    start, connect, namespace, replay, wait, listen_raw, written, write_log, part, tmp_path
):
    log = write_log(tmp_path, written, gap=0.4)
    poses = poses_from(deserialize_message(written[0], RestingPoses))
    once = count_poses(find_aspects(part('tetrahedron')), poses)
    start('aspect_classifier', namespace)
    client = connect(namespace)
    received = listen_raw(client, RestingPoses, 'resting_poses', POSES)
    replayer = replay(log, as_fast_as_possible=True)
    wait(lambda: 'replayed in ' in replayer.output, 'end of the log')  # the client does not spin
    assert f': {len(written) + 1} messages; ' in replayer.output
    client.wait(lambda: len(received) == len(written), 'all batches')
    assert [data for data, _ in received] == written

    def known():
        answer = client.ask('tetrahedron', DROPS, surface='rubber_mat', seed=[1], only_known=True)
        return answer.status.code == Status.OK and answer.distribution

    distribution = client.wait(known, 'distribution')
    assert distribution.drops == DROPS
    times = DROPS // MIN_BATCH
    expected = (times * once.counts).tolist()
    assert [aspect.count for aspect in distribution.aspects] == expected
    assert distribution.unclassified == times * once.unclassified


READER = """
import sys
import rclpy
from resting_aspects_interfaces.msg import AspectDistribution
from resting_aspects_ros.ros.interface import ALL_LATCHED
rclpy.init()
node = rclpy.create_node('reader', namespace=sys.argv[1])
node.create_subscription(
    AspectDistribution,
    'aspect_distributions/nut',
    lambda message: print(message.drops, flush=True),
    ALL_LATCHED,
)
rclpy.spin(node)
"""


@pytest.fixture
def distributions(tmp_path):
    """A log of a topic of depth 1; 34 kB each are more than sockets buffer."""
    kind = 'resting_aspects_interfaces/msg/AspectDistribution'
    topic = Topic('/aspect_distributions/nut', kind, Qos(1, durability='transient_local'))
    with RunLog(tmp_path, 'run') as log:
        for k in range(COUNT):
            message = AspectDistribution(drops=k, aspects=[Aspect()] * 200)
            log.write(topic, serialize_message(message), k)
    return log.path


def test_stopped_subscriber_of_depth_1_loses_no_message(
    run_command, connect, namespace, replay, distributions
):
    client = connect(namespace)
    reader = run_command(sys.executable, '-c', READER, namespace)
    replay(distributions, as_fast_as_possible=True, loop=True)

    def received():
        return [int(word) for word in reader.output.split()]

    client.wait(lambda: len(received()) > COUNT / 10, 'some of them')
    reader.send(signal.SIGSTOP)
    client.spin(3.0)  # more than the pause between two rounds
    reader.send(signal.SIGCONT)
    before = len(received())
    client.wait(lambda: len(received()) > before + COUNT, 'a round more')
    found = received()
    assert found == [(found[0] + k) % COUNT for k in range(len(found))]


def test_killed_subscriber_does_not_block_the_replay(
    run_command, wait, namespace, replay, distributions
):
    reader = run_command(sys.executable, '-c', READER, namespace)
    replayer = replay(distributions, as_fast_as_possible=True, loop=True)
    wait(lambda: len(reader.output.split()) > COUNT / 10, 'some of them')
    reader.send(signal.SIGKILL)
    other = run_command(sys.executable, '-c', READER, namespace)
    wait(lambda: len(other.output.split()) > 2 * COUNT, 'two rounds')
    assert replayer.running
