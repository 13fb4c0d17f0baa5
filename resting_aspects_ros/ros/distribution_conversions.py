"""Conversions between aspects, distributions, actions, transitions and their ROS messages."""

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point32, Polygon, Vector3
from rclpy.serialization import deserialize_message
from resting_aspects_interfaces.msg import Aspect as AspectMsg
from resting_aspects_interfaces.msg import (
    AspectDistribution,
    ContactShare,
    FeederAction,
    RunDescription,
)
from resting_aspects_interfaces.msg import TransitionMatrix as TransitionMatrixMsg
from std_msgs.msg import Header

from resting_aspects_ros.api.reorient import ReorientResult
from resting_aspects_ros.arrays import Array
from resting_aspects_ros.aspects.aspect_set import Aspect, AspectSet, Sweep
from resting_aspects_ros.aspects.estimate import Estimate
from resting_aspects_ros.aspects.find import ASPECT_NUMBERING
from resting_aspects_ros.aspects.support import CORNER
from resting_aspects_ros.errors import InvalidValueError, shown
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.document import share_fields
from resting_aspects_ros.ros.conversions import (
    column,
    quaternion_msg,
    run_from,
    run_msg,
    shared,
    xyz,
    xyzw,
)
from resting_aspects_ros.ros.interface import FRAME
from resting_aspects_ros.simulation.actions import (
    DEFAULT_TIME,
    KINDS,
    TIME,
    NamedAction,
    make_action,
)
from resting_aspects_ros.simulation.conditions import check_name, quantities_of
from resting_aspects_ros.simulation.job import RunDescription as Run
from resting_aspects_ros.statistics.distribution import METHOD, Distribution, Placement, Placements
from resting_aspects_ros.statistics.intervals import Interval
from resting_aspects_ros.statistics.markov import LongRun
from resting_aspects_ros.statistics.model_range import ModelRange
from resting_aspects_ros.statistics.transitions import OUTCOMES, TransitionMatrix

# -- Distributions --------------------------------------------------------------------------------


# Indexed by their codes in the message Aspect.
SWEEPS = (Sweep.POINT, Sweep.ARC, Sweep.RING, Sweep.DOME, Sweep.SPHERE)


def _shares(distribution: Distribution) -> list[dict[str, object]]:
    """Return the fields of the shares of the aspects, with their model ranges."""
    counts = distribution.counts.tolist()
    return [
        share_fields(count, interval) | _model_fields(model)
        for count, interval, model in zip(
            counts, distribution.intervals(), distribution.model_intervals(), strict=True
        )
    ]


def _model_fields(model: Interval | None = None) -> dict[str, object]:
    """Return the fields of a model range; 0 and 1 if it is not known."""
    lower, upper = (0.0, 1.0) if model is None else (model.lower, model.upper)
    return {'model_lower': lower, 'model_upper': upper}


def _aspect_msgs(aspects: AspectSet, shares: Sequence[Mapping[str, object]]) -> list[AspectMsg]:
    """Return the messages for aspects with the fields of their shares."""
    messages = []
    for aspect, share in zip(aspects, shares, strict=True):
        values = (
            shared(aspect, AspectMsg)
            | dict(share)
            | {
                'sweep': SWEEPS.index(aspect.sweep),
                'axis': Vector3(**xyz(aspect.axis)),
                'down_in_part': Vector3(**xyz(aspect.down_in_part)),
                'orientation': quaternion_msg(aspect.orientation),
                'support': Polygon(points=[Point32(x=x, y=y) for x, y in aspect.support.tolist()]),
            }
        )
        messages.append(AspectMsg(**values))
    return messages


def _aspects_from(part_sha256: str, msgs: Iterable[AspectMsg]) -> AspectSet:
    """Return the aspects of a version of a part; raises InvalidValueError for an invalid code."""
    return AspectSet(part_sha256, tuple(_aspect_from(msg) for msg in msgs))


