"""Run nodes in a process until it is told to stop."""

import inspect
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Sequence
from itertools import takewhile
from pathlib import Path

import rclpy
from rclpy.exceptions import ParameterException
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future

from resting_aspects_ros.core.errors import InvalidValueError, RestingAspectsError, one_line, shown
from resting_aspects_ros.ros.parameters import Parameter, help_text, unknown_parameters
from resting_aspects_ros.simulation.interruption import catch

# Its ports are the last that UDP has.
MAX_DOMAIN = 232


def spin_nodes(factories: Sequence[Callable[[], Node]], args: list[str] | None = None) -> int:
    """Make the nodes and spin them in one thread; returns the process's exit code.

    Ctrl-C, SIGTERM and a terminal that closes end it in order, with exit code 0: that is how a
    node is stopped. A node that cannot start (a parameter that is not allowed, no such folder)
    ends it with 2, one that cannot go on (its log is damaged meanwhile) with 1.
    """
    told = _signalled()
    try:
        check_domain()
        # rclpy's own handlers shut its context down at once, in the middle of a callback that
        # publishes; Python's would raise there, where rclpy's C++ makes a TypeError of it.
        rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    except (InvalidValueError, RuntimeError) as error:  # the latter is what rclpy raises
        return _refuse(error)
    except UnicodeEncodeError as error:
        return _refuse(not_utf8(error))
    return _spin(factories, told)


def run_node(factory: Callable[[], Node], parameters: Iterable[Parameter]) -> int:
    """The program of one node: what follows its name is for ROS, but for --help."""
    program = Path(sys.argv[0]).name
    words = list(takewhile(lambda word: word != '--ros-args', sys.argv[1:]))
    if '--help' in words or '-h' in words:
        does = inspect.getdoc(factory) or ''
        print(help_text(program, does.partition('\n\nParameters\n')[0], parameters))
        return 0
    if words:
        print(f'error: {words[0]!r} is not known, see {program} --help', file=sys.stderr)
        return 2
    return spin_nodes([factory])


def _signalled() -> Future:
    """Done as soon as the process is told to stop.

    Python's handlers do not run while rclpy waits, and to look for signals between short waits
    doubles the time of an answer. So a thread waits for what Python writes of each signal.
    """
    told = Future()
    read, write = os.pipe()
    os.set_blocking(write, False)
    signal.set_wakeup_fd(write)
    # A shell has SIGINT ignored by what it starts in the background, and nodes are ended with it.
    signal.signal(signal.SIGINT, _note)
    catch(_note)
    waits = threading.Thread(target=lambda: told.set_result(os.read(read, 1)), daemon=True)
    waits.start()
    return told


def _note(*_: object) -> None:
    """The thread that waits for signals does what there is to do."""


def _spin(factories: Sequence[Callable[[], Node]], told: Future) -> int:
    nodes: list[Node] = []
    executor = SingleThreadedExecutor()
    code = 2
    try:
        for factory in factories:
            nodes.append(factory())
            executor.add_node(nodes[-1])
        for name in unknown_parameters(nodes):
            nodes[0].get_logger().warning(f'parameter {name!r} is not known and not used')
        code = 1
        # A task ends a wait; spin_until_future_complete would keep a callback of each turn.
        told.add_done_callback(lambda _: executor.create_task(lambda: None))
        while not told.done():
            executor.spin_once()
    except (RestingAspectsError, ParameterException) as error:
        return _refuse(error, code)
    finally:
        for node in nodes:
            node.destroy_node()
        executor.shutdown()
        rclpy.try_shutdown()
    return 0


def check_domain() -> None:
    """Raise InvalidValueError for a domain with which Fast DDS would end the process."""
    domain = os.environ.get('ROS_DOMAIN_ID') or '0'
    if not (
        domain.isascii() and domain.isdigit() and len(domain) < 20 and int(domain) <= MAX_DOMAIN
    ):
        raise InvalidValueError(
            f'invalid ROS_DOMAIN_ID {shown(domain)}: expected an integer from 0 to {MAX_DOMAIN}'
        )


def not_utf8(error: UnicodeEncodeError) -> InvalidValueError:
    """What it means that ROS does not take an argument."""
    return InvalidValueError(f'{error.object!r} is given, allowed is UTF-8: ROS takes no other')


def _refuse(error: Exception, code: int = 2) -> int:
    print('error:', one_line(str(error), 2000), file=sys.stderr)
    return code
