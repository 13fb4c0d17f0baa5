"""The long run of a feeder: the mix of aspects on the tray, and what the robot picks of it."""

import dataclasses
import math
from dataclasses import dataclass

import numpy as np
from scipy.special import betainc

from resting_aspects_ros.arrays import Array, Counts
from resting_aspects_ros.errors import InvalidValueError, shown
from resting_aspects_ros.statistics.markov import Mask, drawn_rows, long_run, stationary_shares

# -- A cycle --------------------------------------------------------------------------------------


MAX_TIME = 3600.0
# What each time belongs to, for the question what limits the rate.
RESOURCES = {
    'robot': ('robot', 'place'),
    'feeder': ('vibrate', 'settle', 'supply'),
    'vision': ('image',),
}


@dataclass(frozen=True)
class CycleTimes:
    """Times of a cycle, s.

    robot : float
        From one pick of the robot to the next; more than 0.
    vibrate, settle, image : float
        Vibration; until the parts are at rest; image with its evaluation.
    supply : float
        For each supplied part.
    place : float
        With overlap: how long of ``robot`` the robot is away from the tray after it has lifted the
        last part of a cycle. The next vibration, settling and image run in this time. 0: they
        begin when the robot is done.
    """

    robot: float
    vibrate: float
    settle: float
    image: float
    supply: float = 0.0
    place: float = 0.0

    def __post_init__(self) -> None:
        for name, value in dataclasses.asdict(self).items():
            number = isinstance(value, int | float) and not isinstance(value, bool)
            if not (number and 0 <= value <= MAX_TIME) or (name == 'robot' and value == 0):
                least = 'more than 0' if name == 'robot' else '0 or more'
                raise InvalidValueError(
                    f'invalid {name} time {shown(value)} s: expected {least}, '
                    f'at most {MAX_TIME:g} s'
                )
        if self.place > self.robot:
            raise InvalidValueError(
                f'invalid place time {self.place:g} s: expected at most the robot time, '
                f'{self.robot:g} s'
            )

    @property
    def feeder(self) -> float:
        """Time of vibration, settling and image, s."""
        return self.vibrate + self.settle + self.image

    @property
    def overlap(self) -> float:
        """Time that a cycle with a pick is shorter because the feeder and the robot overlap, s."""
        return min(self.place, self.feeder)

    def scaled(self, name: str, factor: float) -> 'CycleTimes':
        """Return the times with a resource or a single time multiplied by a factor."""
        scaled = {
            each: min(factor * getattr(self, each), MAX_TIME)
            for each in RESOURCES.get(name, (name,))
        }
        return dataclasses.replace(self, **scaled)


@dataclass(frozen=True, eq=False)
class Picks:
    """Mean, variance, and probability of 0, of the number of picks in a cycle."""

    mean: Array
    variance: Array
    none: Array


def picks(number: int | Array | Counts, share: Array, max_picks: int | None = None) -> Picks:
    """Return the picks of a cycle, if each of the parts can be picked independently.

    The number of parts that can be picked is binomial, with the probability ``share`` that a part
    is wanted and free; the robot picks at most ``max_picks``.
    """
    n, p = np.broadcast_arrays(np.asarray(number, dtype=np.float64), share)
    none = (1 - p) ** n
    if max_picks is None or max_picks >= n.max(initial=0):
        return Picks(n * p, n * p * (1 - p), none)
    mean, square = np.zeros_like(p), np.zeros_like(p)
    for k in range(1, max_picks + 1):
        # Probability of k or more.
        tail = np.where(k <= n, betainc(k, np.maximum(n - k + 1, 1), p), 0.0)
        mean += tail
        square += (2 * k - 1) * tail
    return Picks(mean, square - mean**2, none)


def cycle_time(times: CycleTimes, found: Picks, supplied: Array) -> Array:
    """Return the mean duration of a cycle, s.

    It is vibrate + settle + image + robot E[picks] + supply E[supplied parts], less the overlap in
    cycles with a pick: min(place, vibrate + settle + image).
    """
    return np.asarray(
        times.feeder
        + times.robot * found.mean
        + times.supply * supplied
        - times.overlap * (1 - found.none)
    )


def parts_per_minute(times: CycleTimes, found: Picks, supplied: Array) -> Array:
    """Return 60 E[picks] / E[duration of a cycle], the long-run rate (renewal reward theorem)."""
    duration = cycle_time(times, found, supplied)
    return np.asarray(60 * found.mean / np.maximum(duration, math.ulp(0.0)))


def time_shares(times: CycleTimes, found: Picks, supplied: Array) -> dict[str, float]:
    """Return the share of a mean cycle of each time; overlapping time counts as the feeder's."""
    spent = {
        'vibrate': times.vibrate,
        'settle': times.settle,
        'image': times.image,
        'supply': times.supply * float(supplied),
        'robot': times.robot * float(found.mean) - times.overlap * (1 - float(found.none)),
    }
    total = sum(spent.values())
    return {name: value / total if total else 0.0 for name, value in spent.items()}


def sensitivity(
    times: CycleTimes, found: Picks, supplied: Array
) -> dict[str, tuple[float, float]]:
    """Return how the rate changes, as a share, if each time is shorter and longer by 10 %.

    The place time changes with the robot time.
    """
    base = float(parts_per_minute(times, found, supplied))

    def relative(name: str, factor: float) -> float:
        changed = parts_per_minute(times.scaled(name, factor), found, supplied)
        return float(changed) / base - 1 if base else 0.0

    names = ('robot', 'vibrate', 'settle', 'image', 'supply')
    return {name: (relative(name, 0.9), relative(name, 1.1)) for name in names}


def limited_by(times: CycleTimes, found: Picks, supplied: Array) -> str | None:
    """Return the resource of RESOURCES whose time raises the rate most if it is 10 % shorter.

    It is None if nothing can be picked.
    """
    rates = {
        name: float(parts_per_minute(times.scaled(name, 0.9), found, supplied))
        for name in RESOURCES
    }
    return max(rates, key=lambda name: rates[name]) if any(rates.values()) else None


# -- The long run ---------------------------------------------------------------------------------


# Halvings of the interval of the share of wanted free parts that is picked.
HALVINGS = 20
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
    """Return samples of the moves from the Dirichlet posteriors of the counts."""
    k = len(drop)
    fallen, rows = (drawn_rows(counts, generator, samples) for counts in (drop, transitions))
    return Moves(fallen, rows[..., :k], rows[..., k:].sum(axis=-1))


def recurrent(moves: Moves, pickable: Mask) -> tuple[Array, Mask]:
    """Return in which aspects the parts on the tray are in the long run, and which are traps.

    Returns the shares (k,) of the aspects if half of the pickable parts were free, and the aspects
    (k,) from which the action brings no part into a pickable one. If there are any, the tray fills
    with parts in these aspects.
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
    value = place_values(moves, state, per_pick, per_loss)
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


def place_values(moves: Moves, state: SteadyState, pick: float, loss: float) -> Array:
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
