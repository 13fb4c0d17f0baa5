"""A request of a client to the suite, until it is answered, by whoever spins the node."""

import time
from collections.abc import Awaitable, Callable
from typing import Any

from rclpy.action import ActionClient
from rclpy.callback_groups import CallbackGroup
from rclpy.client import Client
from rclpy.node import Node
from rclpy.task import Future
from resting_aspects_interfaces.action import DropPart

from resting_aspects_ros.core.errors import RestingAspectsError
from resting_aspects_ros.ros.callbacks import sleep_for, steady_timer, wait_for
from resting_aspects_ros.ros.drop_part_client import drop_result
from resting_aspects_ros.ros.interface import (
    ASPECT_CLASSIFIER,
    DROP_PART,
    DROP_SIMULATOR,
    PRESENCE,
)
from resting_aspects_ros.ros.status import CanceledError, NotAvailableError

# A suite that is just starting needs a few seconds to be ready, s.
SERVICE_TIMEOUT = 20.0
# A simulator of a suite whose classifier is ready is ready within this, s.
SIMULATOR_TIMEOUT = 10.0
# Nodes that start need so long; after it the user is told what is waited for, s.
PATIENCE = 5.0
# Without an answer the same is asked again after this, s, then after twice as long each time: a
# service that was discovered may not have discovered the client yet, or was started again.
ASK_PERIOD = 5.0
# How often conditions that have no event are checked, s.
LOOK_PERIOD = 0.1


class AnswerTimeoutError(NotAvailableError):
    """Nothing came in the time that was allowed."""


class PendingRequest:
    """Does the work of a request in the callbacks of a node.

    answer : done when the request is over; cancel it to wait no longer
    state : how far it is, in words
    over : whether the work has ended, too

    Parameters
    ----------
    group : CallbackGroup
        Reentrant: the work waits within a callback.
    what : str
        What is asked for, in words: 'the distribution of l_bracket'.
    timeout : float, optional
        For all of it, s; None: as long as it takes.
    work : gives the answer
    warn : called once if no node is ready for a while
    """

    def __init__(
        self,
        node: Node,
        group: CallbackGroup,
        what: str,
        timeout: float | None,
        work: Callable[['PendingRequest'], Awaitable[Any]],
        warn: Callable[[str], object],
    ) -> None:
        self._node = node
        self._group = group
        self._what = what
        self._timeout = timeout
        self._work = work
        self._warn = warn
        self._told = False
        self._begun = time.monotonic()
        self.state = ''
        self.over = Future()
        # Without an executor: its callbacks run at once, whoever spins the node by then.
        self.answer = Future()
        self._timer = steady_timer(node, 0.0, self._start, group)

    @property
    def ended(self) -> bool:
        """Whether there is an answer, or nobody waits for one; a canceled Future is not done."""
        return bool(self.answer.done() or self.answer.cancelled())

    def fail(self, error: Exception) -> None:
        """Answer with an error, unless it is over."""
        if not self.ended:
            self.answer.set_exception(error)

    async def call(self, client: Client, request: Any) -> Any:
        """Return the response of a service of the classifier."""
        period, asked = ASK_PERIOD, list[Future]()
        try:
            while True:
                await self._ready(
                    ASPECT_CLASSIFIER,
                    client.service_name,
                    client.service_is_ready,
                    SERVICE_TIMEOUT,
                    'start the suite with "resting_aspects nodes"',
                )
                asked.append(client.call_async(request))
                end = time.monotonic() + period
                while time.monotonic() < end:
                    await wait_for(self._node, asked[-1], LOOK_PERIOD, self._group)
                    if done := [each for each in asked if each.done()]:
                        return done[0].result()
                    self._check(client.service_name)
                period *= 2
        finally:
            for each in asked:
                client.remove_pending_request(each)

    async def drop(
        self, client: ActionClient, goal: DropPart.Goal, progress: Callable[[int], object]
    ) -> DropPart.Result:
        """Return the result of a drop_part goal, which is canceled with the request."""
        topic = self._node.resolve_service_name(DROP_PART)

        def note(feedback: DropPart.Feedback) -> None:
            self.state = f'{feedback.done} drops are done'
            if not self.ended:
                progress(feedback.done)

        start = f'start {DROP_SIMULATOR}'
        await self._ready(DROP_SIMULATOR, topic, client.server_is_ready, SIMULATOR_TIMEOUT, start)
        try:
            return await drop_result(
                self._node,
                client,
                goal,
                group=self._group,
                feedback=note,
                wanted=lambda: not self.ended and not self._late(),
            )
        except CanceledError:
            self._check(topic)
            raise

    async def pause(self, name: str) -> None:
        """Wait a moment; raises if the request is over or late."""
        await sleep_for(self._node, LOOK_PERIOD, self._group)
        self._check(name)

    async def _start(self) -> None:
        self._node.destroy_timer(self._timer)
        try:
            found = await self._work(self)
        except Exception as error:  # noqa: BLE001 - whoever waits for the answer must be told
            self.fail(error)
        else:
            if not self.ended:
                self.answer.set_result(found)
        self.over.set_result(None)

    async def _ready(
        self, kind: str, name: str, offered: Callable[[], bool], patience: float, hint: str
    ) -> None:
        """Wait until a node has announced that it is ready, and its service is discovered."""
        begun = self._begun if self._timeout is not None else time.monotonic()
        patience = patience if self._timeout is None else min(patience, self._timeout)
        while not (offered() and self._node.count_publishers(f'{PRESENCE}/{kind}')):
            waited = time.monotonic() - begun
            if waited >= patience:
                raise AnswerTimeoutError(
                    f'no {kind} answers on {name}, waited {patience:g} s: {hint}'
                )
            self._check(name)
            if waited >= PATIENCE and not self._told:
                self._told = True
                self._warn(f'no {kind} answers on {name} yet, waiting up to {patience:g} s')
            await sleep_for(self._node, min(LOOK_PERIOD, patience - waited), self._group)

    def _late(self) -> bool:
        return self._timeout is not None and time.monotonic() >= self._begun + self._timeout

    def _check(self, name: str) -> None:
        """Raises if nobody waits for the answer any more, or it is late."""
        if self.ended:
            raise RestingAspectsError('the request is over')
        if self._late():
            state = f': {self.state}' if self.state else ''
            raise AnswerTimeoutError(
                f'{name} did not give {self._what}, waited {self._timeout:g} s{state}'
            )
