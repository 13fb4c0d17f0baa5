"""Private node of a client created without one: it is spun only while the client waits."""

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
from resting_aspects_ros.errors import InvalidValueError, RestingAspectsError
from resting_aspects_ros.ros.callbacks import steady_timer
from resting_aspects_ros.ros.interface import LATCHED
from resting_aspects_ros.ros.spin import check_domain, not_utf8

SPIN_PERIOD = 0.1
# Time in which an abandoned request can cancel the run that it started, s.
END_TIMEOUT = 2.0
CLOSED = 'this client is closed'


class ClientUseError(RestingAspectsError):
    """A client is used in a way in which a response could never arrive."""


class PrivateNode:
    """A node in a context of its own, independent of other nodes and signal handlers.

    Parameters
    ----------
    ros_args : sequence of str, optional
        ROS arguments. None: those on the command line of the program after --ros-args.
    check : called often while the client waits; an exception that it raises ends the wait

    Raises
    ------
    InvalidValueError
        ROS rejects the arguments.
    """

    def __init__(self, ros_args: Sequence[str] | None, check: Callable[[], None]) -> None:
        self._check = check
        self._wait_lock = threading.Lock()
        check_domain()
        self._context = Context()
        arguments = sys.argv if ros_args is None else ['--ros-args', *ros_args]
        try:
            self._context.init(arguments)
        except RuntimeError as error:  # rclpy raises it for any invalid argument
            text = ' '.join(arguments[1:])
            raise InvalidValueError(f'invalid --ros-args {text!r}: {error}') from None
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
    def is_waiting(self) -> bool:
        """Whether the client waits for a response, and thus spins the node."""
        return self._wait_lock.locked()

    def wait(
        self, send: Callable[[], Future], unfinished: Callable[[], object] = lambda: False
    ) -> Any:
        """Send a request, spin until its result arrives, and return it or raise its error.

        unfinished : returns whether a canceled request must still cancel what it started
        """
        if not self._wait_lock.acquire(blocking=False):
            raise ClientUseError(
                'this client is already waiting for a response: wait for one at a time, and use a '
                'client of its own in each thread'
            )
        try:
            self._check_open()
            answer = send()
            try:
                while not answer.done():
                    self._check()
                    self._check_open()
                    self._executor.spin_once(timeout_sec=SPIN_PERIOD)
            finally:
                answer.cancel()  # in case of an exception
                end = time.monotonic() + END_TIMEOUT
                while self._context.ok() and unfinished() and time.monotonic() < end:
                    self._executor.spin_once(timeout_sec=SPIN_PERIOD)
            return answer.result()
        finally:
            self._wait_lock.release()

    def spin_for(self, seconds: float) -> None:
        """Spin for a time, for messages that are still on their way."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            self._executor.spin_once(timeout_sec=left)

    def receive_latched(self, kind: Any, topic: str, seconds: float) -> Any:
        """Return the latched message of a topic; raises AnswerTimeoutError."""
        message = Future()
        error = AnswerTimeoutError(f'no message on {topic}, waited {seconds:g} s')
        subscription = self.node.create_subscription(kind, topic, message.set_result, LATCHED)
        timer = steady_timer(self.node, seconds, lambda: message.set_exception(error))
        try:
            return self.wait(lambda: message)
        finally:
            self.node.destroy_subscription(subscription)
            self.node.destroy_timer(timer)

    def close(self) -> None:
        """Destroy the node and its context."""
        self._executor.shutdown()
        self.node.destroy_node()
        self._context.try_shutdown()

    def _check_open(self) -> None:
        if not self._context.ok():
            raise ClientUseError(CLOSED)
