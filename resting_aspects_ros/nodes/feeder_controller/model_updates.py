"""Follows the part of a controller, its distribution and its transitions, and builds the model."""

import dataclasses
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from resting_aspects_interfaces.msg import (
    AspectDistribution,
    PartDescription,
    Status,
)
from resting_aspects_interfaces.msg import TransitionMatrix as TransitionMatrixMsg
from resting_aspects_interfaces.srv import GetDistribution

from resting_aspects_ros.api.forecast import footprints_of
from resting_aspects_ros.api.identify import known_part
from resting_aspects_ros.aspects.find import ASPECT_NUMBERING
from resting_aspects_ros.errors import InvalidValueError, RestingAspectsError, shown
from resting_aspects_ros.feeding.control import (
    DEFAULT_MIN_SCORE,
    ControllerModel,
)
from resting_aspects_ros.feeding.evidence import (
    Evidence,
    FedPart,
    PartEvidence,
    Settings,
    Simulated,
    build_model,
)
from resting_aspects_ros.feeding.footprint import MAX_REQUESTED, Tray
from resting_aspects_ros.feeding.grasps import Grasp, check_grasps, load_grasps
from resting_aspects_ros.feeding.steady_state import MAX_TIME, CycleTimes
from resting_aspects_ros.part.part import is_valid_name
from resting_aspects_ros.ros.callbacks import (
    guarded,
    start_task,
    steady_timer,
    subscribe,
    wait_for,
)
from resting_aspects_ros.ros.conversions import (
    check_description,
    part_from,
)
from resting_aspects_ros.ros.distribution_conversions import (
    check_numbering,
    check_transitions,
    distribution_from,
    transition_matrix_from,
)
from resting_aspects_ros.ros.file_worker import FileWorker
from resting_aspects_ros.ros.interface import (
    ASPECT_DISTRIBUTIONS,
    GET_DISTRIBUTION,
    LATCHED,
    PARTS,
    SERVICES,
    TRANSITIONS,
)
from resting_aspects_ros.ros.program import Parameter
from resting_aspects_ros.ros.requests import NotAvailableError, status_error
from resting_aspects_ros.simulation.conditions import DEFAULT_DROPS
from resting_aspects_ros.statistics.distribution import Distribution
from resting_aspects_ros.statistics.intervals import Interval
from resting_aspects_ros.statistics.transitions import TransitionMatrix
from resting_aspects_ros.vision.rolling import KnownPart

TIME = (0.0, MAX_TIME)
PARAMETERS = (
    Parameter('part', 'l_bracket', 'name of the part in the feeder'),
    Parameter('pickable_classes', [1], 'symmetry classes in which the robot can pick the part'),
    Parameter('clearance', 0.005, 'free distance that the gripper needs, m', (0.0, 1.0)),
    Parameter(
        'grasps', '', 'YAML file of the grasps of the part; empty: only the clearance matters'
    ),
    Parameter('tray', [0.2, 0.2], 'width and depth of the tray, m'),
    Parameter('robot_time', 1.2, 'time from one pick to the next, s', (0.001, MAX_TIME)),
    Parameter(
        'place_time', 0.0, 'part of it in which the feeder and the camera may work, s', TIME
    ),
    Parameter('vibrate_time', 0.6, 'duration of a flip, s', TIME),
    Parameter('settle_time', 0.6, 'time until the parts are at rest, s', TIME),
    Parameter('image_time', 0.2, 'time of an image and its evaluation, s', TIME),
    Parameter('supply_time', 0.0, 'time to supply a part, s', TIME),
    Parameter('spread_time', 0.0, 'duration of a spread, s; 0: the feeder has none', TIME),
    Parameter('best_number', 0, 'parts on the tray; 0: the best number', (0, MAX_REQUESTED)),
    Parameter('max_picks', 0, 'maximum number of picks after an image; 0: all', (0, 1000)),
    Parameter('max_supply', 0, 'maximum number of parts supplied at once; 0: all', (0, 1000)),
    Parameter(
        'min_score', DEFAULT_MIN_SCORE, 'minimum score of a part that is picked', (0.0, 1.0)
    ),
    Parameter('action', 'flip', 'action whose transitions are those of a flip'),
)


def settings_from(values: dict[str, Any]) -> Settings:
    """Return the settings from the parameters; raises InvalidValueError."""
    part, pickable = values['part'], sorted(set(values['pickable_classes'] or ()))
    if not is_valid_name(part):
        raise InvalidValueError(f'invalid part {shown(part)}: expected the name of a part')
    if not pickable or pickable[0] < 1:
        raise InvalidValueError(
            f'invalid pickable_classes {pickable}: expected numbers of symmetry classes, from 1'
        )
    sides = tuple(values['tray'] or ())
    if len(sides) != 2:
        raise InvalidValueError(f'invalid tray {list(sides)}: expected width and depth, m')
    if not values['action'].isidentifier():
        raise InvalidValueError(
            f'invalid action {shown(values["action"])}: expected the name of an action'
        )
    names = ('robot', 'place', 'vibrate', 'settle', 'image', 'supply')
    return Settings(
        part=part,
        pickable=tuple(pickable),
        action=values['action'],
        grasps=load_grasps(Path(values['grasps'])) if values['grasps'] else (),
        tray=Tray((sides[0], sides[1]), values['clearance']),
        times=CycleTimes(**{name: values[f'{name}_time'] for name in names}),
        spread=values['spread_time'] or None,
        best_number=values['best_number'] or None,
        max_picks=values['max_picks'] or None,
        max_supply=values['max_supply'] or None,
        min_score=values['min_score'],
    )


