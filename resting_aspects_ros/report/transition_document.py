"""JSON fields of transition matrices, long-run shares and retention curves, in SI units."""

from collections.abc import Sequence
from typing import Any

from resting_aspects_ros.arrays import Array
from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.report.document import numbers, plain
from resting_aspects_ros.statistics.markov import LongRun
from resting_aspects_ros.statistics.transitions import (
    LEVELS,
    OUTCOMES,
    RetentionCurve,
    TransitionMatrix,
)


def matrix_fields(matrix: TransitionMatrix) -> dict[str, Any]:
    """Return a matrix by aspect, and in ``classes`` by symmetry class, as plain JSON types.

    Parameters
    ----------
    matrix : TransitionMatrix
        By aspect.

    Returns
    -------
    dict
        ``columns``: the ids of the aspects, then the names of the outcomes in no aspect.
        ``counts``, ``probability``, ``lower`` and ``upper``: a row from each aspect, with a number
        for each column; the probability is null in a row without actions. ``actions``: the number
        of actions of each row. ``classes``: the same fields with the numbers of the symmetry
        classes instead of ids, and ``members``, the ids of the aspects of each class.
    """
    aspects = matrix.aspects
    members = [[aspect.id for aspect in alike] for alike in aspects.classes()]
    by_class = _fields(matrix.by_class(), [a[0].symmetry_class for a in aspects.classes()])
    by_aspect = _fields(matrix, [aspect.id for aspect in aspects.aspects])
    return {**by_aspect, 'classes': {'members': members, **by_class}}


def _fields(matrix: TransitionMatrix, numbers_of_rows: Sequence[int]) -> dict[str, object]:
    lower, upper = matrix.bounds()
    return {
        'columns': [*numbers_of_rows, *OUTCOMES],
        'actions': plain(matrix.actions),
        'counts': plain(matrix.counts),
        'probability': plain(matrix.probability),
        'lower': plain(lower),
        'upper': plain(upper),
    }


def long_run_fields(
    long_run: LongRun, lower: Array, upper: Array, aspects: AspectSet
) -> dict[str, object]:
    """Return the shares that repeated actions lead to, as plain JSON types.

    Parameters
    ----------
    long_run : LongRun
        By aspect.
    lower, upper : (k,) float
        Bounds of its shares.

    Returns
    -------
    dict
        ``long_run``, ``long_run_lower`` and ``long_run_upper`` by aspect id. ``closed_classes``:
        for each closed class the ids of its ``aspects``, its ``weight``, which is the probability
        to end in it, and the ``shares`` of all aspects within it. ``transient`` and
        ``unreachable``: the ids of aspects in no closed class, and of aspects to which no dropped
        part and no action leads.
    """
    ids = [aspect.id for aspect in aspects.aspects]
    closed = zip(long_run.closed, long_run.weights.tolist(), long_run.stationary, strict=True)
    return {
        'long_run': numbers(long_run.shares),
        'long_run_lower': numbers(lower),
        'long_run_upper': numbers(upper),
        'closed_classes': [
            {'aspects': [ids[k] for k in members], 'weight': weight, 'shares': numbers(shares)}
            for members, weight, shares in closed
        ],
        'transient': [ids[k] for k in long_run.transient],
        'unreachable': [ids[k] for k in long_run.unreachable],
    }


def retention_fields(curve: RetentionCurve) -> dict[str, object]:
    """Return a retention curve as plain JSON types.

    Returns
    -------
    dict
        ``aspect``: its id. ``barrier``: m, null without another aspect. ``lift``: lift heights, m,
        ascending, and for each of them ``left``, the number of parts that left the aspect, of
        ``parts`` that were disturbed, and the ``probability`` with its bounds ``lower`` and
        ``upper``. ``levels``: for each of the probabilities 0.01, 0.1 and 0.5 the ``lift`` height
        at which it is first reached, and its bounds; null where it is not reached.
    """
    lower, upper = curve.bounds()
    levels = []
    for level in LEVELS:
        low, high = curve.lift_interval(level)
        levels.append({'level': level, 'lift': curve.lift_at(level), 'lower': low, 'upper': high})
    return {
        'aspect': curve.aspect,
        'barrier': plain(float(curve.barrier)),
        'lift': numbers(curve.lift),
        'left': plain(curve.left),
        'parts': plain(curve.parts),
        'probability': plain(curve.probability),
        'lower': plain(lower),
        'upper': plain(upper),
        'levels': plain(levels),
    }
