"""A node of the client, which a thread spins, and requests that wait in the thread of the caller.

Every call into rclpy that creates or destroys something runs in the thread that spins the node.
"""

import atexit
import sys
import threading
import time
from collections.abc import Awaitable, Callable, Sequence
from concurrent.futures import Future as ThreadFuture
from concurrent.futures import wait as wait_for_any
from dataclasses import dataclass, field
from functools import partial
from typing import Any, TypeVar
from uuid import uuid4

from rclpy.action import ActionClient
from rclpy.context import Context
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node

from resting_aspects_ros.errors import InvalidValueError, RestingAspectsError
from resting_aspects_ros.ros import interface
from resting_aspects_ros.ros.goal_client import goal_result
from resting_aspects_ros.ros.program import check_domain, not_utf8
from resting_aspects_ros.ros.requests import CanceledError, NotAvailableError

T = TypeVar('T')

# Timeout for the classifier, s: a starting suite needs a few seconds until it is ready.
SERVICE_TIMEOUT = 20.0
# Timeout for the simulator once the classifier is ready, s.
SIMULATOR_TIMEOUT = 10.0
# Time without a response after which a request is sent again, s; it doubles with each retry. A
# discovered service may not have discovered the client yet, or may have been restarted.
RETRY_PERIOD = 5.0
# Interval of checks for conditions that have no event, s.
CHECK_PERIOD = 0.1
# Time in which an abandoned request can cancel the run that it started, s.
END_TIMEOUT = 2.0
CLOSED = 'this client is closed'


class AnswerTimeoutError(NotAvailableError):
    """No result arrived within the timeout."""


class ClientUseError(RestingAspectsError):
    """A client is used after it was closed."""


class Connection:
    """A node of its own, in the context of a given node or in a new one, and the thread of it.

    Names are resolved as those of the given node. Raises InvalidValueError if ROS rejects the
    arguments. ``check`` is called often while a request waits; what it raises ends the wait.
    """

    def __init__(
        self, node: Node | None, ros_args: Sequence[str] | None, check: Callable[[], None]
    ) -> None:
        self._check = check
        self._context = node.context if node is not None else new_context(ros_args)
        self._owns_context = node is None
        name = f'resting_aspects_client_{uuid4().hex[:8]}'
        self.node = Node(
            name,
            context=self._context,
            namespace=node.get_namespace() if node is not None else None,
            use_global_arguments=node is None,
            enable_rosout=False,
            start_parameter_services=False,
        )
        self._names = node or self.node
        self._clients: dict[str, Any] = {}  # of services and actions, by their names
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._closing, self._stopped = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._spin, name=name, daemon=True)
        self._thread.start()
        atexit.register(self.close)  # the thread must not run while the interpreter ends

    @property
    def is_open(self) -> bool:
        """Whether requests are possible."""
        return not (self._closing.is_set() or self._stopped.is_set())

    def check(self) -> None:
        """Raise ClientUseError after `close`, or what the check of the caller raises."""
        if not self.is_open:
            raise ClientUseError(CLOSED)
        self._check()

    def topic(self, name: str) -> str:
        """Return the full name of a topic."""
        return str(self._names.resolve_topic_name(name))

    def service(self, name: str) -> str:
        """Return the full name of a service or an action."""
        return str(self._names.resolve_service_name(name))

    def submit(self, function: Callable[[], Awaitable[T]]) -> 'ThreadFuture[T]':
        """Start a coroutine function in the thread that spins the node."""
        done: ThreadFuture[T] = ThreadFuture()

        async def work() -> None:
            try:
                done.set_result(await function())
            except Exception as error:  # noqa: BLE001 - it would end the thread
                done.set_exception(error)

        if self._stopped.is_set():
            raise ClientUseError(CLOSED)
        self._executor.create_task(work)
        return done

    def run(self, function: Callable[[], T]) -> T:
        """Call a function in the thread that spins the node, and return its result."""

        async def call() -> T:
            return function()

        done = self.submit(call)
        while not (done.done() or self._stopped.is_set()):
            wait_for_any([done], CHECK_PERIOD)
        if not done.done():
            raise ClientUseError(CLOSED)
        return done.result()

    def client(self, kind: Any, name: str) -> Any:
        """Return the client of a service or of an action; the first request creates it."""

        def create() -> Any:
            if name not in self._clients:
                full = self.service(name)
                self._clients[name] = (
                    ActionClient(self.node, kind, full, **interface.ACTION_SERVICES)
                    if hasattr(kind, 'Goal')
                    else self.node.create_client(kind, full, qos_profile=interface.SERVICES)
                )
            return self._clients[name]

        return self.run(create)

    def begin_closing(self) -> None:
        """Let all requests end with a ClientUseError."""
        self._closing.set()

    def close(self) -> None:
        """Stop the thread, and destroy the node."""
        atexit.unregister(self.close)
        self._closing.set()
        if self._thread.is_alive():
            self._executor.create_task(self._stopped.set)
            self._thread.join()
        for client in self._clients.values():
            if isinstance(client, ActionClient):
                client.destroy()
        self._clients.clear()
        self._executor.shutdown()
        self.node.destroy_node()
        if self._owns_context:
            self._context.try_shutdown()

    def _spin(self) -> None:
        try:
            while not self._stopped.is_set() and self._context.ok():
                self._executor.spin_once()
        except ExternalShutdownException:
            pass
        finally:
            self._stopped.set()


