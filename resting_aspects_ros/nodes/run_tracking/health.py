"""Diagnostics of the runs that a consumer of resting_poses tracks."""

from rclpy.node import Node

from resting_aspects_ros.nodes.run_tracking.tracker import RunTracker
from resting_aspects_ros.ros.formatting import active_runs_text, count_text, run_values
from resting_aspects_ros.ros.interface import DROP_SIMULATOR


class RunHealth:
    """Progress and problems of the runs of a tracker, for diagnostics."""

    def __init__(self, node: Node, tracker: RunTracker) -> None:
        self._node = node
        self._tracker = tracker
        self._logged = False

    @property
    def state(self) -> str:
        """The progress of the active runs as text; empty if there are none."""
        return active_runs_text(self._tracker.active_runs())

    def values(self) -> dict[str, object]:
        """Return the values for the diagnostics."""
        return {
            'drop_simulators': self._tracker.simulators.count,
            'missing drops': self._tracker.missing(),
            'runs with lost drops': self._tracker.lost,
            **run_values(self._tracker.active_runs()),
        }

    def warnings(self) -> list[str]:
        """Return the current problems; must be called regularly.

        It also logs once if the simulator disappears during a run.
        """
        problems = []
        gone = self._simulator_is_gone()
        if gone:
            problems.append(f'no {DROP_SIMULATOR}')
        if missing := self._tracker.missing():
            text = count_text(missing, 'drop is missing', 'drops are missing')
            problems.append(text if gone else f'{text}, requested again')
        if self._tracker.problem:
            problems.append(self._tracker.problem)
        if gone and self.state and not self._logged:
            self._node.get_logger().warning(f'{DROP_SIMULATOR} disappeared: {self.state}')
        self._logged = gone and (self._logged or bool(self.state))
        return problems

    def _simulator_is_gone(self) -> bool:
        """Return whether there was a simulator before, and now nothing publishes poses.

        If there never was one, the poses have another source, such as a log that is replayed.
        """
        alive = self._tracker.simulators.count or self._tracker.replayers.count
        return self._tracker.simulators.was_seen and not alive
