"""What is true of the virtual parts: the part, its drops and its flips, from the topics."""

from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from resting_aspects_interfaces.msg import FeederAdvice

from resting_aspects_ros.nodes.feeder_controller.model_updates import ModelUpdates
from resting_aspects_ros.nodes.feeder_controller.settings import PARAMETERS as OF_CONTROLLER
from resting_aspects_ros.nodes.feeder_controller.settings import settings_from

# Parameters of feeder_controller that this node has, too.
SHARED = (
    'part',
    'tray',
    'robot_time',
    'place_time',
    'vibrate_time',
    'settle_time',
    'image_time',
    'supply_time',
    'spread_time',
    'action',
)
CELL_PARAMETERS = tuple(each for each in OF_CONTROLLER if each.name in SHARED)


class Truth(ModelUpdates):
    """The model whose moves and times are true of the virtual parts.

    Parameters
    ----------
    values : dict
        Parameters of the node by name. With `evidence`, the virtual feeder begins when complete
        runs of drops and flips are known, and waits until the controller knows the same.
    changed : called when `current` has changed
    """

    def __init__(self, node: Node, values: dict[str, Any], changed: Callable[[], None]) -> None:
        given = {each.name: each.default for each in OF_CONTROLLER} | values
        super().__init__(node, settings_from(given), changed)
        self._needs_evidence = values['evidence']
        self._has_begun = False

    def is_ready(self, advice: FeederAdvice | None) -> bool:
        """Return whether the virtual feeder can run with the newest advice of the controller."""
        if self.current is None or not self._needs_evidence:
            return self.current is not None
        self._has_begun = self._has_begun or self.is_complete
        is_known = advice is not None and (advice.drops, advice.actions) == self.counts
        return self._has_begun and is_known

    @property
    def state(self) -> str:
        """What is missing, in words."""
        if self.current is None:
            return super().state
        if self._needs_evidence and not self._has_begun:
            return f'waiting for complete runs of drops and flips of {self.part.known.part.name}'
        return 'begins'
