"""Topics and callbacks of the suite's nodes: what others publish must not end or hold up a node.

rclpy ends the process with an exception that leaves a callback, and its timers stand still while
nobody publishes simulated time. In every turn it looks at all event handlers; those that warn of
QoS that does not fit, two for each publisher and each subscription, took longer than all else of
an answer; the nodes of the suite fit, and who else is at the other end of a topic is warned there.
"""

from collections.abc import Awaitable, Callable
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription
from rclpy.timer import Timer

from resting_aspects_ros.core.errors import RestingAspectsError


def subscribe(
    node: Node,
    kind: Any,
    topic: str,
    take: Callable[[Any], object],
    qos: QoSProfile,
    *,
    raw: bool = False,
) -> Subscription:
    """Subscribe; a message for which ``take`` raises is dropped, and that is logged.

    raw : bool
        ``take`` gets the message's bytes.
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
    """A publisher."""
    return node.create_publisher(
        kind, topic, qos, event_callbacks=PublisherEventCallbacks(use_default_callbacks=False)
    )


def guarded(node: Node, lost: str, act: Callable[..., object]) -> Callable[..., None]:
    """The callback, without its exceptions: of each kind the first is logged.

    lost : str
        What is not done then, in words.
    """
    tell = _told_once(node, lost)

    def callback(*given: Any) -> None:
        try:
            act(*given)
        except Exception as error:  # noqa: BLE001 - the edge: nothing that comes in ends the node
            tell(error)

    return callback


def guarded_task(
    node: Node, lost: str, act: Callable[..., Awaitable[None]]
) -> Callable[..., Awaitable[None]]:
    """As guarded, of what is given to the executor as a task."""
    tell = _told_once(node, lost)

    async def task(*given: Any) -> None:
        try:
            await act(*given)
        except Exception as error:  # noqa: BLE001 - the edge: an exception of a task ends the node
            tell(error)

    return task


def steady_timer(
    node: Node, seconds: float, act: Callable[[], object], group: CallbackGroup | None = None
) -> Timer:
    """A timer that goes on where simulated time stands still."""
    clock = Clock(clock_type=ClockType.STEADY_TIME)
    return node.create_timer(seconds, act, group, clock)


def _told_once(node: Node, lost: str) -> Callable[[Exception], None]:
    said: set[object] = set()

    def tell(error: Exception) -> None:
        if (kind := _kind(error)) not in said:
            said.add(kind)
            known = isinstance(error, RestingAspectsError)
            words = str(error) if known else f'unexpected: {error!r}'
            node.get_logger().error(f'{lost}: {words} (said once)')

    return tell


def _kind(error: Exception) -> object:
    """Where it was raised: of the next message the words have other values."""
    place = error.__traceback__
    while place is not None and place.tb_next is not None:
        place = place.tb_next
    at = place and (place.tb_frame.f_code.co_filename, place.tb_lineno)
    return type(error), at
