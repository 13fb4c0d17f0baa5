"""What a node says of itself on /diagnostics, once a second."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from resting_aspects_ros.nodes.callbacks import guarded, steady_timer
from resting_aspects_ros.nodes.interface import DIAGNOSTICS

PERIOD = 1.0
DEPTH = 10


@dataclass(frozen=True)
class Diagnosis:
    """How a node is: a line for a person, and values by name."""

    message: str
    values: Mapping[str, object]
    level: bytes = DiagnosticStatus.OK

    @classmethod
    def warning(cls, message: str, values: Mapping[str, object]) -> 'Diagnosis':
        """It works, and somebody should know."""
        return cls(message, values, DiagnosticStatus.WARN)

    @classmethod
    def error(cls, message: str, values: Mapping[str, object]) -> 'Diagnosis':
        """Something is lost, or will be."""
        return cls(message, values, DiagnosticStatus.ERROR)


class Meter:
    """Counts what a node does, and how much of it in a second."""

    def __init__(self) -> None:
        self.total = 0
        self._before = (0, time.monotonic())

    def add(self, number: int) -> None:
        """So many more."""
        self.total += number

    def rate(self) -> str:
        """Per second, since this was asked last."""
        (total, then), now = self._before, time.monotonic()
        self._before = (self.total, now)
        return f'{(self.total - total) / max(now - then, 1e-9):.0f}'


def publish_diagnostics(node: Node, diagnose: Callable[[], Diagnosis]) -> None:
    """Publish what ``diagnose`` gives under the node's name, from now on."""
    publisher = node.create_publisher(DiagnosticArray, DIAGNOSTICS, DEPTH)

    def publish() -> None:
        found = diagnose()
        status = DiagnosticStatus(
            level=found.level,
            name=node.get_fully_qualified_name().removeprefix('/'),
            message=found.message,
            values=[KeyValue(key=key, value=str(value)) for key, value in found.values.items()],
        )
        message = DiagnosticArray(status=[status])
        message.header.stamp = node.get_clock().now().to_msg()
        publisher.publish(message)

    steady_timer(node, PERIOD, guarded(node, 'diagnostics are not published', publish))
