"""The Markov chain of a repeated action: long-run shares, and how parts reach wanted aspects.

States are 0-based indices of aspects or of symmetry classes.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.errors import InvalidValueError, shown
from resting_aspects_ros.core.reorientation.state_reduction import (
    expected_total,
    stationary_shares,
)
from resting_aspects_ros.core.statistics.intervals import (
    Array,
    Counts,
    check_confidence,
    containing,
)

Mask = npt.NDArray[np.bool_]

# The probabilities of a row may differ from a sum of 1 by this, because of rounding. It is far
# below the smallest share that can be counted.
SUM_TOLERANCE = 1e-9
# Lower limit of a sample of the gamma distribution. For transitions that were never seen, a sample
# can be so small that it is rounded to 0.
_MIN_SAMPLE = 1e-100
# Number of sampled chains that are solved at once.
BLOCK = 50


@dataclass(frozen=True, eq=False)
class LongRun:
    """The mix of k aspects that repeated actions lead to.

    The shares are averages over many actions. If the chain is periodic, for example because an
    action turns each part over, the mix alternates around them.

    shares : (k,) float
        Share of each aspect: the sum over the closed classes of weight times stationary share.
    closed : tuple of tuples of int
        The c closed classes: sets of aspects that no part leaves; see `closed_classes`.
    weights : (c,) float
        Probability that a part that starts with a drop ends in each closed class.
    stationary : (c, k) float
        Shares within each closed class; the sum of each row is 1.
    transient : tuple of int
        Aspects in no closed class. Parts leave them sooner or later for good.
    unreachable : tuple of int
        Aspects that no sequence of drops and actions leads to.
    """

    shares: Array
    closed: tuple[tuple[int, ...], ...]
    weights: Array
    stationary: Array
    transient: tuple[int, ...]
    unreachable: tuple[int, ...]


def closed_classes(transitions: Array) -> list[tuple[int, ...]]:
    """Return the closed classes of a chain, each ascending, ordered by their first index.

    A closed class is a set of aspects within which every aspect leads to every other, and that no
    part leaves, neither for other aspects nor by leaving the aspects.

    Parameters
    ----------
    transitions : (k, k) float
        Probabilities from row to column; the rest of a row leaves the aspects.
    """
    paths = _paths(transitions > 0)
    stays = transitions.sum(axis=1) >= 1 - SUM_TOLERANCE
    found = []
    for first, reached in enumerate(paths):
        members = np.flatnonzero(reached)
        if members[0] == first and paths[members, first].all() and stays[members].all():
            found.append(tuple(members.tolist()))
    return found


def with_replacement(transitions: Array, left: Array, drop: Array) -> Array:
    """Return the transitions (k, k) if parts that left the aspects are replaced by dropped parts.

    They are T + left x_drop, where x_drop is ``drop`` divided by its sum: a part that is dropped
    into no aspect is dropped again.

    Parameters
    ----------
    transitions : (k, k) float
        Probabilities T from row to column.
    left : (k,) float
        Probability that a part leaves the aspects, the rest of each row of T.
    drop : (k,) float
        Probability that a dropped part comes to rest in each aspect.

    Raises
    ------
    InvalidValueError
        If the sum of a row with its rest is not 1, or if parts leave the aspects and no drop leads
        to an aspect.
    """
    check_rows(np.column_stack([transitions, left]))
    return transitions + np.outer(left, _drop_shares(drop)) if left.any() else transitions


def long_run(transitions: Array, left: Array, drop: Array) -> LongRun:
    """Return the long-run shares x = x (T + left x_drop); see `with_replacement`.

    Raises InvalidValueError as `with_replacement`, and if no drop leads to an aspect.
    """
    start = _drop_shares(drop)
    chain = with_replacement(transitions, left, drop)
    closed = closed_classes(chain)
    stationary = np.zeros((len(closed), len(chain)))
    weights = np.zeros(len(closed))
    for number, members in enumerate(closed):
        stationary[number, members] = stationary_shares(chain[np.ix_(members, members)])
        inside = np.isin(np.arange(len(chain)), members)
        weights[number] = start @ reach(chain, inside)[0]
    reached = _paths(chain > 0)[start > 0].any(axis=0)
    return LongRun(
        shares=weights @ stationary,
        closed=tuple(closed),
        weights=weights,
        stationary=stationary,
        transient=tuple(sorted(set(range(len(chain))).difference(*closed))),
        unreachable=tuple(np.flatnonzero(~reached).tolist()),
    )


def long_run_bounds(
    counts: Counts,
    drop: Array,
    confidence: float,
    generator: np.random.Generator,
    samples: int = 1000,
) -> tuple[Array, Array]:
    """Return the lower and upper bounds (k,) of the long-run shares behind counts.

    They are quantiles of the long-run shares over samples of the transitions from the Dirichlet
    posterior of each row. The prior is 1 / m for each of the m columns (Perks 1947, Journal of the
    Institute of Actuaries 73:285), so that transitions that were never seen are possible. The
    distribution of a drop is taken as known. The bounds are extended to the shares of `long_run`,
    which can be exactly 0 or 1.

    Parameters
    ----------
    counts : (k, m) int
        Actions from each aspect (row) to each aspect (first k columns) or out of the aspects. A
        row without actions only has the prior.
    drop : (k,) float
        Probability that a dropped part comes to rest in each aspect.
    confidence : float
        More than 0.5 and less than 1.

    Raises
    ------
    InvalidValueError
        If the confidence is invalid, or if no drop leads to an aspect.
    """
    check_confidence(confidence)
    k, columns = counts.shape
    drawn = generator.standard_gamma(counts + 1 / columns, (samples, k, columns))
    drawn = np.maximum(drawn, _MIN_SAMPLE)
    drawn /= drawn.sum(axis=-1, keepdims=True)
    left = drawn[..., k:].sum(axis=-1, keepdims=True)
    chains = drawn[..., :k] + left * _drop_shares(drop)
    # In blocks that fit the cache of the processor.
    blocks = np.array_split(chains, -(-samples // BLOCK))
    shares = np.concatenate([stationary_shares(block) for block in blocks])
    lower, upper = np.quantile(shares, [(1 - confidence) / 2, (1 + confidence) / 2], axis=0)
    actions = counts.sum(axis=1, keepdims=True)
    if (actions > 0).all():
        share = counts / actions
        found = long_run(share[:, :k], share[:, k:].sum(axis=1), drop).shares
        lower, upper = containing(found, lower, upper)
    return lower, upper


def reach(transitions: Array, wanted: Mask) -> tuple[Array, Array]:
    """Return how likely a repeated action leads to a wanted aspect, and after how many actions.

    Parameters
    ----------
    transitions : (k, k) float
        Probabilities from row to column; the rest of a row leaves the aspects. The rows of wanted
        aspects are not used.
    wanted : (k,) bool

    Returns
    -------
    probability : (k,) float
        Probability to reach a wanted aspect before leaving the aspects; 1 for wanted aspects.
    actions : (k,) float
        Expected number of actions, given that a wanted aspect is reached; 0 for wanted aspects,
        NaN where none is ever reached.

    Raises
    ------
    InvalidValueError
        If the row of an aspect that is not wanted has a negative entry, a NaN or a sum above 1.
    """
    rows = np.where(wanted[:, None], np.eye(len(transitions)), transitions)
    left = np.maximum(1 - rows.sum(axis=1), 0.0)
    check_rows(np.column_stack([rows, left]))
    left[left <= SUM_TOLERANCE] = 0.0
    ways = _paths(rows > 0)[:, wanted].any(axis=1) & ~wanted
    inside = rows[np.ix_(ways, ways)]
    arrives = rows[np.ix_(ways, wanted)].sum(axis=1)
    exits = arrives + rows[np.ix_(ways, ~ways & ~wanted)].sum(axis=1) + left[ways]
    probability = wanted.astype(np.float64)
    probability[ways] = np.minimum(expected_total(inside, exits, arrives), 1.0)
    actions = np.where(wanted, 0.0, np.nan)
    # n(i) = b(i) + sum of T(i, j) n(j) for n = b E[number of actions | reached].
    actions[ways] = expected_total(inside, exits, probability[ways]) / probability[ways]
    return probability, actions


def check_rows(rows: Array) -> None:
    """Raise InvalidValueError unless each row has probabilities with a sum of 1."""
    # Written so that NaN is rejected.
    good = (rows >= 0).all(axis=1) & (np.abs(rows.sum(axis=1) - 1) <= SUM_TOLERANCE)
    if not good.all():
        number = int(good.argmin())
        raise InvalidValueError(
            f'invalid row {number + 1} of the transition matrix {shown(rows[number].tolist())}: '
            'expected probabilities with a sum of 1'
        )


def _drop_shares(drop: Array) -> Array:
    if not ((drop >= 0).all() and 0 < drop.sum() < np.inf):
        raise InvalidValueError(
            f'invalid drop probabilities {shown(drop.tolist())}: expected 0 or more, not all 0'
        )
    return np.asarray(drop / drop.sum())


def _paths(steps: Mask) -> Mask:
    """Return whether any number of steps, including none, leads from row to column, (k, k)."""
    paths: Mask = steps | np.eye(len(steps), dtype=np.bool_)
    while True:
        longer = paths @ paths
        if (longer == paths).all():
            return paths
        paths = longer