def pickable_ids(part: KnownPart, settings: Settings) -> tuple[int, ...]:
    """Return the ids of the aspects of the pickable classes.

    Raises InvalidValueError if the part does not have one of the classes, or if one has no grasp.
    """
    try:
        ids = part.aspects.chosen(None, settings.pickable, 'pickable')
    except InvalidValueError:
        raise InvalidValueError(
            f'invalid pickable_classes {list(settings.pickable)}: expected symmetry classes of '
            f'{settings.part}, 1 to {len(part.outlines)}'
        ) from None
    if settings.grasps:
        check_grasps(settings.grasps, part.placements, ids)
    return ids


def read_fed_part(data: bytes, name: str, grasps: tuple[Grasp, ...] = ()) -> FedPart:
    """Return the part in a serialized description on parts/<name>; runs in a FileWorker."""
    message = deserialize_message(data, PartDescription)
    check_description(message, name)
    # drop_simulator has logged the warnings of the part.
    part = dataclasses.replace(part_from(message), warnings=())
    known = known_part(part, {1: 1.0})  # the shares are not used: they are those of the drops
    check_grasps(grasps, known.placements, ())
    return FedPart(known, footprints_of(known.part, known.aspects), grasps)


def drops_from(message: AspectDistribution) -> Simulated[Distribution]:
    """Return the drops in a message; raises InvalidValueError."""
    if message.aspect_numbering != ASPECT_NUMBERING:
        raise InvalidValueError(
            f'invalid aspect_numbering {message.aspect_numbering}: expected {ASPECT_NUMBERING}'
        )
    return Simulated(distribution_from(message), *_run_from(message))


def flips_from(message: TransitionMatrixMsg, part: str) -> Simulated[TransitionMatrix]:
    """Return the flips in a message on transitions/<part>; raises InvalidValueError."""
    check_transitions(message, part)
    check_numbering(message)
    name = message.action.name or message.action.kind
    return Simulated(transition_matrix_from(message), *_run_from(message), name)


def _run_from(
    message: AspectDistribution | TransitionMatrixMsg,
) -> tuple[str, str, str, object, bool]:
    run = message.run
    return run.run_id, run.part, run.part_sha256, run.conditions, message.complete


# A part with very many triangles and aspects needs more time than a file, s.
MAX_SECONDS = 120.0
# Drops are requested if none have arrived for one to two periods after the part was read, s:
# latched ones arrive sooner.
REQUEST_PERIOD = 1.0
# Maximum time for the response, s. The same request again continues the same drops.
REQUEST_TIMEOUT = 60.0
UNKNOWN = Interval(math.nan, math.nan, math.nan)


