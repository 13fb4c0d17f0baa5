"""A node for who has none: in a context of its own, spun only while somebody waits."""

import sys
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any
from uuid import uuid4

from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.task import Future

from resting_aspects_ros.client.pending_request import AnswerTimeoutError
from resting_aspects_ros.core.errors import InvalidValueError, RestingAspectsError
from resting_aspects_ros.ros.callbacks import steady_timer
from resting_aspects_ros.ros.interface import LATCHED
from resting_aspects_ros.ros.spin import check_domain, not_utf8

SPIN_PERIOD = 0.1
# A request that is given up has so long to cancel the run that it began, s.
END_TIMEOUT = 2.0
CLOSED = 'this client is closed'


class ClientUseError(RestingAspectsError):
    """A client is used in a way in which an answer could never come."""


class PrivateNode:
    """It meets no other node, context or signal handler of the process.

    Parameters
    ----------
    ros_args : sequence of str, optional
        What could follow --ros-args. None: what does on the command line of the program.
    check : called often while somebody waits; raises if there is no use in waiting any longer

    Raises
    ------
    InvalidValueError
        ROS refuses the arguments.
    """

    def __init__(self, ros_args: Sequence[str] | None, check: Callable[[], None]) -> None:
        self._check = check
        self._waits = threading.Lock()
        check_domain()
        self._context = Context()
        arguments = sys.argv if ros_args is None else ['--ros-args', *ros_args]
        try:
            self._context.init(arguments)
        except RuntimeError as error:  # all that rclpy raises for arguments
            words = ' '.join(arguments[1:])
            raise InvalidValueError(f'--ros-args is {words!r}, ROS refuses: {error}') from None
        except UnicodeEncodeError as error:
            raise not_utf8(error) from None
        self.node = Node(
            f'resting_aspects_client_{uuid4().hex[:8]}',
            context=self._context,
            enable_rosout=False,
            start_parameter_services=False,
        )
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)

    @property
    def is_spun(self) -> bool:
        """Whether somebody waits."""
        return self._waits.locked()

    def wait(
        self, ask: Callable[[], Future], unfinished: Callable[[], object] = lambda: False
    ) -> Any:
        """Ask, spin until the answer is there, and give it, or raise its error.

        unfinished : whether a request that was canceled has not ended what it began
        """
        if not self._waits.acquire(blocking=False):
            raise ClientUseError(
                'this client waits for an answer already, allowed is one at a time: another '
                'thread needs a client of its own'
            )
        try:
            self._check_open()
            answer = ask()
            try:
                while not answer.done():
                    self._check()
                    self._check_open()
                    self._executor.spin_once(timeout_sec=SPIN_PERIOD)
            finally:
                answer.cancel()  # if something else ended it
                end = time.monotonic() + END_TIMEOUT
                while self._context.ok() and unfinished() and time.monotonic() < end:
                    self._executor.spin_once(timeout_sec=SPIN_PERIOD)
            return answer.result()
        finally:
            self._waits.release()

    def latched(self, kind: Any, topic: str, seconds: float) -> Any:
        """The latched message of a topic; AnswerTimeoutError if none comes in the time."""
        message = Future()
        late = AnswerTimeoutError(f'nothing came on {topic}, waited {seconds:g} s')
        heard = self.node.create_subscription(kind, topic, message.set_result, LATCHED)
        timer = steady_timer(self.node, seconds, lambda: message.set_exception(late))
        try:
            return self.wait(lambda: message)
        finally:
            self.node.destroy_subscription(heard)
            self.node.destroy_timer(timer)

    def close(self) -> None:
        """End the node and its context."""
        self._executor.shutdown()
        self.node.destroy_node()
        self._context.try_shutdown()

    def _check_open(self) -> None:
        if not self._context.ok():
            raise ClientUseError(CLOSED)
