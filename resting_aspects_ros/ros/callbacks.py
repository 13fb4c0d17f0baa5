"""Guarded publishers, subscriptions and timers, and functions that wait.

In rclpy, an exception that leaves a callback ends the process, and timers that use simulated time
stop while no clock is published. rclpy also checks all event handlers in every iteration: the
handlers for incompatible QoS, two for each publisher and subscription, took longer than the rest
of a response. The QoS of the suite's nodes is compatible, and a peer with other QoS is warned on
its own side.
"""

import inspect
from collections.abc import Awaitable, Callable, Iterator
from concurrent.futures import Future as PoolFuture
from contextlib import contextmanager
from copy import copy
from typing import Any
from weakref import WeakKeyDictionary

from rclpy.callback_groups import CallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.impl.rcutils_logger import RcutilsLogger
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSPolicyKind, QoSProfile
from rclpy.qos_overriding_options import InvalidQosOverridesError, QoSOverridingOptions
from rclpy.subscription import Subscription
from rclpy.task import Future
from rclpy.timer import Timer

from resting_aspects_ros.errors import InvalidValueError, RestingAspectsError

# The policies of a topic that a user can override.
OVERRIDES = QoSOverridingOptions(
    [
        QoSPolicyKind.HISTORY,
        QoSPolicyKind.DEPTH,
        QoSPolicyKind.RELIABILITY,
        QoSPolicyKind.DURABILITY,
    ]
)
# Minimum time between two logged errors with the same beginning, s.
LOG_PERIOD = 60.0
# rclpy throttles each line of code per logger object: each failure of a node has its own logger,
# so that failures do not throttle each other.
_LOGGERS: 'WeakKeyDictionary[Node, dict[str, RcutilsLogger]]' = WeakKeyDictionary()


def subscribe(
    node: Node,
    kind: Any,
    topic: str,
    callback: Callable[[Any], object],
    qos: QoSProfile,
    *,
    raw: bool = False,
    overridable: bool = False,
    group: CallbackGroup | None = None,
) -> Subscription:
    """Return a subscription that ignores a message for which ``callback`` raises; logs the error.

    callback : function or coroutine function
    raw : bool
        Whether ``callback`` is called with the bytes of the message.
    overridable : bool
        Whether parameters ``qos_overrides.<topic>.subscription.*`` replace the QoS; raises
        InvalidValueError if one of them is not valid.
    """
    failure = f'ignored a message on {node.resolve_topic_name(topic)}'
    guard: Any = guarded_task if inspect.iscoroutinefunction(callback) else guarded
    with _qos_override_errors(node, topic):
        return node.create_subscription(
            kind,
            topic,
            guard(node, failure, callback),
            copy(qos),  # rclpy changes it
            event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
            raw=raw,
            callback_group=group,
            qos_overriding_options=OVERRIDES if overridable else None,
        )


def advertise(
    node: Node,
    kind: Any,
    topic: str,
    qos: QoSProfile | int,
    *,
    overridable: bool = False,
    matched: Callable[[Any], None] | None = None,
) -> Publisher:
    """Return a publisher without handlers for QoS events.

    matched : called when a subscriber appears or disappears
    overridable : bool
        Whether parameters ``qos_overrides.<topic>.publisher.*`` replace the QoS; raises
        InvalidValueError if one of them is not valid.
    """
    with _qos_override_errors(node, topic):
        return node.create_publisher(
            kind,
            topic,
            copy(qos),  # rclpy changes it
            event_callbacks=PublisherEventCallbacks(matched=matched, use_default_callbacks=False),
            qos_overriding_options=OVERRIDES if overridable else None,
        )


class PartTopics:
    """Publishers of a topic for each part, ``<prefix>/<part>``, each created when it is needed."""

    def __init__(self, node: Node, kind: Any, prefix: str, qos: QoSProfile) -> None:
        self._node, self._kind, self._prefix, self._qos = node, kind, prefix, qos
        self._publishers: dict[str, Publisher] = {}

    def offer(self, part: str) -> Publisher:
        """Return the publisher of a part."""
        if part not in self._publishers:
            topic = f'{self._prefix}/{part}'
            self._publishers[part] = advertise(self._node, self._kind, topic, self._qos)
        return self._publishers[part]

    def publish(self, part: str, message: Any) -> None:
        """Publish a message of a part."""
        self.offer(part).publish(message)

    def remove(self, part: str) -> None:
        """Remove the publisher of a part, if there is one."""
        if (publisher := self._publishers.pop(part, None)) is not None:
            self._node.destroy_publisher(publisher)


