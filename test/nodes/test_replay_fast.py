"""At full speed nothing is lost to subscribers with the documented depth."""

import pytest
from rclpy.serialization import deserialize_message
from resting_aspects_interfaces.msg import RestingPoses, Status

from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.ros.conversions import poses_from
from resting_aspects_ros.ros.interface import POSES
from resting_aspects_ros.statistics.distribution import count_poses

pytestmark = pytest.mark.slow

DROPS = 40_000


@pytest.fixture(scope='module')
def written(batches):
    return list(batches(DROPS // 250))


def test_40_000_drops_are_all_received_and_counted(
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
    times = DROPS // 250
    expected = (times * once.counts).tolist()
    assert [aspect.count for aspect in distribution.aspects] == expected
    assert distribution.unclassified == times * once.unclassified
