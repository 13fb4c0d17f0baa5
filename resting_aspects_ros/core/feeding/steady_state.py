"""The long run of a feeder: the mix of aspects on the tray, and what the robot picks of it.

Each of the N places on the tray is a Markov chain over the aspects. In each cycle a part that is
wanted and free is picked, and a dropped part takes its place. Any other part is moved by the
action of the feeder, and if it leaves the aspects, a dropped part takes its place as well. So the
mix x is the fixed point of N x' = (N x - picked) T + S x_drop, with S supplied parts.
"""

from dataclasses import dataclass

import numpy as np

from resting_aspects_ros.core.feeding.cycle import CycleTimes, Picks, cycle_time, picks
from resting_aspects_ros.core.reorientation.markov import Mask, long_run
from resting_aspects_ros.core.reorientation.state_reduction import stationary_shares
from resting_aspects_ros.core.statistics.intervals import Array, Counts

# Halvings of the interval of the share of wanted free parts that is picked.
HALVINGS = 20
_MIN_SAMPLE = 1e-100
# Fewer picks per cycle are none.
NO_PICKS = 1e-8


@dataclass(frozen=True, eq=False)
class Moves:
    """How parts come onto the tray and move on it; all arrays may have further leading axes.

    drop : (..., k) float
        Share of each aspect among dropped parts that come to rest in an aspect.
    transitions : (..., k, k) float
        Probabilities of the action from row to column.
    left : (..., k) float
        Probability to leave the aspects, the rest of each row.
    """

    drop: Array
    transitions: Array
    left: Array


@dataclass(frozen=True, eq=False)
class SteadyState:
    """The long run with N parts on the tray.

    mix : (..., k) float
        Shares of the aspects in an image.
    taken : (..., k) float
        Probability that a part of each aspect is picked.
    picks : Picks
        Of one cycle.
    lost : (...) float
        Mean number of parts that leave the aspects in a cycle.
    """

    mix: Array
    taken: Array
    picks: Picks
    lost: Array

    @property
    def supplied(self) -> Array:
        """Mean number of parts (...) that are supplied in a cycle."""
        return np.asarray(self.picks.mean + self.lost)


def moves_of(drop: Counts, transitions: Counts) -> Moves:
    """Return the shares behind counts: drops (k,), and actions (k, m) with m - k outcomes."""
    k = len(drop)
    rows = transitions / transitions.sum(axis=1, keepdims=True)
    return Moves(drop / drop.sum(), rows[:, :k], rows[:, k:].sum(axis=1))


def refilled_later(moves: Moves) -> Moves:
    """Return the moves with a further class: places whose part has left the aspects.

    The image after the action shows that the part is missing; its place is empty in this image,
    and is refilled before the next.
    """
    shape = moves.drop.shape[:-1]
    none = np.zeros((*shape, 1))
    rows = np.concatenate([moves.transitions, moves.left[..., None]], axis=-1)
    rows = np.concatenate([rows, np.zeros((*shape, 1, rows.shape[-1]))], axis=-2)
    left = np.concatenate([np.zeros_like(moves.left), none + 1], axis=-1)
    return Moves(np.concatenate([moves.drop, none], axis=-1), rows, left)


def drawn_moves(
    drop: Counts, transitions: Counts, samples: int, generator: np.random.Generator
) -> Moves:
    """Return samples of the moves from the Dirichlet posteriors of the counts.

    The prior is 1 / m for each of the m possible outcomes of a drop or an action; see
    `markov.long_run_bounds`.
    """
    k, columns = transitions.shape
    fallen = np.maximum(generator.standard_gamma(drop + 1 / k, (samples, k)), _MIN_SAMPLE)
    rows = generator.standard_gamma(transitions + 1 / columns, (samples, k, columns))
    rows = np.maximum(rows, _MIN_SAMPLE)
    rows /= rows.sum(axis=-1, keepdims=True)
    fallen /= fallen.sum(axis=-1, keepdims=True)
    return Moves(fallen, rows[..., :k], rows[..., k:].sum(axis=-1))


def recurrent(moves: Moves, pickable: Mask) -> tuple[Array, Mask]:
    """Return in which aspects the parts on the tray are in the long run, and which are traps.

    Parameters
    ----------
    moves : Moves
        Without further axes.
    pickable : (k,) bool

    Returns
    -------
    shares : (k,) float
        Shares of the aspects if half of the pickable parts were free.
    trapped : (k,) bool
        Aspects from which the action brings no part into a pickable one. If there are any, the
        tray fills with parts in these aspects.
    """
    found = long_run(
        _chain(moves, np.where(pickable, 0.5, 0.0)), np.zeros(len(pickable)), moves.drop
    )
    trapped = np.zeros_like(pickable)
    for members, weight in zip(found.closed, found.weights, strict=True):
        trapped[list(members)] = weight > 0 and not pickable[list(members)].any()
    return found.shares, trapped


