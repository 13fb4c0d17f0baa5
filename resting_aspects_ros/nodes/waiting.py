"""Waiting inside async callbacks, without holding up the node."""

from rclpy.node import Node
from rclpy.task import Future

from resting_aspects_ros.nodes.callbacks import steady_timer


async def wait_for(node: Node, future: Future, seconds: float) -> bool:
    """Wait until the future is done, but not longer; returns whether it is done."""
    if future.done():
        return True
    either = Future(executor=node.executor)

    def finish(_: Future) -> None:
        _finish(either)

    future.add_done_callback(finish)
    timer = steady_timer(node, seconds, lambda: _finish(either))
    try:
        await either
    finally:
        node.destroy_timer(timer)
        future.remove_done_callback(finish)  # who waits often would leave many
    return bool(future.done())


def _finish(future: Future) -> None:
    if not future.done():
        future.set_result(None)
