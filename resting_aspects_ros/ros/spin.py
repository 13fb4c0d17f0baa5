"""Run nodes in a process until it receives a signal to stop."""

import ctypes
import inspect
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from itertools import takewhile
from pathlib import Path
from typing import Protocol, runtime_checkable

import rclpy
from rclpy.duration import Duration
from rclpy.exceptions import ParameterException
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future

from resting_aspects_ros.errors import InvalidValueError, RestingAspectsError, one_line, shown
from resting_aspects_ros.ros.parameters import Parameter, help_text, unknown_parameters
from resting_aspects_ros.system import catch

# Constants of Linux: <time.h>, <signal.h>.
_CLOCK_MONOTONIC, _SIGEV_THREAD = 1, 2


class _Event(ctypes.Structure):
    """``struct sigevent`` of a timer that calls a function with a value; 64 bytes."""

    _fields_ = (
        ('value', ctypes.c_void_p),
        ('signal', ctypes.c_int),
        ('notify', ctypes.c_int),
        ('function', ctypes.c_void_p),
        ('attributes', ctypes.c_void_p),
        ('padding', ctypes.c_byte * 32),
    )


class _Times(ctypes.Structure):
    """``struct itimerspec``: period and start, each in s and ns."""

    _fields_ = tuple((name, ctypes.c_long) for name in ('every_s', 'every_ns', 's', 'ns'))


@contextmanager
def at_most(seconds: int, code: int) -> Iterator[None]:
    """End this process with an exit code if the block takes longer, without any cleaning up.

    A thread of Python could not do so: native code that waits for ever may hold the lock of the
    interpreter. A timer of the operating system calls ``_exit`` of the C library instead.
    """
    library = ctypes.CDLL(None)
    end = ctypes.cast(library._exit, ctypes.c_void_p)  # noqa: SLF001 - a public C function
    event = _Event(value=code, notify=_SIGEV_THREAD, function=end)
    timer = ctypes.c_void_p()
    library.timer_create(_CLOCK_MONOTONIC, ctypes.byref(event), ctypes.byref(timer))
    library.timer_settime(timer, 0, ctypes.byref(_Times(s=seconds)), None)
    try:
        yield
    finally:
        library.timer_delete(timer)


# The domain with the highest UDP ports.
MAX_DOMAIN = 232
# Time for the middleware to leave the network, s. Rarely, Fast DDS 2.14 waits for ever there, if
# it finds at the same time that another process is gone (eProsima/Fast-DDS, issue 6502).
SHUTDOWN = 10
# Time that subscribers have to receive the last messages of nodes that stop, s.
DELIVERY = 1.0


@runtime_checkable
class Closing(Protocol):
    """A node that ends more than its ROS entities."""

    def close(self) -> None:
        """End what the node has started, before it is destroyed."""


def spin_nodes(factories: Sequence[Callable[[], Node]], args: list[str] | None = None) -> int:
    """Create the nodes and spin them in one thread; return the exit code of the process.

    Ctrl-C, SIGTERM and a closed terminal stop the nodes, with exit code 0. The exit code is 2 if a
    node cannot start (an invalid parameter, a missing folder), and 1 if a node cannot continue (a
    log that became damaged).
    """
    stopped = _stop_signal()
    try:
        check_domain()
        # The handlers of rclpy would shut its context down at once, in the middle of a callback
        # that publishes. Those of Python would raise there, and rclpy's C++ code would turn the
        # exception into a TypeError.
        rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    except (InvalidValueError, RuntimeError) as error:  # rclpy raises the latter
        return _print_error(error)
    except UnicodeEncodeError as error:
        return _print_error(not_utf8(error))
    return _spin(factories, stopped)


def run_node(factory: Callable[[], Node], parameters: Iterable[Parameter]) -> int:
    """Run one node as a program; return the exit code. Accepts --help and ROS arguments."""
    program = Path(sys.argv[0]).name
    arguments = list(takewhile(lambda argument: argument != '--ros-args', sys.argv[1:]))
    if '--help' in arguments or '-h' in arguments:
        description = inspect.getdoc(factory) or ''
        print(help_text(program, description.partition('\n\nParameters\n')[0], parameters))
        return 0
    if arguments:
        print(f'error: unknown argument {arguments[0]!r}: see {program} --help', file=sys.stderr)
        return 2
    return spin_nodes([factory])


def _stop_signal() -> Future:
    """Return a future that is done as soon as the process receives a signal to stop.

    Signal handlers of Python do not run while rclpy waits, and checking for signals between short
    waits doubles the response time. Therefore a thread waits on the wakeup descriptor, to which
    Python writes the number of each signal.
    """
    stopped = Future()
    read, write = os.pipe()
    os.set_blocking(write, False)
    signal.set_wakeup_fd(write)
    # A shell makes background processes ignore SIGINT, but it must stop nodes there too.
    signal.signal(signal.SIGINT, _handle_signal)
    catch(_handle_signal)
    thread = threading.Thread(target=lambda: stopped.set_result(os.read(read, 1)), daemon=True)
    thread.start()
    return stopped


def _handle_signal(*_: object) -> None:
    """Do nothing: the waiting thread handles the signal."""


def _spin(factories: Sequence[Callable[[], Node]], stopped: Future) -> int:
    nodes: list[Node] = []
    executor = SingleThreadedExecutor()
    code = 2
    try:
        for factory in factories:
            nodes.append(factory())
            executor.add_node(nodes[-1])
        for name in unknown_parameters(nodes):
            nodes[0].get_logger().warning(f'ignored unknown parameter {name!r}')
        code = 1
        # A task ends the wait; spin_until_future_complete would add a callback in each iteration.
        stopped.add_done_callback(lambda _: executor.create_task(lambda: None))
        while not stopped.done():
            executor.spin_once()
    except (RestingAspectsError, ParameterException) as error:
        return _print_error(error, code)
    finally:
        for node in nodes:
            if isinstance(node, Closing):
                node.close()
        with at_most(SHUTDOWN, 0 if stopped.done() else code):
            _deliver(nodes)
            for node in nodes:
                node.destroy_node()
            executor.shutdown()
            rclpy.try_shutdown()
    return 0


def _deliver(nodes: Iterable[Node]) -> None:
    """Wait until the subscribers have what was published, which otherwise ends with the node."""
    end = time.monotonic() + DELIVERY
    for node in nodes:
        for publisher in node.publishers:
            left = max(end - time.monotonic(), 0.0)
            publisher.wait_for_all_acked(Duration(seconds=left))


def check_domain() -> None:
    """Raise InvalidValueError for a ROS domain with which Fast DDS would end the process."""
    domain = os.environ.get('ROS_DOMAIN_ID') or '0'
    if not (
        domain.isascii() and domain.isdigit() and len(domain) < 20 and int(domain) <= MAX_DOMAIN
    ):
        raise InvalidValueError(
            f'invalid ROS_DOMAIN_ID {shown(domain)}: expected an integer from 0 to {MAX_DOMAIN}'
        )


def not_utf8(error: UnicodeEncodeError) -> InvalidValueError:
    """Return the error for an argument that is not UTF-8."""
    return InvalidValueError(
        f'invalid argument {error.object!r}: expected UTF-8, which ROS requires'
    )


def _print_error(error: Exception, code: int = 2) -> int:
    print('error:', one_line(str(error), 2000), file=sys.stderr)
    return code