class ModelUpdates:
    """The model of the decisions, from what is latched on the topics of the part.

    If no drops are known, it requests them.

    Parameters
    ----------
    changed : called when `current` has changed

    current : ControllerModel or None
        None until a part has been read and dropped, and if a parameter does not fit it.
    counts : tuple of int
        Numbers of drops and of flips behind the model; 0 without one.
    share : Interval
        The pickable share; NaN without a model.
    error : str
        Why there is no model; empty if there is one, or if it is not ready yet.
    """

    def __init__(self, node: Node, settings: Settings, changed: Callable[[], None]) -> None:
        self._node = node
        self._settings = settings
        self._changed = changed
        self._files = FileWorker(node, MAX_SECONDS)
        self._data = b''  # the newest description
        self._known = PartEvidence(settings.action, node.get_logger().warning)
        self._building = self._again = False
        self._requesting = self._lacked_drops = False
        self._problem = 'they are being requested'
        self.current: ControllerModel | None = None
        self.counts = 0, 0
        self.share = UNKNOWN
        self.error = ''
        name = settings.part
        self._topic = node.resolve_topic_name(f'{PARTS}/{name}')
        subscribe(node, PartDescription, self._topic, self._on_part, LATCHED, raw=True)
        drops, flips = f'{ASPECT_DISTRIBUTIONS}/{name}', f'{TRANSITIONS}/{name}'
        subscribe(node, AspectDistribution, drops, self._on_drops, LATCHED)
        subscribe(node, TransitionMatrixMsg, flips, self._on_flips, LATCHED)
        self._service = node.create_client(GetDistribution, GET_DISTRIBUTION, qos_profile=SERVICES)
        check = guarded(node, 'no drops are requested', self._request_missing_drops)
        steady_timer(node, REQUEST_PERIOD, check)

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
        name, known = self._settings.part, self._known
        if self.error:
            return self.error
        if known.lacks_drops:
            return f'no drops of {name} are known: {self._problem}'
        if known.fed is not None and known.current is None:
            return f'no drop of {name} has come to rest in an aspect'
        if self._data:
            return f'{name} is being read'
        if self._node.count_publishers(self._topic):
            return f'{self._topic} has not arrived yet'
        return (
            f'{self._topic} has no publisher: start the suite with "resting_aspects nodes", and '
            f'check that it has a part {name}'
        )

    @property
    def is_complete(self) -> bool:
        """Whether complete runs of drops and of flips are behind the model."""
        return all(self.counts) and self._known.is_complete and self._known.counts == self.counts

    @property
    def warnings(self) -> list[str]:
        """Messages that are not used, missing drops, and classes from which no flip helps."""
        found = self._known.ignored
        if self._known.lacks_drops:
            found.append(self.state)
        if self.current is not None and self.current.feeder.trapped.any():
            classes = ', '.join(str(k + 1) for k in np.flatnonzero(self.current.feeder.trapped))
            found.append(f'a flip brings no part of class {classes} into a pickable class')
        return found

    def _on_part(self, data: bytes) -> None:
        if data != self._data:
            self._data = bytes(data)
            start_task(self._node, 'no part was read', self._read)

    async def _read(self) -> None:
        """Read the newest description of the part, unless a newer one arrives."""
        data, name = self._data, self._settings.part
        try:
            fed = await self._files.run(read_fed_part, data, name, self._settings.grasps)
            if data != self._data:
                return
            self._known.set_part(fed, pickable_ids(fed.known, self._settings))
        except RestingAspectsError as error:
            if data == self._data:
                self._known.forget_part()
                self._fail(error)
            return
        if self.current is not None:
            self._set(None)  # until there is a model of the new version
            self._node.get_logger().warning(
                f'{name} has changed (part_sha256 {fed.version}): its classes may have changed'
            )
        self._build()

    def _request_missing_drops(self) -> None:
        """Request drops if none are known of the part, and none were a period ago."""
        lacked, self._lacked_drops = self._lacked_drops, self._known.lacks_drops
        if lacked and self._lacked_drops and not self._requesting:
            self._requesting = True
            start_task(self._node, 'no drops were requested', self._request_drops)

    async def _request_drops(self) -> None:
        """Request drops under the default conditions, which the service makes if necessary."""
        name = self._node.resolve_service_name(GET_DISTRIBUTION)
        answer = None
        try:
            if not self._service.service_is_ready():  # the request would be lost
                raise NotAvailableError(f'{name} is not served: start aspect_classifier')
            request = GetDistribution.Request(part=self._settings.part, drops=DEFAULT_DROPS)
            answer = self._service.call_async(request)
            if not await wait_for(self._node, answer, REQUEST_TIMEOUT):
                raise NotAvailableError(f'{name} has not answered for {REQUEST_TIMEOUT:g} s')
            response = answer.result()
            if response.status.code != Status.OK:
                raise status_error(response.status)
            self._on_drops(response.distribution)
        except RestingAspectsError as error:
            self._problem = str(error)
        finally:
            self._requesting = False
            if answer is not None:
                self._service.remove_pending_request(answer)

    def _on_drops(self, message: AspectDistribution) -> None:
        if message.drops:
            self._take('drops', lambda: self._known.add_drops(drops_from(message)))

    def _on_flips(self, message: TransitionMatrixMsg) -> None:
        if any(message.actions):
            name = self._settings.part
            self._take('flips', lambda: self._known.add_flips(flips_from(message, name)))

    def _take(self, kind: str, add: Callable[[], bool]) -> None:
        """Add evidence, and build the model if it differs enough."""
        try:
            is_new = add()
        except InvalidValueError as error:
            self._known.ignore(kind, error)
            return
        if is_new:
            self._build()

    def _build(self) -> None:
        """Build the model if drops are known, at most one at a time."""
        self._again = True
        if not self._building:
            self._building = True
            start_task(self._node, 'no model was built', self._build_all)

    async def _build_all(self) -> None:
        """Build the model until no newer evidence is left."""
        try:
            while self._again and (fed := self._known.fed) and self._known.current:
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
                        self._set(model, evidence)
        finally:
            self._building = False

    def _set(
        self, model: ControllerModel | None, evidence: Evidence | None = None, error: str = ''
    ) -> None:
        self.current, self.error = model, error
        self.counts, self.share = (0, 0), UNKNOWN
        if evidence is not None:
            self.counts, self.share = evidence.counts, self._known.share(evidence)
        self._changed()

    def _fail(self, error: RestingAspectsError) -> None:
        text = f'{self._settings.part} cannot be fed: {error}'
        self._node.get_logger().error(text)
        self._set(None, error=text)
