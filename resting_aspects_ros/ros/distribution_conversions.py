"""Between distributions over aspects and ROS messages."""

import math
from collections.abc import Iterable, Sequence

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point32, Polygon, Quaternion, Vector3
from rclpy.serialization import deserialize_message
from resting_aspects_interfaces.msg import (
    Aspect,
    AspectDistribution,
    RunDescription,
    SymmetryClass,
)
from std_msgs.msg import Header

from resting_aspects_ros.core.aspects import aspect_set
from resting_aspects_ros.core.aspects.aspect import ASPECT_NUMBERING
from resting_aspects_ros.core.aspects.aspect_set import AspectSet, Sweep
from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.estimators.estimate import Estimate
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.rotations import Array
from resting_aspects_ros.core.statistics.distribution import METHOD, Distribution
from resting_aspects_ros.core.statistics.intervals import Interval
from resting_aspects_ros.ros.conversions import run_from, run_msg
from resting_aspects_ros.ros.interface import FRAME
from resting_aspects_ros.simulation.run_description import RunDescription as Run

# By their codes in the message Aspect.
SWEEPS = (Sweep.POINT, Sweep.ARC, Sweep.RING, Sweep.DOME, Sweep.SPHERE)
# Fields of an aspect that are the same in its message.
_ASPECT_FIELDS = [
    'id',
    'symmetry_class',
    'multiplicity',
    'rolls',
    'com_height',
    'min_barrier',
    'neighbour',
    'basin_share',
]


def distribution_msg(
    distribution: Distribution, run: Run, stamp: Time, complete: bool, frame: str = FRAME
) -> AspectDistribution:
    """A distribution with all aspects of the part, seen or not."""
    classes = distribution.by_class()
    return AspectDistribution(
        header=Header(stamp=stamp, frame_id=frame),
        run=run_msg(run),
        aspect_numbering=ASPECT_NUMBERING,
        method=METHOD,
        confidence=distribution.confidence,
        interval=distribution.interval,
        drops=distribution.drops,
        unclassified=distribution.unclassified,
        unsettled=distribution.unsettled,
        failed=distribution.failed,
        energy_growth=distribution.energy_growth,
        complete=complete,
        **_rows(
            distribution.aspects,
            _shares(distribution.counts.tolist(), distribution.intervals()),
            _shares(classes.counts.tolist(), classes.intervals()),
        ),
    )


def estimate_msg(
    found: Estimate, part: Part, stamp: Time, frame: str = FRAME
) -> AspectDistribution:
    """What an estimator predicts: without drops, so without counts and bounds (NaN)."""
    single = found.probabilities.tolist()
    summed = [sum(single[each.id - 1] for each in members) for members in found.aspects.classes()]
    predicted = [
        _shares([0] * len(each), [Interval(p, math.nan, math.nan) for p in each])
        for each in (single, summed)
    ]
    return AspectDistribution(
        header=Header(stamp=stamp, frame_id=frame),
        run=RunDescription(part=part.name, part_sha256=part.part_sha256),
        aspect_numbering=ASPECT_NUMBERING,
        method=found.method,
        complete=True,
        **_rows(found.aspects, *predicted),
    )


def estimate_from(msg: AspectDistribution) -> Estimate:
    """What an estimator predicted, of a message with its name as the method."""
    return Estimate(
        _aspects_from(msg), msg.method, np.array([aspect.probability for aspect in msg.aspects])
    )


def _shares(counts: list[int], intervals: Sequence[Interval]) -> list[dict[str, object]]:
    return [
        {'count': k, 'probability': i.probability, 'lower': i.lower, 'upper': i.upper}
        for k, i in zip(counts, intervals, strict=True)
    ]


def _rows(
    aspects: AspectSet, shares: list[dict[str, object]], of_classes: list[dict[str, object]]
) -> dict[str, object]:
    """The fields `aspects` and `classes` of a distribution."""
    return {
        'aspects': [
            Aspect(**_aspect_fields(aspect), **share)
            for aspect, share in zip(aspects.aspects, shares, strict=True)
        ],
        'classes': [
            SymmetryClass(
                symmetry_class=members[0].symmetry_class,
                aspects=[aspect.id for aspect in members],
                **share,
            )
            for members, share in zip(aspects.classes(), of_classes, strict=True)
        ],
    }