def _aspect_from(msg: AspectMsg) -> Aspect:
    if msg.sweep >= len(SWEEPS):
        raise InvalidValueError(
            f'invalid sweep {msg.sweep} of aspect {msg.id}: expected 0 to {len(SWEEPS) - 1}'
        )
    values = shared(msg, Aspect)
    values |= {
        'sweep': SWEEPS[msg.sweep],
        'axis': _vector(msg.axis),
        'down_in_part': _vector(msg.down_in_part),
        'orientation': xyzw(msg.orientation),
        'support': np.array([(p.x, p.y) for p in msg.support.points]).reshape(-1, 2),
        # The message does not contain the flat sides that approximate a curved side, since
        # nothing is classified with the result.
        'directions': _vector(msg.down_in_part)[None],
        'links': np.zeros((0, 2), dtype=np.int64),
    }
    return Aspect(**values)


def _vector(msg: Vector3) -> Array:
    return np.array([msg.x, msg.y, msg.z])


def _contact_msgs(distribution: Distribution) -> list[ContactShare]:
    """Return a message for each placement, the most frequent first; none without contacts."""
    contacts = distribution.contacts
    if contacts is None:
        return []
    return [
        ContactShare(
            planes=list(contacts.planes),
            contacts=list(placement.contacts),
            symmetry_class=placement.symmetry_class,
            orientation=quaternion_msg(placement.orientation),
            **share_fields(placement.count, interval),
        )
        for placement, interval in contacts.sorted_rows(
            distribution.interval, distribution.confidence
        )
    ]


def _contacts_from(msg: AspectDistribution) -> Placements | None:
    """Return the placements in a message, the most frequent first; None if it has none."""
    if not msg.contacts:
        return None
    placements = [
        Placement(
            tuple(map(int, each.contacts)),
            xyzw(each.orientation),
            int(each.count),
            int(each.symmetry_class),
        )
        for each in msg.contacts
    ]
    planes = tuple(msg.contacts[0].planes)
    codes = [code for each in placements for code in each.contacts]
    allowed = range(CORNER, len(msg.aspects) + 1)
    if len(codes) != len(planes) * len(placements) or not set(codes) <= set(allowed):
        raise InvalidValueError(
            f'invalid contacts of run {msg.run.run_id}: expected a code from {CORNER} to '
            f'{len(msg.aspects)} for each of {list(planes)}'
        )
    return Placements(planes, placements, msg.drops, msg.contacts_uncounted)


def distribution_msg(
    distribution: Distribution, run: Run, stamp: Time, complete: bool, frame: str = FRAME
) -> AspectDistribution:
    """Return the message for a distribution over all aspects of the part, seen or not."""
    values = shared(distribution, AspectDistribution) | {
        'header': Header(stamp=stamp, frame_id=frame),
        'run': run_msg(run),
        'aspect_numbering': ASPECT_NUMBERING,
        'method': METHOD,
        'contacts': _contact_msgs(distribution),
        'contacts_uncounted': distribution.contacts.uncounted if distribution.contacts else 0,
        'complete': complete,
        'aspects': _aspect_msgs(distribution.aspects, _shares(distribution)),
    }
    message = AspectDistribution(**values)
    number = len(distribution.aspects.classes())
    message.class_model_lower, message.class_model_upper = [0.0] * number, [1.0] * number
    if (model := distribution.model) is not None:
        message.model_uncertain = list(model.uncertain)
        message.class_model_lower, message.class_model_upper = model.by_class.T.tolist()
    return message


def _model_from(msg: AspectDistribution) -> ModelRange | None:
    """Return the model ranges in a message; None if they are not known.

    Raises InvalidValueError if they are not those of its aspects.
    """
    by_aspect = np.array([(each.model_lower, each.model_upper) for each in msg.aspects])
    by_class = np.stack([msg.class_model_lower, msg.class_model_upper], axis=1)
    if len(by_class) != len({each.symmetry_class for each in msg.aspects}):
        raise InvalidValueError(
            f'invalid model ranges of run {msg.run.run_id}: expected one for each symmetry class'
        )
    if (by_class == [0, 1]).all():
        return None
    return ModelRange(by_aspect, by_class, tuple(msg.model_uncertain), msg.confidence)


