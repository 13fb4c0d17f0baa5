"""Base of the client: its ROS clients, its pending requests, and its private node."""

from collections.abc import Awaitable, Callable, Sequence
from types import TracebackType
from typing import Any, TypeVar

from rclpy.action import ActionClient
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.task import Future
from resting_aspects_interfaces.srv import (
    ClassifyPose,
    FeederForecast,
    GetDistribution,
    GetTransitions,
    IdentifyPart,
    ListParts,
    LocatePart,
)

from resting_aspects_ros.client.pending_request import PendingRequest
from resting_aspects_ros.client.private_node import CLOSED, ClientUseError, PrivateNode
from resting_aspects_ros.client.request_messages import check_timeout
from resting_aspects_ros.ros.interface import (
    ACTION_SERVICES,
    CLASSIFY_POSE,
    FORECAST,
    GET_DISTRIBUTION,
    GET_TRANSITIONS,
    IDENTIFY_PART,
    LIST_PARTS,
    LOCATE_PART,
    SERVICES,
)

Self = TypeVar('Self', bound='ClientBase')  # typing.Self is newer than Python 3.10


class ClientBase:
    """The ROS clients, pending requests and private node of RestingAspectsClient."""

    def __init__(
        self,
        node: Node | None = None,
        *,
        ros_args: Sequence[str] | None = None,
        warn: Callable[[str], object] | None = None,
        check: Callable[[], None] = lambda: None,
    ) -> None:
        self._own: PrivateNode | None = None
        if node is None:
            self._own = PrivateNode(ros_args, check)
            node = self._own.node
        self._node = node
        self._warn = warn or node.get_logger().warning
        # Callbacks in the default group of the node may await responses, so that requests need
        # another group. It is reentrant, since requests wait in it.
        self._group = ReentrantCallbackGroup()
        self._services = {
            name: self._node.create_client(
                kind, name, qos_profile=SERVICES, callback_group=self._group
            )
            for name, kind in (
                (GET_DISTRIBUTION, GetDistribution),
                (GET_TRANSITIONS, GetTransitions),
                (CLASSIFY_POSE, ClassifyPose),
                (LIST_PARTS, ListParts),
                (IDENTIFY_PART, IdentifyPart),
                (LOCATE_PART, LocatePart),
                (FORECAST, FeederForecast),
            )
        }
        self._actions: dict[str, ActionClient] = {}
        self._open: set[PendingRequest] = set()

    def close(self) -> None:
        """End all requests with a ClientUseError, and destroy the private node."""
        for pending in list(self._open):
            pending.fail(ClientUseError(CLOSED))
            pending.answer.exception()  # otherwise rclpy logs an exception that is never retrieved
        for service in self._services.values():
            self._node.destroy_client(service)
        self._services.clear()
        for action in self._actions.values():
            action.destroy()
        self._actions.clear()
        if self._own is not None:
            self._own.close()

    def __enter__(self: Self) -> Self:  # noqa: PYI019
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _check(self, timeout: float | None) -> None:
        """Raise RestingAspectsError for an invalid timeout, a closed client, or no spinning."""
        check_timeout(timeout)
        if not self._services:
            raise ClientUseError(CLOSED)
        if self._own is not None and not self._own.is_waiting:
            raise ClientUseError(
                'this client spins only while it waits, so that the future would never be done: '
                'use the method without _async, or RestingAspectsClient(node) with a node that '
                'you spin'
            )

    def _start(
        self,
        description: str,
        timeout: float | None,
        work: Callable[[PendingRequest], Awaitable[Any]],
    ) -> Future:
        pending = PendingRequest(self._node, self._group, description, timeout, work, self._warn)
        self._open.add(pending)
        pending.finished.add_done_callback(lambda _: self._open.discard(pending))
        return pending.answer

    def _action_client(self, name: str, kind: Any) -> ActionClient:
        """Return the client of an action; the first request that needs it creates it."""
        if name not in self._actions:
            self._actions[name] = ActionClient(
                self._node, kind, name, callback_group=self._group, **ACTION_SERVICES
            )
        return self._actions[name]

    def _wait(self, ask: Callable[[], Future]) -> Any:
        return self._waiting_node().wait(ask, lambda: self._open)

    def _waiting_node(self) -> PrivateNode:
        if self._own is None:
            raise ClientUseError(
                f'this client does not spin the node {self._node.get_name()!r}, so that waiting '
                'could block forever: await the method that ends in _async, or use '
                'RestingAspectsClient() without a node'
            )
        return self._own
