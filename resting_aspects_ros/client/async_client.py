"""Asynchronous requests to the suite: each returns a Future and needs a node that is spun."""

import math
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy.typing as npt
from geometry_msgs.msg import Quaternion
from rclpy.task import Future
from resting_aspects_interfaces.action import DropPart, ReorientPart
from resting_aspects_interfaces.msg import (
    AspectDistribution,
    PartSummary,
    Status,
    TransitionMatrix,
)
from resting_aspects_interfaces.srv import ClassifyPose, GetDistribution, ListParts

from resting_aspects_ros.client.client_base import ClientBase
from resting_aspects_ros.client.pending_request import AnswerTimeoutError, PendingRequest
from resting_aspects_ros.client.request_messages import (
    check_progress,
    distribution_request,
    pose_request,
    reorient_goal,
    transitions_request,
)
from resting_aspects_ros.ros.interface import (
    CLASSIFY_POSE,
    DROP_PART,
    GET_DISTRIBUTION,
    GET_TRANSITIONS,
    LIST_PARTS,
    REORIENT_PART,
)
from resting_aspects_ros.ros.status import NotAvailableError, status_error
from resting_aspects_ros.simulation.job import DEFAULT_SEED

# Time within which all drops of a run must be counted after the result of its goal arrived, s.
COUNT_TIMEOUT = 120.0


class AsyncClient(ClientBase):
    """The requests of RestingAspectsClient that return a Future at once."""

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
                check_ok(response.status)
            return response

        return self._start(f'the aspect of a pose of {part}', timeout, ask)

    def reorient_part_async(
        self,
        part: str,
        *arguments: Any,
        timeout: float | None = None,
        progress: Callable[[int], None] | None = None,
        **options: Any,
    ) -> Future:
        """Return a Future of the result of RestingAspectsClient.reorient_part.

        arguments, options : the other parameters of reorient_part
        """
        self._check(timeout)
        check_progress(progress)
        goal = reorient_goal(part, *arguments, **options)

        async def ask(pending: PendingRequest) -> TransitionMatrix:
            client = self._action_client(REORIENT_PART, ReorientPart)
            report = progress or (lambda _: None)
            result = await pending.simulate(REORIENT_PART, client, goal, report)
            check_ok(result.status)
            return result.transitions

        return self._start(f'the transitions of {part}', timeout, ask)

    def get_transitions_async(
        self, part: str, action: str = '', *, timeout: float | None = None
    ) -> Future:
        """Return a Future of the result of get_transitions."""
        self._check(timeout)
        request = transitions_request(part, action)

        async def ask(pending: PendingRequest) -> TransitionMatrix:
            response = await pending.call(self._services[GET_TRANSITIONS], request)
            check_ok(response.status)
            return response.transitions

        return self._start(f'the known transitions of {part}', timeout, ask)

    def list_parts_async(self, *, timeout: float | None = None) -> Future:
        """Return a Future of the result of list_parts."""
        self._check(timeout)

        async def ask(pending: PendingRequest) -> list[PartSummary]:
            response = await pending.call(self._services[LIST_PARTS], ListParts.Request())
            check_ok(response.status)
            return list(response.parts)

        return self._start('the list of parts', timeout, ask)

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
            check_ok(response.status)
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
            client = self._action_client(DROP_PART, DropPart)
            result = await pending.simulate(DROP_PART, client, goal, report)
        except AnswerTimeoutError as error:
            if pending.state:
                raise
            raise AnswerTimeoutError(f'{error}; {response.status.message}') from None
        check_ok(result.status)
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
        check_ok(response.status)
        return response.distribution


def check_ok(status: Status) -> None:
    """Raise the error that a status reports, unless it is OK."""
    if status.code != Status.OK:
        raise status_error(status)