@dataclass
class Request:
    """A request that waits in the thread of the caller."""

    connection: Connection
    description: str  # of the result, for errors, such as 'the distribution of l_bracket'
    timeout: float | None  # of the whole request, s
    canceled: Callable[[], bool]
    state: str = ''  # description of the progress, for errors
    _started: float = field(default_factory=time.monotonic)

    def call(self, kind: Any, name: str, request: Any) -> Any:
        """Return the response of a service of the classifier."""
        client = self.connection.client(kind, name)
        start = 'start the suite with "resting_aspects nodes"'
        period, futures = RETRY_PERIOD, list[Any]()
        answered: ThreadFuture[Any] = ThreadFuture()

        def take(future: Any) -> None:
            if not answered.done():
                answered.set_result(future.result())

        try:
            while True:
                self._wait_for_node(
                    interface.ASPECT_CLASSIFIER,
                    name,
                    client.service_is_ready,
                    SERVICE_TIMEOUT,
                    start,
                )
                futures.append(client.call_async(request))
                futures[-1].add_done_callback(take)
                end = time.monotonic() + period
                while time.monotonic() < end:
                    if self._wait(answered, name):
                        return answered.result()
                period *= 2
        finally:
            for each in futures:
                client.remove_pending_request(each)

    def simulate(self, kind: Any, name: str, goal: Any, progress: Callable[[int], object]) -> Any:
        """Return the result of a goal of drop_part or reorient_part, canceled with the request."""
        client = self.connection.client(kind, name)
        self._wait_for_node(
            interface.DROP_SIMULATOR,
            name,
            client.server_is_ready,
            SIMULATOR_TIMEOUT,
            'start drop_simulator',
        )
        unit = 'drops' if name == interface.DROP_PART else 'actions'
        wanted, done, reported = True, 0, 0

        def feedback(message: Any) -> None:
            nonlocal done
            done = max(done, message.done)

        run = partial(goal_result, feedback=feedback, wanted=lambda: wanted)
        result = self.connection.submit(lambda: run(self.connection.node, client, goal))
        try:
            while True:
                is_over = self._wait(result, name)
                if done > reported:
                    reported = done
                    self.state = f'{done} {unit} are done'
                    progress(done)
                if is_over:
                    return result.result()
        finally:
            wanted = False
            wait_for_any([result], END_TIMEOUT)

    def latched(self, kind: Any, name: str, timeout: float) -> Any:
        """Return the latched message of a topic; raises AnswerTimeoutError."""
        connection = self.connection
        message: ThreadFuture[Any] = ThreadFuture()

        def receive(received: Any) -> None:
            if not message.done():
                message.set_result(received)

        subscription = connection.run(
            lambda: connection.node.create_subscription(
                kind, connection.topic(name), receive, interface.LATCHED
            )
        )
        try:
            end = self._started + timeout
            while not self._wait(message, name):
                if time.monotonic() >= end:
                    raise AnswerTimeoutError(f'no message on {name}, waited {timeout:g} s')
            return message.result()
        finally:
            connection.run(partial(connection.node.destroy_subscription, subscription))

    def pause(self, name: str) -> None:
        """Wait for CHECK_PERIOD; raises if the request has ended or timed out."""
        self._wait(ThreadFuture(), name)

    def _wait(self, future: 'ThreadFuture[Any]', name: str) -> bool:
        """Wait for CHECK_PERIOD at most; return whether a future is done.

        Raises RestingAspectsError if the request has ended or timed out.
        """
        wait_for_any([future], CHECK_PERIOD)
        if future.done():
            return True
        self._check()
        if self.timeout is not None and time.monotonic() >= self._started + self.timeout:
            state = f': {self.state}' if self.state else ''
            raise AnswerTimeoutError(
                f'{self.connection.service(name)} did not return {self.description}, '
                f'waited {self.timeout:g} s{state}'
            )
        return False

    def _check(self) -> None:
        """Raise RestingAspectsError if the request was canceled, or what the connection raises."""
        self.connection.check()
        if self.canceled():
            raise CanceledError(f'the request of {self.description} was canceled')

    def _wait_for_node(
        self, kind: str, name: str, is_offered: Callable[[], bool], timeout: float, hint: str
    ) -> None:
        """Wait until a node of a kind is alive and its service is discovered."""
        connection = self.connection
        present = connection.topic(f'{interface.PRESENCE}/{kind}')
        start = self._started if self.timeout is not None else time.monotonic()
        timeout = timeout if self.timeout is None else min(timeout, self.timeout)
        while True:
            self._check()
            if is_offered() and connection.node.count_publishers(present):
                return
            waited = time.monotonic() - start
            if waited >= timeout:
                raise AnswerTimeoutError(
                    f'no {kind} answers on {connection.service(name)}, waited {timeout:g} s: '
                    f'{hint}'
                )
            time.sleep(min(CHECK_PERIOD, timeout - waited))


def new_context(ros_args: Sequence[str] | None) -> Context:
    """Return a context that is independent of other nodes and signal handlers."""
    check_domain()
    context = Context()
    arguments = sys.argv if ros_args is None else ['--ros-args', *ros_args]
    try:
        context.init(arguments)
    except RuntimeError as error:  # rclpy raises it for any invalid argument
        text = ' '.join(arguments[1:])
        raise InvalidValueError(f'invalid --ros-args {text!r}: {error}') from None
    except UnicodeEncodeError as error:
        raise not_utf8(error) from None
    return context
