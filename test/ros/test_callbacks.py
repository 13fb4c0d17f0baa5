"""An exception of a callback is logged and does not end the node."""

import pytest
import rclpy

from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.ros import callbacks


@pytest.fixture
def node():
    context = rclpy.Context()
    rclpy.init(context=context)
    yield rclpy.create_node('guarded', context=context, namespace='test_callbacks')
    rclpy.try_shutdown(context=context)


def test_errors_of_a_callback_are_logged_once_per_period(node, capfd, monkeypatch):
    def fail(number):
        raise (InvalidValueError if number < 50 else RuntimeError)(f'invalid number {number}')

    def logged(failure, numbers):
        callback = callbacks.guarded(node, failure, fail)
        for number in numbers:
            callback(number)
        lines = capfd.readouterr().err.splitlines()
        return [line.partition('[test_callbacks.guarded]: ')[2] for line in lines]

    assert logged('first', range(50)) == ['first: invalid number 0']
    # Callbacks do not throttle each other.
    error = "unexpected error RuntimeError('invalid number 50')"
    assert logged('second', range(50, 52)) == [f'second: {error}']
    monkeypatch.setattr(callbacks, 'LOG_PERIOD', 0.0)
    assert len(logged('third', range(5))) == 5
