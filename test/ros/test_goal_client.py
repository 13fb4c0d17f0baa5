"""The result of a goal arrives although responses of the simulator are lost or late."""

from types import SimpleNamespace

import pytest
import rclpy
from action_msgs.msg import GoalStatus
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.task import Future
from resting_aspects_interfaces.action import DropPart
from ros_graph import DEADLINE

from resting_aspects_ros.ros import goal_client
from resting_aspects_ros.ros.goal_client import goal_result


@pytest.fixture
def executor():
    context = Context()
    rclpy.init(context=context, args=[])
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(rclpy.create_node('test_goal_client', context=context))
    yield executor
    executor.shutdown()
    rclpy.shutdown(context=context)


def test_late_response_is_used_if_the_first_was_lost(executor, monkeypatch):
    for name, seconds in (('CHECK_PERIOD', 0.01), ('RETRY_PERIOD', 0.05)):
        monkeypatch.setattr(goal_client, name, seconds)
    (node,) = executor.get_nodes()
    responses = []

    def get_result():
        responses.append(Future(executor=executor))
        if len(responses) == 3:  # the response to the request before arrives only now
            found = SimpleNamespace(status=GoalStatus.STATUS_SUCCEEDED, result='result')
            responses[1].set_result(found)
        return responses[-1]

    accepted = Future(executor=executor)
    accepted.set_result(SimpleNamespace(accepted=True, get_result_async=get_result))
    client = SimpleNamespace(send_goal_async=lambda *_: accepted, server_is_ready=lambda: True)
    task = executor.create_task(goal_result, node, client, DropPart.Goal(part='solid'))
    executor.spin_until_future_complete(task, DEADLINE)
    assert task.result() == 'result'
