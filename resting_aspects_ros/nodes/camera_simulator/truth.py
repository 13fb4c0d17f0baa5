"""What is true of the virtual parts: the part, its drops and its flips, from the topics."""

from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from resting_aspects_interfaces.msg import AspectDistribution, PartDescription
from resting_aspects_interfaces.msg import TransitionMatrix as TransitionMatrixMsg

from resting_aspects_ros.core.errors import RestingAspectsError
from resting_aspects_ros.core.feeding.controller_model import ControllerModel
from resting_aspects_ros.core.vision.known_part import KnownPart
from resting_aspects_ros.nodes.feeder_controller.evidence import PartEvidence
from resting_aspects_ros.nodes.feeder_controller.model import build_model, read_part
from resting_aspects_ros.nodes.feeder_controller.settings import PARAMETERS as OF_CONTROLLER
from resting_aspects_ros.nodes.feeder_controller.settings import settings_from
from resting_aspects_ros.ros.callbacks import subscribe
from resting_aspects_ros.ros.interface import ASPECT_DISTRIBUTIONS, LATCHED, PARTS, TRANSITIONS

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


class Truth:
    """The newest model of the virtual parts.

    model : ControllerModel or None
        Its moves and times are true. Until drops and flips arrive, they are the estimate with
        which feeder_controller begins, too.
    error : str
        Why there is no model.
    """

    def __init__(self, node: Node, values: dict[str, Any], changed: Callable[[], None]) -> None:
        self._settings = settings_from(
            {each.name: each.default for each in OF_CONTROLLER} | values
        )
        self._node, self._changed = node, changed
        self._evidence = PartEvidence(node, self._settings)
        self._complete = {'drops': False, 'flips': False}
        self.model: ControllerModel | None = None
        self.error = ''
        name = self._settings.part
        self._topic = node.resolve_topic_name(f'{PARTS}/{name}')
        subscribe(node, PartDescription, self._topic, self._on_part, LATCHED, raw=True)
        drops, flips = f'{ASPECT_DISTRIBUTIONS}/{name}', f'{TRANSITIONS}/{name}'
        subscribe(node, AspectDistribution, drops, self._on_drops, LATCHED)
        subscribe(node, TransitionMatrixMsg, flips, self._on_flips, LATCHED)

    @property
    def part(self) -> KnownPart:
        """The part; only if there is a model."""
        assert self._evidence.fed is not None
        return self._evidence.fed.known

    @property
    def has_evidence(self) -> bool:
        """Whether complete runs of drops and of flips are behind the model."""
        return self.model is not None and all(self.counts) and all(self._complete.values())

    @property
    def counts(self) -> tuple[int, int]:
        """Numbers of drops and of flips behind the model."""
        current = self._evidence.current
        return (current.drop_count, current.flip_count) if current is not None else (0, 0)

    @property
    def state(self) -> str:
        """What is missing."""
        if self.error:
            return self.error
        if self.model is None:
            return f'waiting for {self._topic}: start the suite, and check that it has this part'
        missing = ' and '.join(name for name, done in self._complete.items() if not done)
        return f'waiting for complete {missing} of {self._settings.part}' if missing else ''

    def _on_part(self, data: bytes) -> None:
        self.model, self.error = None, ''
        try:
            self._evidence.set_part(read_part(data, self._settings.part))
        except RestingAspectsError as error:
            self._evidence.forget_part()
            self.error = str(error)
            raise
        self._build()

    def _on_drops(self, message: AspectDistribution) -> None:
        self._complete['drops'] |= bool(message.complete and message.drops)
        if self._evidence.add_drops(message):
            self._build()

    def _on_flips(self, message: TransitionMatrixMsg) -> None:
        self._complete['flips'] |= bool(message.complete and any(message.actions))
        if self._evidence.add_flips(message):
            self._build()

    def _build(self) -> None:
        fed = self._evidence.fed
        if fed is None:
            return
        self.model = build_model(self._evidence.use(), fed.footprints, self._settings)
        self._changed()