def _aspect_fields(aspect: aspect_set.Aspect) -> dict[str, object]:
    orientation = aspect.orientation.tolist()
    points = [Point32(x=x, y=y) for x, y in aspect.support.tolist()]
    return {
        **{name: getattr(aspect, name) for name in _ASPECT_FIELDS},
        'sweep': SWEEPS.index(aspect.sweep),
        'axis': _vector_msg(aspect.axis),
        'down_in_part': _vector_msg(aspect.down_in_part),
        'orientation': Quaternion(**dict(zip('xyzw', orientation, strict=True))),
        'support': Polygon(points=points),
    }


def distribution_from(msg: AspectDistribution) -> Distribution:
    """The counts and aspects of a message; its probabilities follow from them.

    Raises InvalidValueError if they cannot be those of a distribution.
    """
    counts = [a.count for a in msg.aspects]
    if max(counts, default=0) >= 2**63:
        raise InvalidValueError(f'invalid count {max(counts)}: expected at most the drops')
    found = Distribution(
        _aspects_from(msg),
        np.array(counts, dtype=np.int64),
        unclassified=msg.unclassified,
        unsettled=msg.unsettled,
        failed=msg.failed,
        energy_growth=msg.energy_growth,
        interval=msg.interval,
        confidence=msg.confidence,
        by_precision=msg.run.precision > 0,
    )
    ids = [aspect.id for aspect in msg.aspects]
    if found.drops != msg.drops or ids != list(range(1, len(ids) + 1)):
        raise InvalidValueError(
            f'distribution of run {msg.run.run_id} has {found.drops} drops in the aspects {ids}, '
            f'allowed are its {msg.drops} drops, in aspects from 1 on'
        )
    found.intervals()  # raises, too
    return found


def probability_of(distribution: AspectDistribution, aspects: Iterable[int]) -> Interval:
    """How probable it is that a part comes to rest in any of some aspects.

    The interval is that of their sum, which is narrower than the intervals added up: they are
    counted together.

    Parameters
    ----------
    distribution : AspectDistribution
        As it is answered and published.
    aspects : iterable of int
        Their ids; one that comes twice counts once.

    Returns
    -------
    Interval
        ``probability``, ``lower`` and ``upper``, 0 to 1, with the message's confidence. Before the
        first drop 0 in 0 to 1; of an analytic method, which counts no drops, the ends are NaN.

    Raises
    ------
    InvalidValueError
        The part has no aspect of an id, or it is no distribution.
    """
    if distribution.method in ('', METHOD):
        return distribution_from(distribution).together(aspects)
    shares = {aspect.id: aspect.probability for aspect in distribution.aspects}
    ids = set(aspects)
    for k in ids - shares.keys():
        raise InvalidValueError(f'aspect is {k!r}, allowed is 1 to {len(shares)}')
    return Interval(sum(shares[k] for k in ids), math.nan, math.nan)


def serialized_distribution(data: bytes) -> tuple[Distribution, Run, bool]:
    """The distribution, its run and whether that was over, of a message as a log has it.

    Raises InvalidValueError if its aspects do not have the ids that they have today.
    """
    msg = deserialize_message(data, AspectDistribution)
    if msg.aspect_numbering != ASPECT_NUMBERING:
        raise InvalidValueError(
            f'its distribution has aspect_numbering {msg.aspect_numbering}: expected '
            f'{ASPECT_NUMBERING} ("resting_aspects report" and "merge" count the drops again)'
        )
    return distribution_from(msg), run_from(msg.run), msg.complete


def _aspects_from(msg: AspectDistribution) -> AspectSet:
    return AspectSet(msg.run.part_sha256, tuple(_aspect_from(a) for a in msg.aspects))


def _aspect_from(msg: Aspect) -> aspect_set.Aspect:
    if msg.sweep >= len(SWEEPS):
        raise InvalidValueError(
            f'sweep of aspect {msg.id} is {msg.sweep}, allowed is 0 to {len(SWEEPS) - 1}'
        )
    return aspect_set.Aspect(
        **{name: getattr(msg, name) for name in _ASPECT_FIELDS},
        sweep=SWEEPS[msg.sweep],
        axis=_vector(msg.axis),
        down_in_part=_vector(msg.down_in_part),
        orientation=np.array([getattr(msg.orientation, axis) for axis in 'xyzw']),
        support=np.array([(p.x, p.y) for p in msg.support.points]).reshape(-1, 2),
        # The flats of a curved side do not travel: nothing is classified with this.
        directions=_vector(msg.down_in_part)[None],
        links=np.zeros((0, 2), dtype=np.int64),
    )


def _vector_msg(vector: Array) -> Vector3:
    return Vector3(**dict(zip('xyz', vector.tolist(), strict=True)))


def _vector(msg: Vector3) -> Array:
    return np.array([msg.x, msg.y, msg.z])
