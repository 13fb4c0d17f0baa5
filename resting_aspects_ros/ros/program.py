"""A node as a program: its parameters, and its life until a signal to stop."""

import argparse
import ctypes
import inspect
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import takewhile
from typing import Any

import rclpy
from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.duration import Duration
from rclpy.exceptions import ParameterException
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future

from resting_aspects_ros.errors import InvalidValueError, RestingAspectsError, one_line, shown
from resting_aspects_ros.ros.interface import FRAME
from resting_aspects_ros.system import catch

# -- Parameters -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Parameter:
    """A parameter of a node.

    description : includes the unit
    bounds : inclusive bounds of a number
    allowed : description of the valid values of a text parameter, which the node checks
    changeable : whether it can be set while the node runs, see `on_change`; else it is read-only
    """

    name: str
    default: Any
    description: str
    bounds: tuple[float, float] | None = None
    allowed: str = ''
    changeable: bool = False

    def __post_init__(self) -> None:
        if self.bounds is not None:
            self.check(self.default)

    def check(self, value: float) -> None:
        """Raise InvalidValueError if a number is out of bounds or NaN.

        ROS checks the bounds too, but accepts values just beyond them.
        """
        assert self.bounds is not None
        low, high = self.bounds
        if not low <= value <= high:
            raise InvalidValueError(f'invalid {self.name} {value!r}: expected {low:g} to {high:g}')


FRAME_ID = Parameter(
    'frame_id',
    FRAME,
    'frame of all poses and markers: z up, z = 0 is the surface',
    allowed='the name of a frame, without a leading slash',
)


def check_frame(name: str) -> str:
    """Return the name of a frame; raises InvalidValueError if it is not valid."""
    if not name or name.startswith('/') or not name.isprintable():
        raise InvalidValueError(f'invalid {FRAME_ID.name} {name!r}: expected {FRAME_ID.allowed}')
    return name


def declare(node: Node, parameters: Iterable[Parameter]) -> dict[str, Any]:
    """Declare parameters and return their values.

    Raises rclpy's InvalidParameterValueException for a value out of bounds.
    """
    declared = {p.name: p for p in parameters}

    def convert(values: Iterable[RosParameter]) -> list[RosParameter]:
        return [_as_declared(declared[p.name], p) if p.name in declared else p for p in values]

    def check_bounds(name: str, value: Any) -> None:
        if name in declared and declared[name].bounds is not None:
            declared[name].check(value)

    _reject_invalid(node, check_bounds)
    node.add_pre_set_parameters_callback(convert)
    # ROS does not call the callback for values given at the start.
    overrides = node._parameter_overrides  # noqa: SLF001
    overrides.update({p.name: p for p in convert(list(overrides.values()))})
    return {
        name: node.declare_parameter(name, p.default, _descriptor(p)).value
        for name, p in declared.items()
    }


def on_change(
    node: Node, name: str, check: Callable[[Any], object], callback: Callable[[Any], object]
) -> None:
    """Call ``callback`` with each new value of a declared parameter.

    check : raises a RestingAspectsError for an invalid value; its text is returned to the client
    """

    def post_set(parameters: Iterable[RosParameter]) -> None:
        for parameter in parameters:
            if parameter.name == name:
                callback(parameter.value)

    _reject_invalid(node, lambda other, value: check(value) if other == name else None)
    # ROS calls this after all parameters of the same request have been accepted.
    node.add_post_set_parameters_callback(post_set)


def unknown_parameters(nodes: Sequence[Node]) -> list[str]:
    """Return the names of parameters that were given at the start and that no node declares."""
    known = {name for node in nodes for name in node._parameters}  # noqa: SLF001
    given = {name for node in nodes for name in node._parameter_overrides}  # noqa: SLF001
    return sorted(name for name in given - known if not name.startswith('qos_overrides.'))


def _as_declared(parameter: Parameter, value: RosParameter) -> RosParameter:
    """Return the value with an integer converted to float if needed; ROS rejects 10 for 10.0."""
    if value.type_ == RosParameter.Type.INTEGER and isinstance(parameter.default, float):
        return RosParameter(value.name, value=float(value.value))
    return value


def _help_line(parameter: Parameter) -> str:
    allowed = parameter.allowed
    if parameter.bounds is not None:
        allowed = '{:g} to {:g}'.format(*parameter.bounds)
    when = 'can be set while it runs' if parameter.changeable else ''
    return '; '.join(filter(None, (parameter.description, allowed, when)))


def _reject_invalid(node: Node, check: Callable[[str, Any], object]) -> None:
    """Reject parameter values for which the check raises, with the text of its error."""

    def validate(parameters: Iterable[RosParameter]) -> SetParametersResult:
        try:
            for parameter in parameters:
                check(parameter.name, parameter.value)
        except RestingAspectsError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    node.add_on_set_parameters_callback(validate)


def _descriptor(parameter: Parameter) -> ParameterDescriptor:
    descriptor = ParameterDescriptor(
        description=parameter.description,
        additional_constraints=parameter.allowed,
        read_only=not parameter.changeable,
    )
    if parameter.bounds is not None:
        low, high = parameter.bounds
        if isinstance(parameter.default, int):
            descriptor.integer_range = [
                IntegerRange(from_value=int(low), to_value=int(high), step=1)
            ]
        else:
            descriptor.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
    return descriptor


# -- Life of the process --------------------------------------------------------------------------


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
    lines = [f'  {p.name:19} {_help_line(p)} (default {p.default!r})' for p in parameters]
    parser = argparse.ArgumentParser(
        usage='%(prog)s [--ros-args -p name:=value ... -r __ns:=/namespace]',
        description=(inspect.getdoc(factory) or '').partition('\n\nParameters\n')[0],
        epilog='\n'.join(['parameters:', *lines, '', 'Ctrl-C ends it.']),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.parse_args(list(takewhile(lambda word: word != '--ros-args', sys.argv[1:])))
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
            if (close := getattr(node, 'close', None)) is not None:
                close()  # ends what the node has started beside its ROS entities
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
