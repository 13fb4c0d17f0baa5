"""Waiting inside async callbacks, without blocking the node."""

from concurrent.futures import Future as PoolFuture
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.node import Node
from rclpy.task import Future

from resting_aspects_ros.nodes.callbacks import steady_timer


async def wait_for(
    node: Node, future: Future, seconds: float, group: CallbackGroup | None = None
) -> bool:
    """Wait until the future is done, but not longer; returns whether it is done.

    group : the timer's callback group; None: the node's own
    """
    if future.done():
        return True
    either = Future(executor=node.executor)

    def finish(_: Future) -> None:
        _finish(either)

    future.add_done_callback(finish)
    timer = steady_timer(node, seconds, lambda: _finish(either), group)
    try:
        await either
    finally:
        node.destroy_timer(timer)
        future.remove_done_callback(finish)  # frequent waits would leave many
    return bool(future.done())


async def sleep_for(node: Node, seconds: float, group: CallbackGroup | None = None) -> None:
    """Wait for a time on the steady clock."""
    await wait_for(node, Future(executor=node.executor), seconds, group)


async def result_of(node: Node, future: 'PoolFuture[Any]') -> Any:
    """Return the result of work in another thread or process, or raise its error."""
    done = Future(executor=node.executor)

    def wake(_: object) -> None:
        # Called by a thread of the pool; the node may have ended by then.
        if (executor := node.executor) is not None:
            done.set_result(None)
            executor.wake()

    future.add_done_callback(wake)
    await done
    return future.result()


def _finish(future: Future) -> None:
    if not future.done():
        future.set_result(None)
