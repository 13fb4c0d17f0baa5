"""How the runs are that a consumer of resting_poses follows, for its diagnostics."""

from rclpy.node import Node

from resting_aspects_ros.nodes.run_tracking.tracker import RunTracker
from resting_aspects_ros.ros.formatting import active_runs_text, count_text, run_values
from resting_aspects_ros.ros.interface import DROP_SIMULATOR


class RunHealth:
    """What is wrong with the runs of a tracker, and how far they are."""

    def __init__(self, node: Node, tracker: RunTracker) -> None:
        self._node = node
        self._tracker = tracker
        self._told = False

    @property
    def state(self) -> str:
        """What is dropped, in words; empty if nothing is."""
        return active_runs_text(self._tracker.under_way())

    def values(self) -> dict[str, object]:
        """For the diagnostics."""
        return {
            'drop_simulators': self._tracker.simulators.count,
            'missing drops': self._tracker.missing(),
            'runs with lost drops': self._tracker.lost,
            **run_values(self._tracker.under_way()),
        }

    def warnings(self) -> list[str]:
        """What is not well; to be asked often. A simulator that leaves a run is logged once."""
        found = []
        gone = self._simulator_is_gone()
        if gone:
            found.append(f'no {DROP_SIMULATOR}')
        if missing := self._tracker.missing():
            words = count_text(missing, 'drop is missing', 'drops are missing')
            found.append(words if gone else f'{words} and asked for again')
        if self._tracker.problem:
            found.append(self._tracker.problem)
        if gone and self.state and not self._told:
            self._node.get_logger().warning(f'no {DROP_SIMULATOR} any more: {self.state}')
        self._told = gone and (self._told or bool(self.state))
        return found

    def _simulator_is_gone(self) -> bool:
        """Whether there has been one, and there is nobody now who publishes poses.

        Where there never was one they come from elsewhere, such as a log that is replayed.
        """
        alive = self._tracker.simulators.count or self._tracker.replayers.count
        return self._tracker.simulators.was_seen and not alive
