"""What a node says of itself on /diagnostics, once a second."""

import dataclasses
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from resting_aspects_ros.ros.callbacks import advertise, guarded, steady_timer
from resting_aspects_ros.ros.interface import DIAGNOSTICS
from resting_aspects_ros.ros.liveliness import DuplicateNodeDetector

PERIOD = 1.0
DEPTH = 10
# As diagnostic_updater has it for what is no device.
HARDWARE_ID = 'none'


@dataclass(frozen=True)
class Diagnosis:
    """How a node is.

    state : what it does, in words; empty: nothing
    values : by name
    warnings : it works, and somebody should know
    errors : something is lost, or will be
    """

    state: str
    values: Mapping[str, object]
    warnings: Sequence[str] = ()
    errors: Sequence[str] = ()

    @property
    def level(self) -> bytes:
        """As in DiagnosticStatus."""
        if self.errors:
            return bytes(DiagnosticStatus.ERROR)
        return bytes(DiagnosticStatus.WARN if self.warnings else DiagnosticStatus.OK)

    @property
    def message(self) -> str:
        """A line for a person: what is wrong first."""
        words = [*self.errors, *self.warnings, *([self.state] if self.state else [])]
        return '; '.join(words) or 'idle'


class RateCounter:
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


def publish_diagnostics(
    node: Node, diagnose: Callable[[], Diagnosis], alone: DuplicateNodeDetector | None = None
) -> None:
    """Publish what ``diagnose`` gives under the node's name, from now on.

    alone : adds what is wrong if there are others of the node's kind
    """
    publisher = advertise(node, DiagnosticArray, DIAGNOSTICS, DEPTH)

    def publish() -> None:
        found = diagnose()
        if alone is not None:
            found = _with_others(found, alone)
        status = DiagnosticStatus(
            level=found.level,
            name=node.get_fully_qualified_name().removeprefix('/'),
            message=found.message,
            hardware_id=HARDWARE_ID,
            values=[KeyValue(key=key, value=str(value)) for key, value in found.values.items()],
        )
        message = DiagnosticArray(status=[status])
        message.header.stamp = node.get_clock().now().to_msg()
        publisher.publish(message)

    steady_timer(node, PERIOD, guarded(node, 'diagnostics are not published', publish))


def _with_others(found: Diagnosis, alone: DuplicateNodeDetector) -> Diagnosis:
    words = alone.look()
    if not words:
        return found
    if alone.harmless:
        return dataclasses.replace(found, warnings=[words, *found.warnings])
    return dataclasses.replace(found, errors=[words, *found.errors])
