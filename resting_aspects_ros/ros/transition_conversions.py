"""Conversions between actions, transition matrices and ROS messages."""

from array import array

import numpy as np
import numpy.typing as npt
from builtin_interfaces.msg import Time
from rclpy.serialization import deserialize_message
from resting_aspects_interfaces.msg import FeederAction
from resting_aspects_interfaces.msg import TransitionMatrix as TransitionMatrixMsg
from std_msgs.msg import Header

from resting_aspects_ros.api.reorient import ReorientResult
from resting_aspects_ros.arrays import Array
from resting_aspects_ros.aspects.find import ASPECT_NUMBERING
from resting_aspects_ros.errors import InvalidValueError, shown
from resting_aspects_ros.ros.conversions import run_from, run_msg
from resting_aspects_ros.ros.distribution_conversions import (
    aspect_msgs,
    aspects_from,
    ranged_fields,
)
from resting_aspects_ros.ros.interface import FRAME
from resting_aspects_ros.simulation.actions import (
    DEFAULT_TIME,
    KINDS,
    TIME,
    NamedAction,
    make_action,
)
from resting_aspects_ros.simulation.conditions import quantities_of
from resting_aspects_ros.statistics.markov import LongRun
from resting_aspects_ros.statistics.transitions import OUTCOMES, TransitionMatrix

# Maximum length of the name of an action.
MAX_NAME = 64
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
    name = msg.name or msg.kind
    if not name.isidentifier() or len(name) > MAX_NAME:
        raise InvalidValueError(
            f'invalid name {shown(name)} of an action: expected up to {MAX_NAME} letters, digits '
            'and "_", a letter first'
        )
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
        aspects=aspect_msgs(drop.aspects, ranged_fields(drop)),
        drops=drop.drops,
        confidence=matrix.confidence,
        interval=matrix.interval,
        actions=_integers(matrix.actions),
        counts=_integers(matrix.counts),
        probability=_numbers(matrix.probability),
        lower=_numbers(lower),
        upper=_numbers(upper),
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
    matrix = TransitionMatrix(
        aspects_from(msg.run.part_sha256, msg.aspects),
        counts.reshape(shape if consistent else (0, 0)),
        interval=msg.interval,
        confidence=msg.confidence,
        by_precision=msg.run.precision > 0,
        energy_growth=msg.energy_growth,
        sliding=msg.sliding,
    )
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
    message.long_run = _numbers(long_run.shares)
    message.long_run_lower = _numbers(lower)
    message.long_run_upper = _numbers(upper)
    message.closed_class = closed_class.tolist()
    # Closed classes have no aspect in common.
    message.closed_class_share = _numbers(long_run.stationary.sum(axis=0))
    message.closed_class_weight = _numbers(long_run.weights)
    message.unreachable = [k + 1 for k in long_run.unreachable]


def _numbers(values: Array) -> 'array[float]':
    # rclpy checks each element of a list, but not of an array of the right type.
    return array('d', values.ravel().tolist())


def _integers(values: npt.NDArray[np.int64]) -> 'array[int]':
    return array('Q', values.ravel().tolist())
