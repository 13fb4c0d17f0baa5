"""A request to a service of the suite, until it is answered, by whoever spins the node."""

import threading
import time
from collections.abc import Callable
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.client import Client
from rclpy.node import Node
from rclpy.task import Future
from resting_aspects_interfaces.msg import Status

from resting_aspects_ros.core.errors import RestingAspectsError
from resting_aspects_ros.nodes.callbacks import steady_timer
from resting_aspects_ros.nodes.requests import CanceledError, NotAvailableError, status_error
from resting_aspects_ros.nodes.run_watch import RunWatch

# A suite that is just starting needs a few seconds to be found, s.
SERVICE_TIMEOUT = 20.0
# Nodes that start need so long; after it who waits wonders, s.
PATIENCE = 5.0
# Without an answer and without a sign of life the same is asked again after this, s, and then
# after twice as long each time: it is joined, or cheap. A sign of life begins it anew.
ASK_PERIOD = 5.0
# One that reads logs, which may have the answer, is asked again after this, s.
LOADING_PERIOD = 0.5
# A classifier that was asked says so long after the end of its run why it ended, at the latest, s;
# then it is another one, which was not asked.
LAST_WORD = 4.0
# How often it is looked whether it is time for something, s.
LOOK_PERIOD = 0.1


class AnswerTimeoutError(NotAvailableError):
    """Nothing came in the time that was allowed."""


class Question:
    """Asks, and asks again while nothing is heard, until there is an answer or no hope of one.

    A classifier that was found and has not yet found who asks cannot answer, nor can one that was
    started again since: to ask once is not enough.

    Parameters
    ----------
    group : CallbackGroup
        None that is held up while somebody awaits the answer.
    what : str
        What is asked for, in words: 'the distribution of l_bracket'.
    timeout : float, optional
        For all of it, s; None: as long as there is a classifier.
    read : called with the response if its status is OK or one of ``also``; gives the answer
    also : other codes of a status that are answers
    warn : called with what comes with an answer for a person to know, and once if there is no
        classifier for a while
    watch : RunWatch, optional
        Of the run that is waited for; ended with the question.
    """

    def __init__(
        self,
        node: Node,
        group: CallbackGroup,
        client: Client,
        request: Any,
        what: str,
        timeout: float | None,
        read: Callable[[Any], Any],
        *,
        warn: Callable[[str], object],
        also: tuple[int, ...] = (),
        watch: RunWatch | None = None,
    ) -> None:
        self._node = node
        self._client = client
        self._request = request
        self._what = what
        self._timeout = timeout
        self._read = read
        self._warn = warn
        self._codes = (Status.OK, *also)
        self._watch = watch
        self._asked: list[Future] = []
        self._period = 0.0
        self._loading = ''  # what the classifier reads first, in words
        self._told = False  # that there is no classifier yet
        self._begun = self._last = time.monotonic()
        # Held for good by whoever is the first to end it: an answer, a deadline or a cancel.
        self._end = threading.Lock()
        # Without an executor: its callbacks run at once, whoever spins the node by then.
        self.answer = Future()
        self.answer.add_done_callback(self._stop)
        self._timer = steady_timer(node, LOOK_PERIOD, self._look, group)
        self._look()

    def _look(self) -> None:
        """Do what it is time for."""
        now = time.monotonic()
        if self._watch is not None and self._watch.last > self._last:
            self._last, self._period = self._watch.last, ASK_PERIOD
        if self._asked and self._timeout is not None and now >= self._begun + self._timeout:
            self.fail(
                AnswerTimeoutError(
                    f'{self._client.service_name} did not give {self._what}, waited '
                    f'{self._timeout:g} s{self._state()}'
                )
            )
        elif self._watch is not None and self._watch.ended:
            # To ask again would begin it anew, which is not for this to decide.
            if now >= self._watch.ended + LAST_WORD:
                self.fail(CanceledError(f'no answer for {self._what}: {self._watch.state}'))
        elif now >= self._last + self._period:
            self._ask(now)

    def _state(self) -> str:
        """Why there may be no answer yet, if that is known."""
        if not self._client.service_is_ready():
            return ': no aspect_classifier is there any more'
        state = (self._watch.state if self._watch else '') or self._loading
        return f': {state}' if state else ''

    def _ask(self, now: float) -> None:
        """Ask, if there is a classifier."""
        patience = SERVICE_TIMEOUT if self._timeout is None else self._timeout
        patience = min(patience, SERVICE_TIMEOUT)
        if self._client.service_is_ready():
            self._last = now
            self._period = 2 * self._period or ASK_PERIOD
            asked = self._client.call_async(self._request)
            self._asked.append(asked)
            asked.add_done_callback(self._take)
        elif self._asked:
            self.fail(
                NotAvailableError(f'the classifier went away while {self._what} was asked for')
            )
        elif now >= self._begun + patience:
            self.fail(
                AnswerTimeoutError(
                    f'no aspect_classifier answers on {self._client.service_name}, waited '
                    f'{patience:g} s: start the suite with "resting_aspects nodes"'
                )
            )
        elif now >= self._begun + PATIENCE and not self._told:
            self._told = True
            self._warn(
                f'no aspect_classifier answers on {self._client.service_name} yet, it is waited '
                f'for {patience:g} s'
            )

    def _take(self, asked: Future) -> None:
        response = asked.result()
        if response.status.code == Status.LOADING:
            self._last, self._period = time.monotonic(), LOADING_PERIOD
            self._loading = response.status.message
            return
        if not self._end.acquire(blocking=False):
            return  # the other answer to what was asked twice
        try:
            if response.status.code not in self._codes:
                raise status_error(response.status)
            found = self._read(response)
            if response.status.code == Status.OK and response.status.message:
                self._warn(response.status.message)
        except Exception as error:  # noqa: BLE001 - who waits for the answer must hear of it
            self.answer.set_exception(error)
        else:
            self.answer.set_result(found)

    def fail(self, error: RestingAspectsError) -> None:
        """Answer with an error, unless it is over."""
        if self._end.acquire(blocking=False):
            self.answer.set_exception(error)

    def _stop(self, _: Future) -> None:
        self._end.acquire(blocking=False)
        self._node.destroy_timer(self._timer)
        if self._watch is not None:
            self._watch.end()
        for asked in self._asked:
            self._client.remove_pending_request(asked)
