"""Publishers, subscriptions and timers whose callbacks cannot end or delay a node, and waiting.

An exception that leaves a callback ends the process in rclpy, and rclpy's timers stand still while
nobody publishes simulated time. In every turn, rclpy checks all event handlers; those for
incompatible QoS, two for each publisher and subscription, took longer than the rest of an answer.
The QoS of the suite's nodes is compatible, and a peer with other QoS is warned on its own side.
"""

from collections.abc import Awaitable, Callable
from concurrent.futures import Future as PoolFuture
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription
from rclpy.task import Future
from rclpy.timer import Timer

from resting_aspects_ros.core.errors import RestingAspectsError

# Further errors of the same callback are not logged for so long, s.
LOG_PERIOD = 60.0


def subscribe(
    node: Node,
    kind: Any,
    topic: str,
    take: Callable[[Any], object],
    qos: QoSProfile,
    *,
    raw: bool = False,
) -> Subscription:
    """Subscribe; a message for which ``take`` raises is dropped, and the error is logged.

    raw : bool
        Whether ``take`` is called with the message's bytes.
    """
    lost = f'a message on {node.resolve_topic_name(topic)} is not used'
    return node.create_subscription(
        kind,
        topic,
        guarded(node, lost, take),
        qos,
        event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
        raw=raw,
    )


def advertise(node: Node, kind: Any, topic: str, qos: QoSProfile | int) -> Publisher:
    """Return a publisher without handlers of QoS events."""
    return node.create_publisher(
        kind, topic, qos, event_callbacks=PublisherEventCallbacks(use_default_callbacks=False)
    )


def guarded(node: Node, lost: str, act: Callable[..., object]) -> Callable[..., None]:
    """Return the callback with its exceptions logged, at most one within LOG_PERIOD.

    lost : str
        What is not done after an exception, for the log.
    """
    report = _reporter(node, lost)

    def callback(*given: Any) -> None:
        try:
            act(*given)
        except Exception as error:  # noqa: BLE001 - the edge: nothing that comes in ends the node
            report(error)

    return callback


def guarded_task(
    node: Node, lost: str, act: Callable[..., Awaitable[None]]
) -> Callable[..., Awaitable[None]]:
    """As guarded, for a coroutine function that the executor runs as a task."""
    report = _reporter(node, lost)

    async def task(*given: Any) -> None:
        try:
            await act(*given)
        except Exception as error:  # noqa: BLE001 - the edge: an exception of a task ends the node
            report(error)

    return task


def steady_timer(
    node: Node, seconds: float, act: Callable[[], object], group: CallbackGroup | None = None
) -> Timer:
    """Return a timer that does not depend on simulated time."""
    clock = Clock(clock_type=ClockType.STEADY_TIME)
    return node.create_timer(seconds, act, group, clock)


def _reporter(node: Node, lost: str) -> Callable[[Exception], None]:
    """Return a function that logs errors of one callback, at most one within LOG_PERIOD."""
    # rclpy throttles each line of code per logger object: callbacks with loggers of their own do
    # not silence each other.
    logger = get_logger(node.get_logger().name)

    def report(error: Exception) -> None:
        known = isinstance(error, RestingAspectsError)
        words = str(error) if known else f'unexpected: {error!r}'
        logger.error(f'{lost}: {words}', throttle_duration_sec=LOG_PERIOD)

    return report


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