def guarded(node: Node, failure: str, callback: Callable[..., object]) -> Callable[..., None]:
    """Return a callback whose exceptions are logged, at most one within LOG_PERIOD.

    failure : str
        Beginning of the log line: the consequence of an exception.
    """
    logger = _logger(node, failure)  # a reference to the node would keep it alive

    def guarded_callback(*arguments: Any) -> None:
        try:
            callback(*arguments)
        except Exception as error:  # noqa: BLE001 - the edge: nothing that comes in ends the node
            _report(logger, failure, error)

    return guarded_callback


def guarded_task(
    node: Node, failure: str, function: Callable[..., Awaitable[None]]
) -> Callable[..., Awaitable[None]]:
    """Return a guarded coroutine function, which the executor runs as a task; see ``guarded``."""
    logger = _logger(node, failure)

    async def task(*arguments: Any) -> None:
        try:
            await function(*arguments)
        except Exception as error:  # noqa: BLE001 - the edge: an exception of a task ends the node
            _report(logger, failure, error)

    return task


def start_task(
    node: Node, failure: str, function: Callable[..., Awaitable[None]], *arguments: Any
) -> None:
    """Run a coroutine function as a guarded task of the executor of the node, which calls this."""
    assert node.executor is not None
    node.executor.create_task(guarded_task(node, failure, function), *arguments)


def steady_timer(node: Node, seconds: float, callback: Callable[[], object]) -> Timer:
    """Return a timer on the steady clock, which does not depend on simulated time."""
    clock = Clock(clock_type=ClockType.STEADY_TIME)
    return node.create_timer(seconds, callback, clock=clock)


class WorkTimer:
    """A timer on the steady clock that runs only while there is work, so that idling is free.

    Parameters
    ----------
    seconds : period
    failure : beginning of the log line of an exception; see ``guarded``
    work : called once in a period from ``start`` on; returns whether more work is left
    """

    def __init__(self, node: Node, seconds: float, failure: str, work: Callable[[], bool]) -> None:
        self._work = work
        self._timer = steady_timer(node, seconds, guarded(node, failure, self._run))
        self._timer.cancel()

    def start(self) -> None:
        """Begin a period, unless one runs."""
        if self._timer.is_canceled():
            self._timer.reset()

    def set_period(self, seconds: float) -> None:
        """Begin a period of another length; following periods have it, too."""
        self._timer.timer_period_ns = round(seconds * 1e9)
        self._timer.reset()

    def _run(self) -> None:
        if not self._work():
            self._timer.cancel()


@contextmanager
def _qos_override_errors(node: Node, topic: str) -> Iterator[None]:
    """Context manager that turns the errors of rclpy for QoS overrides into InvalidValueError."""
    try:
        yield
    except (RuntimeError, InvalidQosOverridesError) as error:
        raise InvalidValueError(
            f'invalid qos_overrides of {node.resolve_topic_name(topic)}: {error}'
        ) from None


def _logger(node: Node, failure: str) -> RcutilsLogger:
    loggers = _LOGGERS.setdefault(node, {})
    return loggers.setdefault(failure, get_logger(node.get_logger().name))


def _report(logger: RcutilsLogger, failure: str, error: Exception) -> None:
    """Log an error with a beginning, at most one within LOG_PERIOD."""
    known = isinstance(error, RestingAspectsError)
    text = str(error) if known else f'unexpected error {error!r}'
    logger.error(f'{failure}: {text}', throttle_duration_sec=LOG_PERIOD)


async def wait_for(node: Node, future: Future, seconds: float) -> bool:
    """Wait until a future is done, up to a timeout; return whether it is done."""
    if future.done():
        return True
    done_or_timeout = Future(executor=node.executor)

    def finish(_: Future) -> None:
        _finish(done_or_timeout)

    future.add_done_callback(finish)
    timer = steady_timer(node, seconds, lambda: _finish(done_or_timeout))
    try:
        await done_or_timeout
    finally:
        node.destroy_timer(timer)
        future.remove_done_callback(finish)  # repeated waits would accumulate callbacks
    return bool(future.done())


async def sleep_for(node: Node, seconds: float) -> None:
    """Wait on the steady clock."""
    await wait_for(node, Future(executor=node.executor), seconds)


def ros_future(node: Node, future: 'PoolFuture[Any]') -> Future:
    """Return a future that is done when a future of another thread or process is done."""
    done = Future(executor=node.executor)

    def wake(_: object) -> None:
        # A thread of the pool calls this; the node may have been destroyed by then.
        if (executor := node.executor) is not None:
            done.set_result(None)
            executor.wake()

    future.add_done_callback(wake)
    return done


async def await_future(node: Node, future: 'PoolFuture[Any]') -> Any:
    """Return the result of a future of another thread or process, or raise its error."""
    await ros_future(node, future)
    return future.result()


def _finish(future: Future) -> None:
    if not future.done():
        future.set_result(None)
