"""A pending request of a client to the suite; its work runs in callbacks of the node."""

import time
from collections.abc import Awaitable, Callable
from typing import Any

from rclpy.action import ActionClient
from rclpy.callback_groups import CallbackGroup
from rclpy.client import Client
from rclpy.node import Node
from rclpy.task import Future

from resting_aspects_ros.errors import RestingAspectsError
from resting_aspects_ros.ros.callbacks import sleep_for, steady_timer, wait_for
from resting_aspects_ros.ros.goal_client import goal_result
from resting_aspects_ros.ros.interface import (
    ASPECT_CLASSIFIER,
    DROP_PART,
    DROP_SIMULATOR,
    PRESENCE,
)
from resting_aspects_ros.ros.status import CanceledError, NotAvailableError

# Timeout for the classifier, s: a starting suite needs a few seconds until it is ready.
SERVICE_TIMEOUT = 20.0
# Timeout for the simulator once the classifier is ready, s.
SIMULATOR_TIMEOUT = 10.0
# Time after which a warning reports that a node is not ready, s; starting nodes need less.
WARN_DELAY = 5.0
# Time without a response after which a request is sent again, s; it doubles with each retry. A
# discovered service may not have discovered the client yet, or may have been restarted.
RETRY_PERIOD = 5.0
# Interval of checks for conditions that have no event, s.
CHECK_PERIOD = 0.1


class AnswerTimeoutError(NotAvailableError):
    """No result arrived within the timeout."""


class PendingRequest:
    """Does the work of a request in the callbacks of a node.

    answer : future of the result; cancel it to stop waiting
    state : text describing the progress
    finished : future that is done when the work has ended too

    Parameters
    ----------
    group : CallbackGroup
        A reentrant group, since the work waits within a callback.
    description : str
        Description of the result for errors, such as 'the distribution of l_bracket'.
    timeout : float, optional
        Timeout of the whole request, s; None: no limit.
    work : returns the result
    warn : called once if a node is not ready after WARN_DELAY
    """

    def __init__(
        self,
        node: Node,
        group: CallbackGroup,
        description: str,
        timeout: float | None,
        work: Callable[['PendingRequest'], Awaitable[Any]],
        warn: Callable[[str], object],
    ) -> None:
        self._node = node
        self._group = group
        self._description = description
        self._timeout = timeout
        self._work = work
        self._warn = warn
        self._warned = False
        self._started = time.monotonic()
        self.state = ''
        self.finished = Future()
        # Without an executor, its callbacks run at once, whichever executor spins the node.
        self.answer = Future()
        self._timer = steady_timer(node, 0.0, self._start, group)

    @property
    def ended(self) -> bool:
        """Whether the request has a result or was canceled; a canceled Future is not done."""
        return bool(self.answer.done() or self.answer.cancelled())

    def fail(self, error: Exception) -> None:
        """Set an error as the result, unless the request has ended."""
        if not self.ended:
            self.answer.set_exception(error)

    async def call(self, client: Client, request: Any) -> Any:
        """Return the response of a service of the classifier."""
        period, responses = RETRY_PERIOD, list[Future]()
        try:
            while True:
                await self._ready(
                    ASPECT_CLASSIFIER,
                    client.service_name,
                    client.service_is_ready,
                    SERVICE_TIMEOUT,
                    'start the suite with "resting_aspects nodes"',
                )
                responses.append(client.call_async(request))
                end = time.monotonic() + period
                while time.monotonic() < end:
                    await wait_for(self._node, responses[-1], CHECK_PERIOD, self._group)
                    if done := [each for each in responses if each.done()]:
                        return done[0].result()
                    self._check(client.service_name)
                period *= 2
        finally:
            for each in responses:
                client.remove_pending_request(each)

    async def simulate(
        self, action: str, client: ActionClient, goal: Any, progress: Callable[[int], object]
    ) -> Any:
        """Return the result of a goal of drop_part or reorient_part, canceled with the request."""
        topic = self._node.resolve_service_name(action)
        unit = 'drops' if action == DROP_PART else 'actions'

        def on_feedback(feedback: Any) -> None:
            self.state = f'{feedback.done} {unit} are done'
            if not self.ended:
                progress(feedback.done)

        start = f'start {DROP_SIMULATOR}'
        await self._ready(DROP_SIMULATOR, topic, client.server_is_ready, SIMULATOR_TIMEOUT, start)
        try:
            return await goal_result(
                self._node,
                client,
                goal,
                group=self._group,
                feedback=on_feedback,
                wanted=lambda: not self.ended and not self._timed_out(),
            )
        except CanceledError:
            self._check(topic)
            raise

    async def pause(self, name: str) -> None:
        """Wait for CHECK_PERIOD; raises if the request has ended or timed out."""
        await sleep_for(self._node, CHECK_PERIOD, self._group)
        self._check(name)

    async def _start(self) -> None:
        self._node.destroy_timer(self._timer)
        try:
            result = await self._work(self)
        except Exception as error:  # noqa: BLE001 - the caller must receive every error
            self.fail(error)
        else:
            if not self.ended:
                self.answer.set_result(result)
        self.finished.set_result(None)

    async def _ready(
        self, kind: str, name: str, is_offered: Callable[[], bool], timeout: float, hint: str
    ) -> None:
        """Wait until a node of a kind is alive and its service is discovered."""
        start = self._started if self._timeout is not None else time.monotonic()
        timeout = timeout if self._timeout is None else min(timeout, self._timeout)
        while not (is_offered() and self._node.count_publishers(f'{PRESENCE}/{kind}')):
            waited = time.monotonic() - start
            if waited >= timeout:
                raise AnswerTimeoutError(
                    f'no {kind} answers on {name}, waited {timeout:g} s: {hint}'
                )
            self._check(name)
            if waited >= WARN_DELAY and not self._warned:
                self._warned = True
                self._warn(f'no {kind} answers on {name} yet, waiting up to {timeout:g} s')
            await sleep_for(self._node, min(CHECK_PERIOD, timeout - waited), self._group)

    def _timed_out(self) -> bool:
        return self._timeout is not None and time.monotonic() >= self._started + self._timeout

    def _check(self, name: str) -> None:
        """Raise RestingAspectsError if the request has ended or timed out."""
        if self.ended:
            raise RestingAspectsError('the request has ended')
        if self._timed_out():
            state = f': {self.state}' if self.state else ''
            raise AnswerTimeoutError(
                f'{name} did not return {self._description}, waited {self._timeout:g} s{state}'
            )
