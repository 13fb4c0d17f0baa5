"""Run nodes in a process until it is told to stop."""

import signal
import sys
from collections.abc import Callable, Iterable, Sequence
from itertools import takewhile
from pathlib import Path

import rclpy
from rclpy.exceptions import InvalidHandle, ParameterException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node

from resting_aspects_ros.core.errors import RestingAspectsError
from resting_aspects_ros.nodes.parameters import Parameter, help_text, unknown_parameters


def spin_nodes(factories: Sequence[Callable[[], Node]], args: list[str] | None = None) -> int:
    """Make the nodes and spin them in one thread; returns the process's exit code.

    Ctrl-C and SIGTERM end it in order, with exit code 0: that is how a node is stopped. A node
    that cannot start (a parameter that is not allowed, no such folder) ends it with 2.
    """
    told: list[int] = []  # to stop, before rclpy listens

    def note(number: int, _: object) -> None:
        told.append(number)

    for number in (signal.SIGINT, signal.SIGTERM):
        # rclpy shuts its context down between two callbacks, and then calls the handler that was
        # there before. Python's own would raise in the middle of one, where rclpy's C++ makes a
        # TypeError or a RuntimeError of it.
        signal.signal(number, note)
    try:
        rclpy.init(args=args)
    except RuntimeError as error:  # all that rclpy raises for arguments
        return _refuse(error)
    if told:
        rclpy.try_shutdown()
        return 0
    return _spin(factories)


def run_node(factory: Callable[[], Node], parameters: Iterable[Parameter]) -> int:
    """The program of one node: what follows its name is for ROS, but for --help."""
    program = Path(sys.argv[0]).name
    words = list(takewhile(lambda word: word != '--ros-args', sys.argv[1:]))
    if '--help' in words or '-h' in words:
        print(help_text(program, parameters))
        return 0
    if words:
        print(f'error: {words[0]!r} is not known, see {program} --help', file=sys.stderr)
        return 2
    return spin_nodes([factory])


def _spin(factories: Sequence[Callable[[], Node]]) -> int:
    nodes: list[Node] = []
    executor = SingleThreadedExecutor()
    try:
        for factory in factories:
            node = factory()
            nodes.append(node)
            executor.add_node(node)
        for name in unknown_parameters(nodes):
            nodes[0].get_logger().warning(f'parameter {name!r} is not known and not used')
        executor.spin()
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except (RestingAspectsError, ParameterException) as error:
        return _refuse(error)
    except (InvalidHandle, rclpy_implementation.RCLError):
        if rclpy.ok():
            raise
        # A callback wanted to publish after the context was shut down.
    finally:
        for node in nodes:
            node.destroy_node()
        executor.shutdown()
        rclpy.try_shutdown()
    return 0


def _refuse(error: Exception) -> int:
    print('error:', ' '.join(str(error).split()), file=sys.stderr)
    return 2
