"""Ask the suite with a node that somebody spins: every answer is a Future."""

from collections.abc import Callable
from typing import Any

import numpy.typing as npt
from geometry_msgs.msg import Quaternion
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.node import Node
from rclpy.task import Future
from resting_aspects_interfaces.msg import Status
from resting_aspects_interfaces.srv import ClassifyPose, GetDistribution, ListParts

from resting_aspects_ros.core.distribution import METHOD
from resting_aspects_ros.drops.conditions import DropConditions
from resting_aspects_ros.nodes.client_requests import (
    check_progress,
    check_timeout,
    distribution_request,
    pose_request,
)
from resting_aspects_ros.nodes.interface import (
    CLASSIFY_POSE,
    GET_DISTRIBUTION,
    LIST_PARTS,
    SERVICES,
)
from resting_aspects_ros.nodes.own_node import CLOSED, ClientUseError
from resting_aspects_ros.nodes.question import Question
from resting_aspects_ros.nodes.run_watch import RunWatch


class AsyncClient:
    """The questions of RestingAspectsClient that return a Future at once.

    warn : called with what a person should know; None: the node logs it
    """

    def __init__(self, node: Node, warn: Callable[[str], object] | None) -> None:
        self._node = node
        self._warn = warn or node.get_logger().warning
        # Not the node's own: its callbacks may await what comes in here.
        self._group = MutuallyExclusiveCallbackGroup()
        self._services = {
            name: self._node.create_client(
                kind, name, qos_profile=SERVICES, callback_group=self._group
            )
            for name, kind in (
                (GET_DISTRIBUTION, GetDistribution),
                (CLASSIFY_POSE, ClassifyPose),
                (LIST_PARTS, ListParts),
            )
        }
        self._open: set[Question] = set()

    def get_distribution_async(
        self,
        part: str,
        *,
        drops: int | None = None,
        precision: float = 0.0,
        surface: str = '',
        conditions: DropConditions | None = None,
        seed: int | None = None,
        method: str = METHOD,
        only_known: bool = False,
        timeout: float | None = None,
        progress: Callable[[int], None] | None = None,
    ) -> Future:
        """What get_distribution of RestingAspectsClient gives, as a Future."""
        self._check(timeout)
        check_progress(progress)
        request = distribution_request(
            part,
            drops=drops,
            precision=precision,
            surface=surface,
            conditions=conditions,
            seed=seed,
            method=method,
            only_known=only_known,
        )
        watch = RunWatch(self._node, self._group, request, progress)
        what = f'the distribution of {part}'
        return self._ask(GET_DISTRIBUTION, request, what, timeout, watch.close, watch=watch)

    def classify_pose_async(
        self,
        part: str,
        orientation: Quaternion | npt.ArrayLike,
        *,
        timeout: float | None = None,
    ) -> Future:
        """What classify_pose gives, as a Future."""
        self._check(timeout)
        request = pose_request(part, orientation)
        what = f'the aspect of a pose of {part}'
        # With this code the answer is that no aspect fits.
        also = (Status.NOT_AVAILABLE,)
        return self._ask(CLASSIFY_POSE, request, what, timeout, lambda found: found, also=also)

    def list_parts_async(self, *, timeout: float | None = None) -> Future:
        """What list_parts gives, as a Future."""
        self._check(timeout)
        request = ListParts.Request()
        what = 'the list of parts'
        return self._ask(LIST_PARTS, request, what, timeout, lambda found: found.parts)

    def close(self) -> None:
        """End all that it made; who awaits an answer gets a ClientUseError."""
        for question in list(self._open):
            question.fail(ClientUseError(CLOSED))
            question.answer.exception()  # else rclpy complains if nobody awaits it
        for service in self._services.values():
            self._node.destroy_client(service)
        self._services.clear()

    def _check(self, timeout: float | None) -> None:
        """Raises RestingAspectsError if nothing can be asked, or not for so long."""
        check_timeout(timeout)
        if not self._services:
            raise ClientUseError(CLOSED)

    def _ask(self, service: str, *asked: Any, **more: Any) -> Future:
        client = self._services[service]
        question = Question(self._node, self._group, client, *asked, warn=self._warn, **more)
        self._open.add(question)
        question.answer.add_done_callback(lambda _: self._open.discard(question))
        return question.answer
