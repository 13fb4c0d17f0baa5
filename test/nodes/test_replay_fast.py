"""As fast as possible, and nothing is lost: to slow readers, and to those that keep all."""

import signal
import sys

import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import deserialize_message, serialize_message
from resting_aspects_interfaces.msg import Aspect, AspectDistribution, RestingPoses, Status

from resting_aspects_ros.core.aspects import find_aspects
from resting_aspects_ros.core.distribution import count_poses
from resting_aspects_ros.logs.run_log import RunLog
from resting_aspects_ros.logs.topics import Qos, Topic
from resting_aspects_ros.nodes.convert import poses_from
from resting_aspects_ros.nodes.interface import LEAST_BATCH, POSES

DROPS = 200_000
COUNT = 300
LATCHED = DurabilityPolicy.TRANSIENT_LOCAL


@pytest.fixture(scope='module')
def written(batches):
    return list(batches(DROPS // LEAST_BATCH))


def test_200_000_drops_are_all_counted_and_all_heard(
    start, connect, namespace, replay, wait, listen_raw, written, write_log, part, tmp_path
):
    """The log would take 320 s as recorded."""
    log = write_log(tmp_path, written, gap=0.4)
    poses = poses_from(deserialize_message(written[0], RestingPoses))
    once = count_poses(find_aspects(part('tetrahedron')), poses)
    start('aspect_classifier', namespace)
    client = connect(namespace)
    heard = listen_raw(client, RestingPoses, 'resting_poses', POSES)
    replayer = replay(log, as_fast_as_possible=True)
    wait(lambda: 'replayed in ' in replayer.said, 'end of the log')  # this reader takes nothing
    assert f': {len(written) + 1} messages, {DROPS} drops; ' in replayer.said
    client.wait(lambda: len(heard) == len(written), 'all batches')
    assert [data for data, _ in heard] == written

    def known():
        answer = client.ask('tetrahedron', DROPS, seed=[1], only_known=True)
        return answer.status.code == Status.OK and answer.distribution

    distribution = client.wait(known, 'distribution')
    assert distribution.drops == DROPS
    times = DROPS // LEAST_BATCH
    expected = (times * once.counts).tolist()
    assert [aspect.count for aspect in distribution.aspects] == expected
    assert distribution.unclassified == times * once.unclassified


def in_turn(heard, count):
    """Whether messages 0 to count - 1 of a loop came in their order, from whichever first."""
    return heard == [(heard[0] + k) % count for k in range(len(heard))]


def test_a_reader_that_is_slow_loses_nothing_of_more_than_it_keeps(
    connect, namespace, replay, written, write_log, tmp_path
):
    """It keeps 20 of 80 batches, and takes 6 ms for each, or more on a busy machine.

    When 20 have gone out one follows every 40 ms; sent at once, 80 would take 5 ms in all.
    """
    client, heard = connect(namespace), []

    def read(data):
        heard.append(deserialize_message(data, RestingPoses).first_drop // LEAST_BATCH)

    qos = QoSProfile(depth=20, durability=LATCHED)
    client.node.create_subscription(RestingPoses, 'resting_poses', read, qos, raw=True)
    log = write_log(tmp_path, written[:80], depth=20)
    replay(log, as_fast_as_possible=True, loop=True)
    # It may be found at any time.
    client.wait(lambda: len(heard) >= 2 * 80, 'two rounds')
    assert in_turn(heard, 80)


READER = """
import sys
import rclpy
from resting_aspects_interfaces.msg import AspectDistribution
from resting_aspects_ros.nodes.interface import ALL_LATCHED
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


def test_a_reader_that_stops_gets_all_though_only_the_newest_is_offered(
    run_command, connect, namespace, replay, tmp_path
):
    """It keeps 1000; 34 kB each are more than the system keeps on their way to it."""
    kind = 'resting_aspects_interfaces/msg/AspectDistribution'
    topic = Topic('/aspect_distributions/nut', kind, Qos(1, durability='transient_local'))
    with RunLog(tmp_path, 'run') as log:
        for k in range(COUNT):
            message = AspectDistribution(drops=k, aspects=[Aspect()] * 200)
            log.write(topic, serialize_message(message), k)
    client = connect(namespace)
    reader = run_command(sys.executable, '-c', READER, namespace)
    replay(log.path, as_fast_as_possible=True, loop=True)

    def heard():
        return [int(word) for word in reader.said.split()]

    client.wait(lambda: len(heard()) > COUNT / 10, 'some of them')
    reader.send(signal.SIGSTOP)
    client.spin(3.0)  # more than the pause between two rounds
    reader.send(signal.SIGCONT)
    before = len(heard())
    client.wait(lambda: len(heard()) > before + COUNT, 'a round more')
    assert in_turn(heard(), COUNT)
