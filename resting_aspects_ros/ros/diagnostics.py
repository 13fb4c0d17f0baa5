"""The status of a node, published on /diagnostics every two seconds, and its texts."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from resting_aspects_ros.ros.callbacks import advertise, guarded, steady_timer
from resting_aspects_ros.ros.discovery import DuplicateNodeDetector
from resting_aspects_ros.ros.interface import DIAGNOSTICS
from resting_aspects_ros.simulation.job import RunDescription

# Each callback of a timer costs rclpy 3 ms: 0.3 % of a core at 1 Hz.
PERIOD = 2.0
DEPTH = 10
# The value that diagnostic_updater uses without a device.
HARDWARE_ID = 'none'
# Maximum number of entries of a mapping that diagnostics show.
MAX_LISTED = 10


@dataclass(frozen=True)
class Diagnosis:
    """The status of a node.

    state : text describing the current work; empty if the node is idle
    values : further values by name
    warnings : problems that do not stop the node from working
    errors : problems through which data are lost
    """

    state: str
    values: Mapping[str, object]
    warnings: Sequence[str] = ()
    errors: Sequence[str] = ()


class RateCounter:
    """A counter of events, and of their rate per second."""

    def __init__(self) -> None:
        self.total = 0
        self._previous = (0, time.monotonic())

    def add(self, number: int) -> None:
        """Count a number of further events."""
        self.total += number

    def rate(self) -> str:
        """Return the events per second since the previous call."""
        (total, then), now = self._previous, time.monotonic()
        self._previous = (self.total, now)
        return f'{(self.total - total) / max(now - then, 1e-9):.0f}'


def publish_diagnostics(
    node: Node, diagnose: Callable[[], Diagnosis], duplicates: DuplicateNodeDetector | None = None
) -> None:
    """Publish the result of ``diagnose`` every two seconds from now on, under the node's name.

    duplicates : detector of other nodes of the same kind, which the status then reports
    """
    publisher = advertise(node, DiagnosticArray, DIAGNOSTICS, DEPTH)

    def publish() -> None:
        found = diagnose()
        if duplicates is not None and (problem := duplicates.check()):
            if duplicates.harmless_reason:
                found = replace(found, warnings=[problem, *found.warnings])
            else:
                found = replace(found, errors=[problem, *found.errors])
        level = DiagnosticStatus.WARN if found.warnings else DiagnosticStatus.OK
        parts = [*found.errors, *found.warnings, *([found.state] if found.state else [])]
        status = DiagnosticStatus(
            level=DiagnosticStatus.ERROR if found.errors else level,
            name=node.get_fully_qualified_name().removeprefix('/'),
            message='; '.join(parts) or 'idle',
            hardware_id=HARDWARE_ID,
            values=[KeyValue(key=key, value=str(value)) for key, value in found.values.items()],
        )
        message = DiagnosticArray(status=[status])
        message.header.stamp = node.get_clock().now().to_msg()
        publisher.publish(message)

    steady_timer(node, PERIOD, guarded(node, 'diagnostics are not published', publish))


# -- texts ----------------------------------------------------------------------------------------


def count_text(number: int, one: str, more: str) -> str:
    """Return a number with its noun: '1 run', '2 runs'."""
    return f'{number} {one if number == 1 else more}'


def progress_text(run: RunDescription, drops: int, unit: str = 'drops') -> str:
    """Return the progress of a run, such as '3000 of 20000 drops'."""
    bound = 'at most ' if run.precision else ''
    return f'{drops} of {bound}{count_text(run.drops, unit[:-1], unit)}'


def active_runs_text(runs: Sequence[tuple[RunDescription, int]]) -> str:
    """Return the progress of the first run and the number of others; empty without a run."""
    if not runs:
        return ''
    run, drops = runs[0]
    more = f', and {count_text(len(runs) - 1, "more run", "more runs")}' if runs[1:] else ''
    return f'{run.part}: {progress_text(run, drops)}{more}'


def run_values(runs: Sequence[tuple[RunDescription, int]]) -> dict[str, object]:
    """Return the number of active runs and the progress of each, for diagnostics."""
    each = {
        f'run {k}': f'{run.part}: {progress_text(run, drops)}, run {run.run_id}'
        for k, (run, drops) in enumerate(runs, 1)
    }
    return {'active runs': len(runs), **truncated(each)}


def truncated(values: Mapping[str, str]) -> dict[str, str]:
    """Return the first MAX_LISTED entries, and the number of entries left out."""
    shown = dict(list(values.items())[:MAX_LISTED])
    if len(values) > MAX_LISTED:
        shown['not shown'] = f'{len(values) - MAX_LISTED} more'
    return shown
