"""Conversions between distributions over aspects and ROS messages."""

import math
from collections.abc import Iterable

import numpy as np
from builtin_interfaces.msg import Time
from rclpy.serialization import deserialize_message
from resting_aspects_interfaces.msg import AspectDistribution, RunDescription
from std_msgs.msg import Header

from resting_aspects_ros.aspects.estimate import Estimate
from resting_aspects_ros.aspects.find import ASPECT_NUMBERING
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.ros.aspect_conversions import aspect_msgs, aspects_from, share_fields
from resting_aspects_ros.ros.contact_conversions import contact_msgs, contacts_from
from resting_aspects_ros.ros.conversions import run_from, run_msg
from resting_aspects_ros.ros.interface import FRAME
from resting_aspects_ros.simulation.job import RunDescription as Run
from resting_aspects_ros.statistics.distribution import METHOD, Distribution
from resting_aspects_ros.statistics.intervals import Interval


def distribution_msg(
    distribution: Distribution, run: Run, stamp: Time, complete: bool, frame: str = FRAME
) -> AspectDistribution:
    """Return the message for a distribution over all aspects of the part, seen or not."""
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
        lost=distribution.lost,
        sliding=distribution.sliding,
        energy_growth=distribution.energy_growth,
        contacts=contact_msgs(distribution),
        contacts_uncounted=distribution.contacts.uncounted if distribution.contacts else 0,
        complete=complete,
        aspects=aspect_msgs(
            distribution.aspects,
            share_fields(distribution.counts.tolist(), distribution.intervals()),
        ),
    )


def estimate_msg(
    prediction: Estimate, part: Part, stamp: Time, frame: str = FRAME
) -> AspectDistribution:
    """Return the message for a prediction; without drops, its counts are 0 and its bounds NaN."""
    unknown = [Interval(float(p), math.nan, math.nan) for p in prediction.probabilities]
    shares = share_fields([0] * len(unknown), unknown)
    return AspectDistribution(
        header=Header(stamp=stamp, frame_id=frame),
        run=RunDescription(part=part.name, part_sha256=part.part_sha256),
        aspect_numbering=ASPECT_NUMBERING,
        method=prediction.method,
        complete=True,
        aspects=aspect_msgs(prediction.aspects, shares),
    )


def estimate_from(msg: AspectDistribution) -> Estimate:
    """Return the prediction in a message whose method is the name of an estimator."""
    return Estimate(
        aspects_from(msg.run.part_sha256, msg.aspects),
        msg.method,
        np.array([aspect.probability for aspect in msg.aspects]),
    )


def distribution_from(msg: AspectDistribution) -> Distribution:
    """Return the distribution in a message; its probabilities are computed from the counts.

    Raises InvalidValueError if the fields of the message are inconsistent.
    """
    counts = [a.count for a in msg.aspects]
    if max(counts, default=0) >= 2**63:
        raise InvalidValueError(
            f'invalid count {max(counts)}: expected at most the number of drops'
        )
    distribution = Distribution(
        aspects_from(msg.run.part_sha256, msg.aspects),
        np.array(counts, dtype=np.int64),
        unclassified=msg.unclassified,
        unsettled=msg.unsettled,
        failed=msg.failed,
        lost=msg.lost,
        sliding=msg.sliding,
        energy_growth=msg.energy_growth,
        interval=msg.interval,
        confidence=msg.confidence,
        by_precision=msg.run.precision > 0,
        contacts=contacts_from(msg),
    )
    ids = [aspect.id for aspect in msg.aspects]
    if distribution.drops != msg.drops or ids != list(range(1, len(ids) + 1)):
        raise InvalidValueError(
            f'invalid distribution of run {msg.run.run_id}: expected {msg.drops} drops in aspects '
            f'numbered from 1; it has {distribution.drops} drops in aspects {ids}'
        )
    distribution.intervals()  # raises for an invalid interval method or confidence
    return distribution


def probability_of(distribution: AspectDistribution, aspects: Iterable[int]) -> Interval:
    """Return the probability that a part comes to rest in any of the given aspects.

    The interval is computed from the sum of the counts; it is narrower than the sum of the
    intervals of the aspects.

    Parameters
    ----------
    distribution : AspectDistribution
        From get_distribution or from a topic aspect_distributions/<part>.
    aspects : iterable of int
        Their ids; a repeated id counts once.

    Returns
    -------
    Interval
        ``probability``, ``lower`` and ``upper``, 0 to 1, with the confidence of the message.
        Before the first drop, they are 0, 0 and 1. For an analytic method, which counts no drops,
        ``lower`` and ``upper`` are NaN.

    Raises
    ------
    InvalidValueError
        The part does not have one of the aspects, or the message is inconsistent.
    """
    if distribution.method in ('', METHOD):
        return distribution_from(distribution).combined_interval(aspects)
    shares = {aspect.id: aspect.probability for aspect in distribution.aspects}
    ids = set(aspects)
    for k in ids - shares.keys():
        raise InvalidValueError(f'invalid aspect {k!r}: expected 1 to {len(shares)}')
    return Interval(sum(shares[k] for k in ids), math.nan, math.nan)


def serialized_distribution(data: bytes) -> tuple[Distribution, Run, bool]:
    """Return distribution, run and `complete` of a serialized message.

    Raises InvalidValueError if its aspects are numbered by another version of the rule.
    """
    msg = deserialize_message(data, AspectDistribution)
    if msg.aspect_numbering != ASPECT_NUMBERING:
        raise InvalidValueError(
            f'its distribution has aspect_numbering {msg.aspect_numbering}: expected '
            f'{ASPECT_NUMBERING} ("resting_aspects report" counts the drops again)'
        )
    return distribution_from(msg), run_from(msg.run), msg.complete