def steady_state(
    moves: Moves, free: Array, number: int | Array | Counts, max_picks: int | None = None
) -> SteadyState:
    """Return the fixed point of the mix on the tray.

    If the robot picks a limited number of parts, each wanted free part is picked with the same
    probability g, for which N g share = E[min(binomial, max_picks)]. This is exact but for
    correlations between the parts of order 1 / N.

    Parameters
    ----------
    moves : Moves
        The chain with the picks must have a single closed class of all aspects; see `recurrent`.
    free : (..., k) float
        Probability that a part is free; 0 for aspects that are not wanted.
    number : int or array (...)
        Parts on the tray.
    """
    shape = np.broadcast_shapes(free.shape, moves.drop.shape)
    free = np.broadcast_to(free, shape)
    g = np.ones(shape[:-1])
    mix = stationary_shares(_chain(moves, free))
    found = picks(number, (mix * free).sum(axis=-1), max_picks)
    if max_picks is not None and (max_picks < np.asarray(number)).any():
        low = np.zeros_like(g)
        for _ in range(HALVINGS):
            middle = (low + g) / 2
            mix = stationary_shares(_chain(moves, middle[..., None] * free))
            share = (mix * free).sum(axis=-1)
            found = picks(number, share, max_picks)
            too_many = number * middle * share > found.mean
            low, g = np.where(too_many, low, middle), np.where(too_many, middle, g)
    taken = g[..., None] * free
    lost = number * (mix * (1 - taken) * moves.left).sum(axis=-1)
    return SteadyState(mix, taken, found, np.asarray(lost))


@dataclass(frozen=True)
class RunSpread:
    """How the number of picks of a run differs from the long-run rate times its duration.

    start : float
        Mean difference, because the run begins with an empty tray: the first image follows the
        supply of all parts, which have the shares of dropped ones.
    variance : float
        Variance per minute, 1/min.
    """

    start: float
    variance: float


def run_spread(
    moves: Moves, state: SteadyState, number: int, times: CycleTimes, clustering: float = 0.0
) -> RunSpread:
    """Return the mean and the variance that runs add; only for moves without further axes.

    The variance in a run of m minutes is m times the value (central limit theorem of renewal
    reward processes): it is that of picks - rate x duration over many cycles, divided by the mean
    duration. The places on the tray are chains, whose asymptotic variance follows from Poisson's
    equation. They are independent but for the clustering (see FreeShares), which in each cycle
    changes the chance of all picks alike. Cycles without a pick, which have no overlap, are a
    linear function of the picks with an independent rest.
    """
    found = state.picks
    duration = float(cycle_time(times, found, state.supplied)) / 60
    mean, none = float(found.mean), float(found.none)
    if mean < NO_PICKS or duration <= 0:
        return RunSpread(0.0, 0.0)
    rate = mean / duration
    share = mean / number
    binomial = number * share * (1 - share)
    variance = float(found.variance)
    slope = mean * none / variance if variance > 0 else 0.0
    rest = max(none * (1 - none) - slope**2 * variance, 0.0)
    per_pick = 1 - rate * (times.robot + times.supply - times.overlap * slope) / 60
    per_loss = -rate * times.supply / 60
    value = _values(moves, state, per_pick, per_loss)
    of_place = _asymptotic_variance(moves, state, value, per_pick, per_loss)
    # What it changes that a part is picked, and not moved.
    dropped = float(moves.drop @ value)
    kept = moves.transitions @ value + moves.left * (per_loss + dropped)
    gain = float(state.mix @ (state.taken * (per_pick + dropped - kept)))
    common = clustering * number * (number - 1) * gain**2
    limited = variance / binomial if binomial > 0 else 1.0
    total = (number * of_place + common) * limited + (rate * times.overlap / 60) ** 2 * rest
    first = (times.settle + times.image + number * times.supply) / 60
    return RunSpread(number * dropped - rate * first, total / duration)


def _values(moves: Moves, state: SteadyState, pick: float, loss: float) -> Array:
    """Return the value (k,) of each aspect in an image, by Poisson's equation.

    ``pick`` is the reward of a pick and ``loss`` that of a part that leaves the aspects.
    """
    x, taken = state.mix, state.taken
    expected = taken * pick + (1 - taken) * moves.left * loss
    chain = _chain(moves, taken)
    # h = expected - mean + chain h, with x h = 0.
    return np.asarray(np.linalg.solve(np.eye(len(x)) - chain + x, expected - x @ expected))


def _asymptotic_variance(
    moves: Moves, state: SteadyState, h: Array, pick: float, loss: float
) -> float:
    """Return the variance per cycle of the sum of the rewards of one place on the tray."""
    x, taken = state.mix, state.taken
    lost = (1 - taken) * moves.left
    mean = x @ (taken * pick + lost * loss)
    square = taken * (moves.drop @ (pick - mean + h) ** 2)
    square += lost * (moves.drop @ (loss - mean + h) ** 2)
    square += (1 - taken) * (moves.transitions @ (h - mean) ** 2)
    return float(x @ (square - h**2))


def _chain(moves: Moves, taken: Array) -> Array:
    """Return the transitions (..., k, k) of one place on the tray in a cycle."""
    drop = moves.drop[..., None, :]
    replaced = moves.transitions + moves.left[..., None] * drop
    return np.asarray(taken[..., None] * drop + (1 - taken[..., None]) * replaced)
