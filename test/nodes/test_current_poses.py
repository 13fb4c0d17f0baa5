"""current_poses: the newest resting poses, as RViz shows them."""

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseArray

from resting_aspects_ros.nodes.aspect_classifier.publishers import MAX_SHOWN, CurrentPosesPublisher
from resting_aspects_ros.ros.interface import CURRENT_POSES, LATCHED
from resting_aspects_ros.statistics.poses import RestingPoses, RestStatus


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
