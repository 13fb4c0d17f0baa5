"""current_poses: the newest resting poses, as RViz shows them."""

from functools import partial

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseArray

from resting_aspects_ros.nodes.aspect_classifier.publishers import MAX_SHOWN, CurrentPosesPublisher
from resting_aspects_ros.ros.conversions import poses_from
from resting_aspects_ros.ros.interface import CURRENT_POSES, LATCHED
from resting_aspects_ros.statistics.poses import RestingPoses, RestStatus


def numbers(pose):
    """Return position and orientation as seven numbers."""
    return tuple(getattr(pose.position, k) for k in 'xyz') + tuple(
        getattr(pose.orientation, k) for k in 'xyzw'
    )


def settled(batches, run_id):
    """Return the settled poses of a run, in the order of drops."""
    of_run = sorted((b for b in batches if b.run.run_id == run_id), key=lambda b: b.first_drop)
    return [
        (*position, *orientation)
        for poses in map(poses_from, of_run)
        for position, orientation, status in zip(
            poses.position.tolist(), poses.orientation.tolist(), poses.status, strict=True
        )
        if status == RestStatus.SETTLED
    ]


def drop_and_wait(client, batches, part, drops):
    """Drop a part; return the settled poses of the run when all have been received."""
    run_id = client.ask(part, drops, seed=[drops]).distribution.run.run_id
    client.wait(lambda: any(b.last and b.run.run_id == run_id for b in batches), 'last batch')
    return settled(batches, run_id)


def shows(shown, expected):
    return shown and [numbers(pose) for pose in shown[-1].poses] == expected


def test_poses_are_the_newest_of_the_newest_run(suite):
    batches = suite.client.poses()
    shown = suite.client.listen(PoseArray, CURRENT_POSES, LATCHED)
    for part in ('tetrahedron', 'l_bracket'):
        expected = drop_and_wait(suite.client, batches, part, 270)[-MAX_SHOWN:]
        suite.client.wait(partial(shows, shown, expected), f'poses of {part}')
        assert shown[-1].header.frame_id == 'tray'
        assert shown[-1].header.stamp in [batch.header.stamp for batch in batches]


def batch(first, status):
    """Return poses whose x is their index."""
    count = len(status)
    return RestingPoses(
        first,
        np.arange(first, first + count)[:, None] * np.array([1.0, 0.0, 0.0]),
        np.tile([0.0, 0.0, 0.0, 1.0], (count, 1)),
        np.array(status, dtype=np.uint8),
        np.zeros(count, dtype=np.uint8),
        np.zeros(count),
        np.zeros(count),
    )


def test_only_settled_drops_up_to_the_maximum_are_shown(connect, namespace):
    client, listener = connect(namespace), connect(namespace)
    current = CurrentPosesPublisher(client.node, lambda: None)
    received = listener.listen(PoseArray, CURRENT_POSES, LATCHED)
    topic = f'{namespace}/{CURRENT_POSES}'
    client.wait(lambda: client.node.count_subscribers(topic), 'subscription')

    def newest(count):
        """Return the first coordinates of the newest of a number of messages."""

        def whole():
            current.publish()
            return len(received) == count

        listener.wait(whole, f'{count} messages')
        return [pose.position.x for pose in received[-1].poses]

    S, U, F = RestStatus.SETTLED, RestStatus.UNSETTLED, RestStatus.FAILED  # noqa: N806
    current.take('a', batch(0, [S, U, S, F]), Time(sec=1))
    assert newest(1) == [0, 2]
    current.take('a', batch(4, [F, S]), Time(sec=2))
    assert newest(2) == [0, 2, 5]
    current.take('a', batch(6, [S] * (MAX_SHOWN - 2)), Time(sec=3))
    assert newest(3) == [2, 5, *range(6, 6 + MAX_SHOWN - 2)]
    current.take('a', batch(500, [S] * (MAX_SHOWN + 7)), Time(sec=4))
    assert newest(4) == list(range(507, 507 + MAX_SHOWN))
    current.take('b', batch(0, [U, S]), Time(sec=5))
    assert newest(5) == [1]
    current.take('c', batch(0, [F]), Time(sec=6))
    assert newest(6) == []
    assert [message.header.stamp.sec for message in received] == [1, 2, 3, 4, 5, 6]
