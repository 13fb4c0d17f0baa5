"""The model of a controller's decisions, from parameters, a part, its drops and its flips."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from rclpy.serialization import deserialize_message
from resting_aspects_interfaces.msg import AspectDistribution, PartDescription
from resting_aspects_interfaces.msg import TransitionMatrix as TransitionMatrixMsg

from resting_aspects_ros.api.forecast import footprints_of, pickable_aspects
from resting_aspects_ros.api.grasps import check_grasps
from resting_aspects_ros.api.identify import known_part
from resting_aspects_ros.arrays import Counts
from resting_aspects_ros.aspects.find import ASPECT_NUMBERING
from resting_aspects_ros.errors import InvalidValueError, shown
from resting_aspects_ros.feeding.control import ControllerModel, controller_model
from resting_aspects_ros.feeding.footprint import Footprint
from resting_aspects_ros.feeding.forecast import FeederModel
from resting_aspects_ros.nodes.feeder_controller.settings import Settings
from resting_aspects_ros.ros.conversions import check_description, part_from
from resting_aspects_ros.ros.distribution_conversions import distribution_from
from resting_aspects_ros.ros.transition_conversions import (
    check_numbering,
    check_transitions,
    transition_matrix_from,
)
from resting_aspects_ros.statistics.distribution import Distribution
from resting_aspects_ros.statistics.transitions import TransitionMatrix
from resting_aspects_ros.vision.grasp import Grasp
from resting_aspects_ros.vision.known_part import KnownPart

# If there are fewer flips of a class, the missing ones have the result of a drop.
MIN_FLIPS = 20


@dataclass(frozen=True, eq=False)
class FedPart:
    """The part in a feeder, with the footprints of its classes, and the grasps of the robot."""

    known: KnownPart
    footprints: tuple[Footprint, ...]
    grasps: tuple[Grasp, ...] = ()

    @property
    def version(self) -> str:
        """Hash of the part."""
        return self.known.part.part_sha256


@dataclass(frozen=True, eq=False)
class Evidence:
    """What is known of the classes of a part.

    drops : Distribution
        Over the aspects of the part; at least one drop came to rest in an aspect.
    flips : TransitionMatrix or None
    """

    drops: Distribution
    flips: TransitionMatrix | None = None

    @property
    def drop_count(self) -> int:
        """Number of drops that came to rest in an aspect."""
        return int(self.drops.counts.sum())

    @property
    def flip_count(self) -> int:
        """Number of flips."""
        return int(self.flips.counts.sum()) if self.flips is not None else 0


def read_fed_part(data: bytes, name: str, grasps: tuple[Grasp, ...] = ()) -> FedPart:
    """Return the part in a serialized description on parts/<name>; runs in a FileWorker."""
    message = deserialize_message(data, PartDescription)
    check_description(message, name)
    part = part_from(message)
    known = known_part(part, {1: 1.0})  # the shares are not used: they are those of the drops
    check_grasps(grasps, known.placements, ())
    classes = known.aspects.classes()
    footprints = footprints_of(known.part, known.aspects, classes, grasps)
    return FedPart(known, footprints, grasps)


def build_model(
    evidence: Evidence, footprints: Sequence[Footprint], settings: Settings
) -> ControllerModel:
    """Return the model of the decisions; takes about a second, so it runs in a FileWorker.

    Raises InvalidValueError if a parameter does not fit the part.
    """
    drops = evidence.drops.by_class().counts
    flips = np.zeros((len(drops), len(drops)), dtype=np.int64)
    if evidence.flips is not None:
        flips = evidence.flips.by_class().counts
    feeder = FeederModel(
        drops,
        _filled(flips, drops),
        np.isin(np.arange(1, len(drops) + 1), settings.pickable),
        footprints,
        settings.tray,
        settings.times,
        settings.max_picks,
    )
    model = controller_model(
        feeder,
        spread=settings.spread,
        max_supply=settings.max_supply,
        min_score=settings.min_score,
        number=settings.best_number,
    )
    _ = model.values  # found here, and not in the process of the node
    return model


def ids_of_classes(part: KnownPart, settings: Settings) -> tuple[int, ...]:
    """Return the ids of the aspects of the pickable classes.

    Raises InvalidValueError if the part does not have one of the classes, or if one has no grasp.
    """
    try:
        ids = pickable_aspects(part.aspects, None, settings.pickable)
    except InvalidValueError:
        raise InvalidValueError(
            f'invalid pickable_classes {list(settings.pickable)}: expected symmetry classes of '
            f'{settings.part}, 1 to {len(part.outlines)}'
        ) from None
    if settings.grasps:
        check_grasps(settings.grasps, part.placements, ids)
    return ids


def drops_in(message: AspectDistribution, part: KnownPart) -> Distribution:
    """Return the distribution in a message; raises InvalidValueError if it does not fit."""
    found = distribution_from(message)
    if message.aspect_numbering != ASPECT_NUMBERING:
        raise InvalidValueError(
            f'invalid aspect_numbering {message.aspect_numbering}: expected {ASPECT_NUMBERING}'
        )
    _check_version(message.run.part, message.run.part_sha256, part)
    if not part.aspects.matches(found.aspects):
        raise InvalidValueError(
            f'invalid distribution of run {shown(message.run.run_id)}: expected the aspects of '
            f'{part.part.name}'
        )
    return found


def flips_in(message: TransitionMatrixMsg, part: KnownPart) -> TransitionMatrix:
    """Return the matrix in a message; raises InvalidValueError if it does not fit."""
    check_transitions(message, part.part.name)
    check_numbering(message)
    _check_version(message.run.part, message.run.part_sha256, part)
    found = transition_matrix_from(message)
    if not part.aspects.matches(found.aspects):
        raise InvalidValueError(
            f'invalid transition matrix of run {shown(message.run.run_id)}: expected the aspects '
            f'of {part.part.name}'
        )
    return found


def _check_version(name: str, part_sha256: str, part: KnownPart) -> None:
    if (name, part_sha256) != (part.part.name, part.part.part_sha256):
        raise InvalidValueError(
            f'invalid part {shown(name)} (part_sha256 {shown(part_sha256)}): expected '
            f'{part.part.name} (part_sha256 {part.part.part_sha256})'
        )


def _filled(flips: Counts, drops: Counts) -> Counts:
    """Return flips (k, m), to which the missing ones are added with the shares of drops (k,).

    The rows with missing flips are multiplied by the number of drops, so that counts remain exact.
    """
    missing = np.maximum(MIN_FLIPS - flips.sum(axis=1, keepdims=True), 0)
    filled = flips * drops.sum()
    filled[:, : len(drops)] += missing * drops
    return np.where(missing > 0, filled, flips)
