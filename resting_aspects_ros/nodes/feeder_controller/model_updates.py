"""Follows the part of a controller, its distribution and its transitions, and builds the model."""

from collections.abc import Awaitable, Callable
from typing import Any

import numpy as np
from rclpy.node import Node
from resting_aspects_interfaces.msg import AspectDistribution, PartDescription
from resting_aspects_interfaces.msg import DropConditions as DropConditionsMsg
from resting_aspects_interfaces.msg import TransitionMatrix as TransitionMatrixMsg

from resting_aspects_ros.core.errors import RestingAspectsError
from resting_aspects_ros.core.feeding.controller_model import ControllerModel
from resting_aspects_ros.nodes.feeder_controller.evidence import PartEvidence
from resting_aspects_ros.nodes.feeder_controller.model import (
    Evidence,
    FedPart,
    build_model,
    read_fed_part,
)
from resting_aspects_ros.nodes.feeder_controller.settings import Settings
from resting_aspects_ros.ros.callbacks import guarded_task, subscribe
from resting_aspects_ros.ros.conversions import conditions_from
from resting_aspects_ros.ros.file_worker import FileWorker
from resting_aspects_ros.ros.interface import (
    ASPECT_DISTRIBUTIONS,
    DEFAULT_CONDITIONS,
    LATCHED,
    PARTS,
    TRANSITIONS,
)
from resting_aspects_ros.simulation.conditions import DropConditions

# A part with very many triangles and aspects needs more time than a file, s.
MAX_SECONDS = 120.0