def estimate_msg(
    prediction: Estimate, part: Part, stamp: Time, frame: str = FRAME
) -> AspectDistribution:
    """Return the message for a prediction; without drops, its counts are 0 and its bounds NaN."""
    unknown = [Interval(float(p), math.nan, math.nan) for p in prediction.probabilities]
    shares = [share_fields(0, each) | _model_fields() for each in unknown]
    return AspectDistribution(
        header=Header(stamp=stamp, frame_id=frame),
        run=RunDescription(part=part.name, part_sha256=part.part_sha256),
        aspect_numbering=ASPECT_NUMBERING,
        method=prediction.method,
        complete=True,
        aspects=_aspect_msgs(prediction.aspects, shares),
    )


def distribution_from(msg: AspectDistribution) -> Distribution:
    """Return the distribution in a message; its probabilities are computed from the counts.

    Raises InvalidValueError if the fields of the message are inconsistent.
    """
    values = shared(msg, Distribution) | {
        'aspects': _aspects_from(msg.run.part_sha256, msg.aspects),
        'counts': np.array([each.count for each in msg.aspects], dtype=np.int64),
        'by_precision': msg.run.precision > 0,
        'contacts': _contacts_from(msg),
    }
    distribution = Distribution(**values)
    ids = [aspect.id for aspect in msg.aspects]
    if distribution.drops != msg.drops or ids != list(range(1, len(ids) + 1)):
        raise InvalidValueError(
            f'invalid distribution of run {msg.run.run_id}: expected {msg.drops} drops in aspects '
            f'numbered from 1; it has {distribution.drops} drops in aspects {ids}'
        )
    distribution.intervals()  # raises for an invalid interval method or confidence
    return dataclasses.replace(distribution, model=_model_from(msg))


