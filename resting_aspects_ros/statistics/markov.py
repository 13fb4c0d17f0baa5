"""The Markov chain of a repeated action: long-run shares, wanted aspects, the best plan."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.arrays import Array, Counts, Indices
from resting_aspects_ros.errors import InvalidValueError, shown
from resting_aspects_ros.statistics.intervals import check_confidence, containing


def stationary_shares(chain: Array) -> Array:
    """Return the stationary shares (..., n), x = x T, of irreducible chains T (..., n, n)."""
    p = chain.copy()
    n = p.shape[-1]
    for m in reversed(range(1, n)):
        p[..., :m, m] /= p[..., m, :m].sum(axis=-1)[..., None]
        p[..., :m, :m] += p[..., :m, m, None] * p[..., m, None, :m]
    shares = np.zeros(p.shape[:-1])
    shares[..., 0] = 1.0
    for m in range(1, n):
        shares[..., m] = (shares[..., :m] * p[..., :m, m]).sum(axis=-1)
        # Normalised at each step, because the ratio of two shares can exceed the range of floats.
        shares /= shares.sum(axis=-1, keepdims=True)
    return np.asarray(shares)


def expected_total(inside: Array, exits: Array, gain: Array) -> Array:
    """Return the expected sum (n,) of the gains until a part exits, from each of n states.

    State reduction solves these equations too (Dayar and Akar 2005, SIAM Journal on Matrix
    Analysis and Applications 27:396).

    Parameters
    ----------
    inside : (n, n) float
        Probabilities from row to column. The diagonal is not used: it is the rest of each row.
    exits : (n,) float
        Probability to exit from each state. Every state must have a way to an exit.
    gain : (n,) float
        Gain of each step from a state; 0 or more.
    """
    p, out, total = inside.copy(), exits.copy(), gain.copy()
    for m in reversed(range(len(p))):
        moves = p[m, :m].sum() + out[m]
        p[m, :m] /= moves
        out[m] /= moves
        total[m] /= moves
        to_m = p[:m, m]
        p[:m, :m] += np.outer(to_m, p[m, :m])
        out[:m] += to_m * out[m]
        total[:m] += to_m * total[m]
    for m in range(len(p)):
        total[m] += p[m, :m] @ total[:m]
    return np.asarray(total)


# -- Chains ---------------------------------------------------------------------------------------


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


def drawn_rows(counts: Counts, generator: np.random.Generator, samples: int) -> Array:
    """Return samples (samples, ..., m) of the probabilities behind counts (..., m) of each row.

    They are from the Dirichlet posterior with the prior 1 / m for each of the m columns (Perks
    1947, Journal of the Institute of Actuaries 73:285), so that what was never seen is possible.
    """
    drawn = generator.standard_gamma(counts + 1 / counts.shape[-1], (samples, *counts.shape))
    drawn = np.maximum(drawn, _MIN_SAMPLE)
    return np.asarray(drawn / drawn.sum(axis=-1, keepdims=True))


def long_run_bounds(
    counts: Counts,
    drop: Array,
    confidence: float,
    generator: np.random.Generator,
    samples: int = 1000,
) -> tuple[Array, Array]:
    """Return the lower and upper bounds (k,) of the long-run shares behind counts.

    They are quantiles of the long-run shares over samples of the transitions; see `drawn_rows`.
    The distribution of a drop is taken as known. The bounds are extended to the shares of
    `long_run`, which can be exactly 0 or 1.

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
    k = len(counts)
    drawn = drawn_rows(counts, generator, samples)
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


# -- Plans ----------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Plan:
    """The best action in each of k aspects.

    action : (k,) int
        Index of the action; -1 if the aspect is wanted, and if no choice of actions leads to a
        wanted aspect with certainty.
    time : (k,) float
        Minimum expected time until the part is in a wanted aspect, s; 0 for wanted aspects,
        infinite if no choice of actions leads there with certainty.
    """

    action: Indices
    time: Array


def best_plan(transitions: Array, times: Array, wanted: Mask) -> Plan:
    """Return the plan with the minimum expected time until a part is in a wanted aspect.

    An action that may bring the part where no wanted aspect can be reached with certainty is never
    chosen. If several actions are equally good, the plan has any of them.

    Parameters
    ----------
    transitions : (a, k, k) float
        Probabilities of each action from row to column; see markov.with_replacement. The rows of
        wanted aspects are not used.
    times : (a,) float
        Time that each action takes, s. The time to replace a part that left the aspects is not
        included.
    wanted : (k,) bool

    Raises
    ------
    InvalidValueError
        If a time is not positive and finite, or if the sum of a row is not 1.
    """
    if not ((times > 0) & (times < np.inf)).all():
        raise InvalidValueError(
            f'invalid times {shown(times.tolist())}: expected more than 0 s each, and finite'
        )
    rows = np.where(wanted[:, None], np.eye(len(wanted)), transitions)
    for each in rows:
        check_rows(each)
    action, allowed = _certain(rows > 0, wanted)
    free = np.flatnonzero(action >= 0)
    rows, allowed, policy = rows[:, free], allowed[:, free], action[free]

    def expected_time(policy: Indices) -> Array:
        chosen = rows[policy, np.arange(len(free))]
        return expected_total(chosen[:, free], chosen[:, wanted].sum(axis=1), times[policy])

    best = expected_time(policy)
    while True:
        by_action = np.where(allowed, times[:, None] + rows[..., free] @ best, np.inf)
        better = by_action.min(axis=0) < best
        changed = np.where(better, by_action.argmin(axis=0), policy)
        time = expected_time(changed)
        # Each policy is better than the one before it, so the iteration ends in spite of rounding.
        if not time.sum() < best.sum():
            break
        policy, best = changed, time
    action[free] = policy
    time = np.where(wanted, 0.0, np.inf)
    time[free] = best
    return Plan(action, time)


def _certain(steps: Mask, wanted: Mask) -> tuple[Indices, Mask]:
    """Return actions (k,) that lead to a wanted aspect with certainty, and all allowed ones.

    The actions are -1 where there are none, and for wanted aspects. An action is allowed (a, k) if
    it leaves the part in aspects from which a wanted one can be reached with certainty. The
    algorithm is that of de Alfaro (1999, CONCUR, LNCS 1664:66): aspects without an allowed way to
    a wanted one are removed until none is left to remove.

    Parameters
    ----------
    steps : (a, k, k) bool
        Whether each action can lead from row to column.
    wanted : (k,) bool
    """
    within = np.ones_like(wanted)
    while True:
        allowed: Mask = np.logical_not(steps[..., ~within].any(axis=2))
        action = np.full(len(wanted), -1)
        reached = wanted
        while True:
            leads = allowed & steps[..., reached].any(axis=2)
            new = leads.any(axis=0) & ~reached
            if not new.any():
                break
            # A step to aspects reached before it, so that the actions together reach a wanted one.
            action[new] = leads[:, new].argmax(axis=0)
            reached = reached | new
        if (reached == within).all():
            return action, allowed
        within = reached


def wanted_mask(wanted: Sequence[int], aspects: int) -> npt.NDArray[np.bool_]:
    """Return a mask (k,) of wanted aspects; raises InvalidValueError if an id is not known."""
    if not wanted:
        raise InvalidValueError('invalid wanted aspect: expected at least one')
    for k in wanted:
        if not isinstance(k, int) or not 1 <= k <= aspects:
            raise InvalidValueError(f'invalid wanted aspect {k!r}: expected 1 to {aspects}')
    return np.isin(np.arange(1, aspects + 1), list(wanted))
