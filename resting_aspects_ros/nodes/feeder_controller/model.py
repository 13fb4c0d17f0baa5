"""The model of a controller's decisions, from parameters, a part, its drops and its flips.

It starts with the estimate of the part, and is replaced as drops and flips arrive.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from rclpy.serialization import deserialize_message
from resting_aspects_interfaces.msg import AspectDistribution, PartDescription
from resting_aspects_interfaces.msg import TransitionMatrix as TransitionMatrixMsg

from resting_aspects_ros.api.forecast_setup import footprints_of, pickable_aspects
from resting_aspects_ros.api.grasps import check_grasps
from resting_aspects_ros.api.identify import known_part, prediction
from resting_aspects_ros.core.aspects.aspect import ASPECT_NUMBERING
from resting_aspects_ros.core.errors import InvalidValueError, shown
from resting_aspects_ros.core.estimators.estimate import share_interval
from resting_aspects_ros.core.estimators.resting_shape import RestingShape
from resting_aspects_ros.core.feeding.controller_model import (
    ControllerModel,
    controller_model,
    feeder_of_shares,
)
from resting_aspects_ros.core.feeding.footprint import Footprint
from resting_aspects_ros.core.feeding.model import FeederModel
from resting_aspects_ros.core.reorientation.transition_matrix import TransitionMatrix
from resting_aspects_ros.core.statistics.distribution import Distribution
from resting_aspects_ros.core.statistics.intervals import Array, Counts, Interval
from resting_aspects_ros.core.vision.grasp import Grasp
from resting_aspects_ros.core.vision.known_part import KnownPart
from resting_aspects_ros.nodes.feeder_controller.settings import Settings
from resting_aspects_ros.ros.conversions import check_description, part_from
from resting_aspects_ros.ros.distribution_conversions import distribution_from
from resting_aspects_ros.ros.transition_conversions import (
    check_numbering,
    check_transitions,
    transition_matrix_from,
)
from resting_aspects_ros.simulation.conditions import DropConditions

# If there are fewer drops, or flips of a class, the estimate counts as the missing ones. An
# estimate that states its weight counts as that many drops, up to the maximum.
MIN_DROPS, MIN_FLIPS, MAX_WEIGHT = 100, 20, 1000


@dataclass(frozen=True, eq=False)
class FedPart:
    """The part in a feeder, with the footprints of its classes, and the grasps of the robot.

    weight : float
        That of the estimate in ``known.shares``, drops; NaN if it is not known.
    conditions : DropConditions or None
        Those of the estimate; None: the default ones.
    """

    known: KnownPart
    footprints: tuple[Footprint, ...]
    grasps: tuple[Grasp, ...] = ()
    weight: float = math.nan
    conditions: DropConditions | None = None

    @property
    def version(self) -> str:
        """Hash of the part."""
        return self.known.part.part_sha256


@dataclass(frozen=True, eq=False)
class Evidence:
    """What is known of the classes of a part.

    shares : (k,) float
        The estimate.
    drops : Distribution or None
        Over the aspects of the part.
    flips : TransitionMatrix or None
    weight : float
        That of the estimate, drops; NaN if it is not known.
    """

    shares: Array
    drops: Distribution | None = None
    flips: TransitionMatrix | None = None
    weight: float = math.nan

    @property
    def min_drops(self) -> int:
        """Number of drops below which the estimate counts as the missing ones."""
        return MIN_DROPS if math.isnan(self.weight) else round(min(self.weight, MAX_WEIGHT))

    @property
    def drop_count(self) -> int:
        """Number of drops that came to rest in an aspect."""
        return int(self.drops.counts.sum()) if self.drops is not None else 0

    @property
    def flip_count(self) -> int:
        """Number of flips."""
        return int(self.flips.counts.sum()) if self.flips is not None else 0


def read_fed_part(
    data: bytes,
    name: str,
    grasps: tuple[Grasp, ...] = (),
    conditions: DropConditions | None = None,
) -> FedPart:
    """Return the part in a serialized description on parts/<name>; runs in a FileWorker.

    The estimate is that for ``conditions``, by default those of rubber_mat.
    """
    message = deserialize_message(data, PartDescription)
    check_description(message, name)
    part = part_from(message)
    found = prediction(RestingShape(part), conditions)
    known = known_part(part, found.probabilities)
    check_grasps(grasps, known.placements, ())
    classes = known.aspects.classes()
    footprints = footprints_of(known.part, known.aspects, classes, grasps)
    return FedPart(known, footprints, grasps, found.weight, conditions)


def build_model(
    evidence: Evidence, footprints: Sequence[Footprint], settings: Settings
) -> ControllerModel:
    """Return the model of the decisions; takes about a second, so it runs in a FileWorker.

    Raises InvalidValueError if a parameter does not fit the part.
    """
    count = len(evidence.shares)
    pickable = np.isin(np.arange(1, count + 1), settings.pickable)
    common = pickable, footprints, settings.tray, settings.times, settings.max_picks
    feeder = feeder_of_shares(evidence.shares, *common)
    if evidence.drop_count or evidence.flip_count:
        drop = _filled(_drops_by_class(evidence.drops, count), evidence.shares, evidence.min_drops)
        flips = np.zeros((count, count), dtype=np.int64)
        if evidence.flips is not None:
            flips = evidence.flips.by_class().counts
        rows = [_filled(row, drop / drop.sum(), MIN_FLIPS) for row in flips]
        feeder = FeederModel(drop, np.array(rows), *common)
    model = controller_model(
        feeder,
        spread=settings.spread,
        max_supply=settings.max_supply,
        min_score=settings.min_score,
        number=settings.best_number,
    )
    _ = model.values  # found here, and not in the process of the node
    return model


def pickable_share(
    evidence: Evidence, aspects: Sequence[int], pickable: Sequence[int]
) -> Interval:
    """Return the probability that a supplied part is in a pickable class.

    aspects : ids of the aspects of the pickable classes
    """
    if evidence.drops is not None:
        return evidence.drops.combined_interval(aspects)
    return share_interval(sum(evidence.shares[k - 1] for k in pickable), evidence.weight)


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


def _drops_by_class(drops: Distribution | None, count: int) -> Counts:
    return drops.by_class().counts if drops is not None else np.zeros(count, dtype=np.int64)


def _filled(counts: Counts, shares: Array, least: int) -> Counts:
    """Return counts (m,), to which shares (k,) of the missing ones up to ``least`` are added.

    The first k of the counts are those of the classes.
    """
    missing = max(least - int(counts.sum()), 0)
    steps = np.rint(missing * np.cumsum(shares) / shares.sum()).astype(np.int64)
    filled = counts.copy()
    filled[: len(shares)] += np.diff(steps, prepend=0)
    return filled
