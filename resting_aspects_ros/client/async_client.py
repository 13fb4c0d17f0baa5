"""Asynchronous requests to the suite: each returns a Future and needs a node that is spun."""

import math
import time
from collections.abc import Awaitable, Callable
from functools import partial
from typing import Any

import numpy.typing as npt
from geometry_msgs.msg import Quaternion
from rclpy.action import ActionClient
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.task import Future
from resting_aspects_interfaces.action import DropPart
from resting_aspects_interfaces.msg import AspectDistribution, PartSummary, Status
from resting_aspects_interfaces.srv import ClassifyPose, GetDistribution, ListParts

from resting_aspects_ros.client.pending_request import AnswerTimeoutError, PendingRequest
from resting_aspects_ros.client.private_node import CLOSED, ClientUseError
from resting_aspects_ros.client.request_messages import (
    check_progress,
    check_timeout,
    distribution_request,
    pose_request,
)
from resting_aspects_ros.ros.interface import (
    ACTION_SERVICES,
    CLASSIFY_POSE,
    DROP_PART,
    GET_DISTRIBUTION,
    LIST_PARTS,
    SERVICES,
)
from resting_aspects_ros.ros.status import NotAvailableError, status_error
from resting_aspects_ros.simulation.run_description import DEFAULT_SEED

# Time within which all drops of a run must be counted after the result of its goal arrived, s.
COUNT_TIMEOUT = 120.0


class AsyncClient:
    """The requests of RestingAspectsClient that return a Future at once.

    warn : called with the text of each warning; None: the node logs warnings
    """

    def __init__(self, node: Node, warn: Callable[[str], object] | None) -> None:
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
                (CLASSIFY_POSE, ClassifyPose),
                (LIST_PARTS, ListParts),
            )
        }
        self._drop_part: ActionClient | None = None
        self._open: set[PendingRequest] = set()

    def get_distribution_async(
        self,
        part: str,
        *,
        timeout: float | None = None,
        progress: Callable[[int], None] | None = None,
        **options: Any,
    ) -> Future:
        """Return a Future of the result of RestingAspectsClient.get_distribution.

        options : the other parameters of get_distribution
        """
        self._check(timeout)
        check_progress(progress)
        request = distribution_request(part, **options)
        return self._start(
            f'the distribution of {part}',
            timeout,
            partial(self._find_or_drop, request, progress or (lambda _: None)),
        )

    def classify_pose_async(
        self,
        part: str,
        orientation: Quaternion | npt.ArrayLike,
        *,
        timeout: float | None = None,
    ) -> Future:
        """Return a Future of the result of classify_pose."""
        self._check(timeout)
        request = pose_request(part, orientation)

        async def ask(pending: PendingRequest) -> ClassifyPose.Response:
            response = await pending.call(self._services[CLASSIFY_POSE], request)
            # NOT_AVAILABLE with an angle is a result: no aspect matches.
            if response.status.code != Status.NOT_AVAILABLE or math.isnan(response.angle):
                _check_ok(response.status)
            return response

        return self._start(f'the aspect of a pose of {part}', timeout, ask)

    def list_parts_async(self, *, timeout: float | None = None) -> Future:
        """Return a Future of the result of list_parts."""
        self._check(timeout)

        async def ask(pending: PendingRequest) -> list[PartSummary]:
            response = await pending.call(self._services[LIST_PARTS], ListParts.Request())
            _check_ok(response.status)
            return list(response.parts)

        return self._start('the list of parts', timeout, ask)

    def close(self) -> None:
        """End all requests with a ClientUseError and destroy the ROS clients."""
        for pending in list(self._open):
            pending.fail(ClientUseError(CLOSED))
            pending.answer.exception()  # otherwise rclpy logs an exception that is never retrieved
        for service in self._services.values():
            self._node.destroy_client(service)
        self._services.clear()
        if self._drop_part is not None:
            self._drop_part.destroy()
            self._drop_part = None

    def _check(self, timeout: float | None) -> None:
        """Raise RestingAspectsError for an invalid timeout or a closed client."""
        check_timeout(timeout)
        if not self._services:
            raise ClientUseError(CLOSED)

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

    async def _find_or_drop(
        self,
        request: GetDistribution.Request,
        progress: Callable[[int], object],
        pending: PendingRequest,
    ) -> AspectDistribution:
        """Return a known distribution; without one, drop the part and return the new one."""
        service = self._services[GET_DISTRIBUTION]
        only_known = request.only_known
        request.only_known = True
        response = await pending.call(service, request)
        unknown = (Status.NOT_AVAILABLE, Status.UNKNOWN_PART)
        if only_known or response.status.code not in unknown:
            _check_ok(response.status)
            return response.distribution
        done = 0

        def report(drops: int) -> None:
            nonlocal done
            if drops > done:
                done = drops
                progress(drops)

        seed = request.seed[0] if request.seed else DEFAULT_SEED
        goal = DropPart.Goal(
            part=request.part,
            surface=request.surface,
            conditions=request.conditions,
            drops=request.drops,
            precision=request.precision,
            seed=seed,
        )
        try:
            result = await pending.drop(self._action_client(), goal, report)
        except AnswerTimeoutError as error:
            if pending.state:
                raise
            raise AnswerTimeoutError(f'{error}; {response.status.message}') from None
        _check_ok(result.status)
        report(result.drops)
        pending.state = f'{result.drops} drops are done and being counted'
        # The batches were sent before the result, but may arrive after it.
        request.seed = [seed]
        end = time.monotonic() + COUNT_TIMEOUT
        while (response := await pending.call(service, request)).status.code in unknown:
            if time.monotonic() > end:
                raise NotAvailableError(
                    f'the {result.drops} drops of run {result.run_id} were not counted within '
                    f'{COUNT_TIMEOUT:g} s: {response.status.message}'
                )
            await pending.pause(GET_DISTRIBUTION)
        _check_ok(response.status)
        return response.distribution

    def _action_client(self) -> ActionClient:
        """Return the action client; the first request that needs it creates it."""
        if self._drop_part is None:
            self._drop_part = ActionClient(
                self._node, DropPart, DROP_PART, callback_group=self._group, **ACTION_SERVICES
            )
        return self._drop_part


def _check_ok(status: Status) -> None:
    if status.code != Status.OK:
        raise status_error(status)