def probability_of(distribution: AspectDistribution, aspects: Iterable[int]) -> Interval:
    """Return the probability that a part comes to rest in any of the aspects with some ids.

    The interval is computed from the sum of the counts; it is narrower than the sum of the
    intervals of the aspects. Before the first drop, it is 0 to 1; for an analytic method, which
    counts no drops, its bounds are NaN.

    Raises InvalidValueError if the part does not have one of the aspects, or the message is
    inconsistent.
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


# -- Actions and transitions ----------------------------------------------------------------------


# Long-run shares with their lower and upper bounds (k,).
BoundedLongRun = tuple[LongRun, Array, Array]


def action_msg(action: NamedAction) -> FeederAction:
    """Return the message for an action with all its values."""
    values = {name: each for name, each in action.values.items() if name not in ('name', 'kind')}
    quantities = {'time': TIME, **quantities_of(action.action)}
    return FeederAction(
        name=action.name,
        kind=action.action.kind,
        names=list(values),
        units=[quantities[name].unit for name in values],
        values=[float(each) for each in values.values()],
    )


def action_from(msg: FeederAction) -> NamedAction:
    """Return the action in a message with kind and values; raises InvalidValueError."""
    if msg.kind not in KINDS:
        raise InvalidValueError(
            f'invalid kind of action {shown(msg.kind)}: expected one of {", ".join(KINDS)}'
        )
    name = check_name('an action', msg.name or msg.kind)
    if len(msg.values) != len(msg.names) or len(set(msg.names)) < len(msg.names):
        raise InvalidValueError(
            f'invalid names {shown(msg.names)} of values of action {name}: expected a different '
            f'one for each of {len(msg.values)} values'
        )
    values = dict(zip(msg.names, msg.values, strict=True))
    time = values.pop('time', DEFAULT_TIME)
    return NamedAction(name, make_action(msg.kind, values), time)


def transitions_msg(
    result: ReorientResult,
    stamp: Time,
    *,
    ended: bool,
    long_run: BoundedLongRun | None = None,
    frame: str = FRAME,
) -> TransitionMatrixMsg:
    """Return the message for the transitions that an action causes.

    ended : whether no action follows
    long_run : long-run shares of the result, if they are known
    """
    matrix, drop = result.matrix, result.drop
    lower, upper = matrix.bounds()
    message = TransitionMatrixMsg(
        header=Header(stamp=stamp, frame_id=frame),
        run=run_msg(result.run),
        action=action_msg(result.action),
        aspect_numbering=ASPECT_NUMBERING,
        aspects=_aspect_msgs(drop.aspects, _shares(drop)),
        drops=drop.drops,
        confidence=matrix.confidence,
        interval=matrix.interval,
        actions=column(matrix.actions),
        counts=column(matrix.counts),
        probability=column(matrix.probability),
        lower=column(lower),
        upper=column(upper),
        sliding=matrix.sliding,
        energy_growth=matrix.energy_growth,
        complete=result.complete,
        ended=ended,
    )
    if long_run is not None:
        _add_long_run(message, *long_run)
    return message


def transition_matrix_from(msg: TransitionMatrixMsg) -> TransitionMatrix:
    """Return the matrix in a message, with arrays (n, n + 4) for its n aspects.

    Probabilities and bounds are computed from the counts; `by_class` of the result returns the
    matrix over symmetry classes.

    Raises InvalidValueError if the fields of the message are inconsistent.
    """
    n = len(msg.aspects)
    shape = (n, n + len(OUTCOMES))
    consistent = (
        n > 0
        and [aspect.id for aspect in msg.aspects] == list(range(1, n + 1))
        and len(msg.counts) == shape[0] * shape[1]
        and max(msg.counts) < 2**63
    )
    counts = np.array(msg.counts if consistent else [], dtype=np.int64)
    values = shared(msg, TransitionMatrix) | {
        'aspects': _aspects_from(msg.run.part_sha256, msg.aspects),
        'counts': counts.reshape(shape if consistent else (0, 0)),
        'by_precision': msg.run.precision > 0,
    }
    matrix = TransitionMatrix(**values)
    if not consistent or matrix.actions.tolist() != list(msg.actions):
        raise InvalidValueError(
            f'invalid transition matrix of run {shown(msg.run.run_id)}: expected a row for each '
            'aspect, numbered from 1, and the number of actions of each row'
        )
    matrix.bounds()  # raises for an invalid interval method or confidence
    return matrix


def check_transitions(msg: TransitionMatrixMsg, part: str) -> None:
    """Raise InvalidValueError if a message on transitions/<part> is not valid for that part."""
    run = run_from(msg.run)
    if run.part != part:
        raise InvalidValueError(f'invalid transition matrix of part {run.part}: expected {part}')
    action_from(msg.action)
    transition_matrix_from(msg)


def serialized_transitions(data: bytes) -> TransitionMatrixMsg:
    """Return the message in CDR; InvalidValueError if it is inconsistent or numbered otherwise."""
    msg = deserialize_message(data, TransitionMatrixMsg)
    check_transitions(msg, msg.run.part)
    check_numbering(msg)
    return msg


def check_numbering(msg: TransitionMatrixMsg) -> None:
    """Raise InvalidValueError if the aspects are numbered by another version of the rule."""
    if msg.aspect_numbering != ASPECT_NUMBERING:
        raise InvalidValueError(
            f'its transition matrix has aspect_numbering {msg.aspect_numbering}: expected '
            f'{ASPECT_NUMBERING}'
        )


def _add_long_run(
    message: TransitionMatrixMsg, long_run: LongRun, lower: Array, upper: Array
) -> None:
    closed_class = np.zeros(len(long_run.shares), dtype=np.int64)
    for number, members in enumerate(long_run.closed, 1):
        closed_class[list(members)] = number
    message.long_run = column(long_run.shares)
    message.long_run_lower = column(lower)
    message.long_run_upper = column(upper)
    message.closed_class = closed_class.tolist()
    # Closed classes have no aspect in common.
    message.closed_class_share = column(long_run.stationary.sum(axis=0))
    message.closed_class_weight = column(long_run.weights)
    message.unreachable = [k + 1 for k in long_run.unreachable]
