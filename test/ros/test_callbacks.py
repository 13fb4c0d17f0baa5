"""An exception of a callback is logged and does not end the node."""

import pytest
import rclpy
from rcl_interfaces.msg import Log
from rclpy.executors import SingleThreadedExecutor
from std_msgs.msg import Int32

from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.ros import callbacks
from resting_aspects_ros.ros.interface import ALL_LATCHED


@pytest.fixture
def node():
    context = rclpy.Context()
    rclpy.init(context=context)
    yield rclpy.create_node('guarded', context=context, namespace='test_callbacks')
    rclpy.try_shutdown(context=context)


@pytest.fixture
def logged(node, wait):
    """Publish numbers on a topic; return the errors on /rosout up to a last line."""
    found = []
    node.create_subscription(Log, '/rosout', found.append, ALL_LATCHED)
    executor = SingleThreadedExecutor(context=node.context)
    executor.add_node(node)

    def logged(publisher, numbers, taken):
        for number in numbers:
            publisher.publish(Int32(data=number))
        spin = lambda: executor.spin_once(0.1)  # noqa: E731
        wait(lambda: taken and taken[-1] == numbers[-1], 'last number', step=spin)
        end = f'end after {numbers}'
        node.get_logger().info(end)
        wait(lambda: any(line.msg == end for line in found), 'last line', step=spin)
        return [line.msg for line in found if line.level == Log.ERROR]

    yield logged
    executor.shutdown()


def listen(node, topic, error):
    taken = []

    def take(message):
        taken.append(message.data)
        raise error(f'invalid number {message.data}')

    callbacks.subscribe(node, Int32, topic, take, ALL_LATCHED)
    return callbacks.advertise(node, Int32, topic, ALL_LATCHED), taken


def test_errors_of_a_topic_are_logged_once_per_period(node, logged, monkeypatch):
    first, taken = listen(node, 'first', InvalidValueError)
    topic = '/test_callbacks/first'
    errors = logged(first, range(50), taken)
    assert errors == [f'ignored a message on {topic}: invalid number 0']
    assert taken == list(range(50))
    # Topics do not throttle each other.
    second, taken = listen(node, 'second', RuntimeError)
    assert len(logged(second, [3, 4], taken)) == 2
    monkeypatch.setattr(callbacks, 'LOG_PERIOD', 0.0)
    third, taken = listen(node, 'third', InvalidValueError)
    assert len(logged(third, range(5), taken)) == 2 + 5