class ModelUpdates:
    """The model of the decisions, from what is latched on the topics of the part.

    Parameters
    ----------
    changed : called when `current` has changed

    current : ControllerModel or None
        None until a part has been read, and if a parameter does not fit it.
    version : int
        Number of changes of `current`.
    error : str
        Why there is no model; empty if there is one, or if it is not ready yet.
    """

    def __init__(self, node: Node, settings: Settings, changed: Callable[[], None]) -> None:
        self._node = node
        self._settings = settings
        self._changed = changed
        self._files = FileWorker(node, MAX_SECONDS)
        self._data = b''  # the newest description
        self._conditions: DropConditions | None = None  # the default ones of the simulator
        self._known = PartEvidence(node, settings)
        self._evidence: Evidence | None = None  # of the model
        self._building = self._again = False
        self.current: ControllerModel | None = None
        self.version = 0
        self.error = ''
        name = settings.part
        self._topic = node.resolve_topic_name(f'{PARTS}/{name}')
        subscribe(node, PartDescription, self._topic, self._on_part, LATCHED, raw=True)
        subscribe(node, DropConditionsMsg, DEFAULT_CONDITIONS, self._on_conditions, LATCHED)
        drops, flips = f'{ASPECT_DISTRIBUTIONS}/{name}', f'{TRANSITIONS}/{name}'
        subscribe(node, AspectDistribution, drops, self._on_drops, LATCHED)
        subscribe(node, TransitionMatrixMsg, flips, self._on_flips, LATCHED)

    def stop(self) -> None:
        """End the process that builds models."""
        self._files.stop()

    @property
    def part(self) -> FedPart:
        """The part; only if there is a model."""
        assert self._known.fed is not None
        return self._known.fed

    @property
    def state(self) -> str:
        """Why there is no model."""
        if self.error:
            return self.error
        if self._data:
            return f'{self._settings.part} is being read'
        if self._node.count_publishers(self._topic):
            return f'{self._topic} has not arrived yet'
        return (
            f'{self._topic} has no publisher: start the suite with "resting_aspects nodes", and '
            f'check that it has a part {self._settings.part}'
        )

    @property
    def best_number(self) -> int:
        """Number of parts up to which the tray is filled."""
        return self.current.best_number if self.current is not None else 0

    @property
    def counts(self) -> tuple[int, int]:
        """Numbers of drops and of flips behind the model; 0 for an estimate, and without one."""
        if self.current is None or self._evidence is None:
            return 0, 0
        return self._evidence.drop_count, self._evidence.flip_count

    @property
    def is_complete(self) -> bool:
        """Whether complete runs of drops and of flips are behind the model."""
        return all(self.counts) and self._known.is_complete and self._known.counts == self.counts

    @property
    def sentence(self) -> str:
        """The parts per minute of the model; empty without one."""
        if self.current is None or self._evidence is None:
            return ''
        drops, flips = self.counts
        return (
            f'{self._known.share(self._evidence).probability:.1%} of {self._settings.part} can be '
            f'picked ({f"{drops} drops" if drops else "an estimate, no drops"}, {flips} flips): '
            f'{60 * self.current.values.rate:.1f} parts per minute with '
            f'{self.current.best_number} parts on the tray'
        )

    @property
    def evidence_fields(self) -> dict[str, Any]:
        """The pickable share and the numbers of drops and flips behind the model."""
        if self.current is None or self._evidence is None:
            return {}
        drops, flips = self.counts
        return {'share': self._known.share(self._evidence), 'drops': drops, 'actions': flips}

    @property
    def values(self) -> dict[str, object]:
        """Values for the diagnostics."""
        if self.current is None or self._evidence is None:
            return {}
        return {
            'drops known': self._evidence.drop_count,
            'flips known': self._evidence.flip_count,
            'pickable share': f'{self._known.share(self._evidence).probability:.4f}',
            'best number of parts': self.current.best_number,
            'parts per minute': f'{60 * self.current.values.rate:.2f}',
        }

    @property
    def warnings(self) -> list[str]:
        """Messages that are not used, and classes from which the flip does not help."""
        found = self._known.ignored
        if self.current is not None and self.current.trapped.any():
            classes = ', '.join(str(k + 1) for k in np.flatnonzero(self.current.trapped))
            found.append(f'a flip brings no part of class {classes} into a pickable class')
        return found

    def _on_part(self, data: bytes) -> None:
        if data != self._data:
            self._data = bytes(data)
            self._execute(self._read)

    def _on_conditions(self, message: DropConditionsMsg) -> None:
        """Estimate again for new default conditions."""
        conditions = conditions_from(message)
        if conditions != self._conditions:
            self._conditions = conditions
            if self._data:
                self._execute(self._read)

    async def _read(self) -> None:
        """Read the newest description of the part, unless a newer one arrives."""
        newest = self._data, self._conditions
        given = self._data, self._settings.part, self._settings.grasps, self._conditions
        try:
            fed = await self._files.run(read_fed_part, *given)
            if newest != (self._data, self._conditions):
                return
            known = self._known.fed
            if known and (fed.version, fed.conditions) == (known.version, known.conditions):
                return
            self._known.set_part(fed)
        except RestingAspectsError as error:
            if newest == (self._data, self._conditions):
                self._known.forget_part()
                self._fail(error)
            return
        if known is not None and known.version != fed.version:
            self.current = None  # until there is a model of the new version
            self.version += 1
            self._changed()
            self._node.get_logger().warning(
                f'{self._settings.part} has changed (part_sha256 {fed.version}): '
                'its classes may have changed'
            )
        self._build()

    def _on_drops(self, message: AspectDistribution) -> None:
        if self._known.add_drops(message):
            self._build()

    def _on_flips(self, message: TransitionMatrixMsg) -> None:
        if self._known.add_flips(message):
            self._build()

    def _build(self) -> None:
        """Build the model, at most one at a time."""
        self._again = self._building
        if not self._building:
            self._building = True
            self._execute(self._build_all)

    async def _build_all(self) -> None:
        """Build the model until no newer evidence is left."""
        try:
            self._again = True
            while self._again and (fed := self._known.fed) is not None:
                self._again = False
                evidence = self._known.use()
                try:
                    model = await self._files.run(
                        build_model, evidence, fed.footprints, self._settings
                    )
                except RestingAspectsError as error:
                    if fed is self._known.fed:
                        self._fail(error)
                else:
                    if fed is self._known.fed:
                        self._use(model, evidence)
        finally:
            self._building = False

    def _use(self, model: ControllerModel, evidence: Evidence) -> None:
        self.current, self._evidence, self.error = model, evidence, ''
        self.version += 1
        self._changed()

    def _fail(self, error: RestingAspectsError) -> None:
        self.current = self._evidence = None
        self.error = f'{self._settings.part} cannot be fed: {error}'
        self.version += 1
        self._node.get_logger().error(self.error)
        self._changed()

    def _execute(self, task: Callable[..., Awaitable[None]], *arguments: Any) -> None:
        executor = self._node.executor
        assert executor is not None  # it calls the callbacks
        executor.create_task(guarded_task(self._node, 'no model was built', task), *arguments)
