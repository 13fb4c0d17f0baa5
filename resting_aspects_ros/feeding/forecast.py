"""Parts per minute of a feeder, from the drops, the action, the tray and the times of a cycle."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from resting_aspects_ros.arrays import Array, Counts
from resting_aspects_ros.errors import InvalidValueError, shown
from resting_aspects_ros.feeding.footprint import (
    Footprint,
    FreeShares,
    Tray,
    coverage,
    coverage_limit,
    free_shares,
)
from resting_aspects_ros.feeding.steady_state import (
    CycleTimes,
    Moves,
    RunSpread,
    SteadyState,
    drawn_moves,
    limited_by,
    moves_of,
    parts_per_minute,
    picks,
    recurrent,
    refilled_later,
    run_spread,
    sensitivity,
    steady_state,
    time_shares,
)
from resting_aspects_ros.statistics.intervals import CONFIDENCE, check_confidence, containing
from resting_aspects_ros.statistics.markov import Mask

# -- The model ------------------------------------------------------------------------------------


_HARDLY = 1e-12


@dataclass(frozen=True, eq=False)
class FeederModel:
    """Everything that a forecast depends on, over k aspects or symmetry classes.

    drop : (k,) int
        Dropped parts at rest in each.
    transitions : (k, m) int
        Counts of the action from each to each, and in m - k columns to none of them.
    pickable : (k,) bool
    footprints : sequence of k Footprint
    tray : Tray
    times : CycleTimes
    max_picks : int or None
        Maximum number of picks after one image.
    """

    drop: Counts
    transitions: Counts
    pickable: Mask
    footprints: Sequence[Footprint]
    tray: Tray
    times: CycleTimes
    max_picks: int | None = None

    def __post_init__(self) -> None:
        if not self.pickable.any():
            raise InvalidValueError('invalid pickable aspects: expected at least one')
        if not self.drop.any() or not (self.transitions.sum(axis=1) > 0).all():
            raise InvalidValueError(
                'invalid counts: expected drops that come to rest in an aspect, and actions from '
                'each aspect'
            )
        if self.max_picks is not None:
            check_number('maximum number of picks', self.max_picks)

    @cached_property
    def moves(self) -> Moves:
        """Shares of the drops and of the action, if the counts were the probabilities."""
        return moves_of(self.drop, self.transitions)

    @cached_property
    def _recurrent(self) -> tuple[Array, Mask]:
        return recurrent(self.moves, self.pickable)

    @property
    def trapped(self) -> Mask:
        """Aspects (k,) in which parts collect, as the action brings none into a pickable one.

        If there are any, the tray fills with these parts, and none is picked in the long run.
        """
        return self._recurrent[1]

    @property
    def _occupied(self) -> Mask:
        """Aspects (k,) in which parts are in the long run."""
        return self._recurrent[0] > 0

    @property
    def _inside(self) -> Moves:
        """Moves between the aspects that are occupied."""
        m, here = self.moves, self._occupied
        return Moves(m.drop[here], m.transitions[np.ix_(here, here)], m.left[here])

    def state(self, table: FreeShares, number: int) -> SteadyState:
        """Return the long run with a number of parts on the tray.

        Raises InvalidValueError if the number of parts does not fit.
        """
        found = self._state(table, number)
        here = self._occupied
        mix, taken = np.zeros((2, len(here)))
        mix[here] = found.mix[:-1] / found.mix[:-1].sum()
        taken[here] = found.taken[:-1]
        return SteadyState(mix, taken, found.picks, found.lost)

    def spread(self, table: FreeShares, number: int) -> RunSpread:
        """Return how the number of picks of runs differs from that of the long run."""
        near = 0.0 if table.clustering is None else float(table.clustering[number - 1])
        moves = refilled_later(self._inside)
        return run_spread(moves, self._state(table, number), number, self.times, near)

    def rates(self, table: FreeShares) -> Array:
        """Return the parts per minute (n,) for each number of parts of a table."""
        found = self._state(table, np.arange(1, len(table.free) + 1))
        return parts_per_minute(self.times, found.picks, found.supplied)

    def free(self, table: FreeShares) -> Array:
        """Return the share (n,) of the pickable parts of a drop that are free."""
        weight = np.where(self.pickable, self.moves.drop, 0.0)
        weight = weight if weight.any() else self.pickable.astype(np.float64)
        return np.asarray(table.free @ weight / weight.sum())

    def _state(self, table: FreeShares, number: int | Counts) -> SteadyState:
        """Return the steady state over the aspects that are occupied in the long run.

        The last class is that of missing parts. For several numbers of parts (n,), its arrays have
        a leading axis.
        """
        shares, trapped = self._recurrent
        if trapped.any():
            shape = np.shape(table.at(number))[:-1]
            mix = np.append(shares[self._occupied], 0.0)
            mix = np.broadcast_to(mix, (*shape, len(mix)))
            none = picks(number, np.zeros(shape))
            return SteadyState(mix, np.zeros_like(mix), none, np.zeros(shape))
        occupied = self._occupied
        return tray_state(self._inside, table, self.pickable, occupied, number, self.max_picks)


def tray_state(
    moves: Moves,
    table: FreeShares,
    pickable: Mask,
    which: Mask,
    number: int | Counts,
    max_picks: int | None,
) -> SteadyState:
    """Return the steady state with a last class of missing parts; see `refilled_later`.

    Parameters
    ----------
    moves : Moves
        Of the aspects ``which`` (k,) of the table.
    number : int or (n,) int
        Parts on the tray after it is refilled. As some are missing in an image, the others are
        free with the share of their mean number.
    """
    places = refilled_later(moves)

    def state(shares: Array) -> SteadyState:
        # Where no part is ever free, the mix is that of a tray whose parts are hardly ever picked,
        # and where all are, that of one whose parts are hardly ever left.
        free = np.where(pickable, np.clip(shares, _HARDLY, 1 - _HARDLY), 0.0)[..., which]
        free = np.concatenate([free, np.zeros((*free.shape[:-1], 1))], axis=-1)
        return steady_state(places, free, number, max_picks)

    found = state(table.at(number))
    missing = found.mix[..., -1]
    return state(table.between(number * (1 - missing))) if missing.any() else found


def check_number(name: str, value: object) -> None:
    """Raise InvalidValueError unless the value is an integer of at least 1."""
    if isinstance(value, bool) or not isinstance(value, int) or value < 1:
        raise InvalidValueError(f'invalid {name} {shown(value)}: expected 1 or more')


# -- Assumptions that do not hold -----------------------------------------------------------------


# Each assumption that is broken is another chain of the places on the tray, whose long run follows
# as that of the forecast does. The shares are examples of what is common, not measurements of a
# machine.

# Share of the parts that a vibration leaves where they are.
STAYING = 0.8
# Share of the supplied parts that another one of the same clump blocks in the first image.
CLUMPED = 0.25
# Share of the free parts that vision misses, and of the picks that fail.
MISSED, FAILED = 0.02, 0.03


@dataclass(frozen=True)
class BrokenAssumption:
    """An assumption that does not hold.

    text : str
        What happens instead.
    rate : float
        Parts per minute with the same counts.
    change : float
        Relative to the forecast, such as -0.05.
    """

    text: str
    rate: float
    change: float


def places_rate(
    model: FeederModel, number: int, free: Array, staying: float = 0.0, clumped: float = 0.0
) -> float:
    """Return the parts per minute with k aspects, all of which are occupied in the long run.

    free : (k,) float
        Probability that a part of each aspect is free.
    staying : float
        Share of the parts that stay where they are in a vibration. A part stays free or blocked
        if it and its neighbour stay, hence with the square of this probability.
    clumped : float
        Share of supplied parts that are blocked in the first image, in addition.
    """
    moves, k, kept = model.moves, len(free), staying**2
    fresh = np.stack([free, 1 - free])  # free and blocked, after a vibration
    first = np.stack([free * (1 - clumped), 1 - free * (1 - clumped)])
    stays = kept * np.eye(2)[:, None, :, None] + (1 - kept) * fresh
    rows = (moves.transitions[:, None] * stays).reshape(2 * k, 2 * k)
    drop, left = (moves.drop * first).ravel(), np.tile(moves.left, 2)
    wanted = np.concatenate([model.pickable.astype(np.float64), np.zeros(k)])
    reached = drop > 0
    for _ in rows:
        reached = reached | (rows[reached].sum(axis=0) > 0)
    inside = Moves(drop[reached], rows[np.ix_(reached, reached)], left[reached])
    picked = np.append(np.minimum(wanted[reached], 1 - _HARDLY), 0.0)
    state = steady_state(refilled_later(inside), picked, number, model.max_picks)
    return float(parts_per_minute(model.times, state.picks, state.supplied))


def broken_assumptions(
    model: FeederModel, number: int, free: Array, overlapping: Array
) -> tuple[BrokenAssumption, ...]:
    """Return the rate with each assumption broken by itself; empty if no part is picked.

    free : (k,) float
        Shares of free parts.
    overlapping : (k,) float
        The same, if parts that fall on others are not separated.
    """
    base = places_rate(model, number, free)
    if base <= 0:
        return ()
    # A pick that fails takes as long as one that does not.
    failing = replace(model, times=replace(model.times, robot=model.times.robot / (1 - FAILED)))
    seen = free * (1 - MISSED) * (1 - FAILED)
    staying, clumped, missed, failed = (
        f'{100 * share:g} %' for share in (STAYING, CLUMPED, MISSED, FAILED)
    )
    rates = {
        f'{staying} of the parts stay in place': places_rate(model, number, free, STAYING),
        f'{clumped} fall in clumps': places_rate(model, number, free, clumped=CLUMPED),
        f'{missed} missed, {failed} of picks fail': places_rate(failing, number, seen),
        'overlaps do not separate': places_rate(model, number, overlapping),
    }
    return tuple(BrokenAssumption(text, rate, rate / base - 1) for text, rate in rates.items())


# -- Forecast -------------------------------------------------------------------------------------


DRAWS = 200
# Random runs for each draw, for the prediction interval.
RUNS = 50
POINTS = 20  # of the curve
# The shares of free parts are found again if the mix on the tray differs by more.
MIX_CHANGE = 0.05
MAX_MINUTES = 1e6


@dataclass(frozen=True, eq=False)
class Curve:
    """The forecast for several numbers of parts on the tray, ascending; all arrays are (n,).

    Rates are parts per minute, with the interval of the long-run mean; ``empty_cycles`` is the
    share of the cycles without a pick, and ``free`` that of the pickable parts that are free.
    """

    number: Counts
    rate: Array
    lower: Array
    upper: Array
    empty_cycles: Array
    free: Array


@dataclass(frozen=True, eq=False)
class Forecast:
    """The long run of a feeder with a number of parts on the tray.

    number, best_number : int
        Parts on the tray; best_number has the highest rate if half of the overlaps separate, None
        if no part can be picked.
    at_limit : bool
        Whether best_number is only the largest number for which the model holds.
    rate, lower, upper : float
        Parts per minute in the long run, with the interval that follows from the counts.
    prediction : (float, float)
        Interval of the parts per minute of a run of ``minutes``.
    state : SteadyState
        By aspect or class, for the point estimate.
    coverage : float
        Share of the tray that the parts cover.
    time_shares, sensitivity : dict
        See `steady_state.time_shares` and `steady_state.sensitivity`.
    limited_by : str or None
    free : (k,) float
        Probability that a part of each aspect is free.
    trapped : (k,) bool
        Aspects from which no part gets into a pickable one; not empty if the rate is 0.
    broken : tuple of BrokenAssumption
        The same counts, with each assumption broken by itself; empty if the rate is 0.
    """

    number: int
    best_number: int | None
    at_limit: bool
    rate: float
    lower: float
    upper: float
    prediction: tuple[float, float]
    minutes: float
    state: SteadyState
    coverage: float
    time_shares: dict[str, float]
    sensitivity: dict[str, tuple[float, float]]
    limited_by: str | None
    curve: Curve
    free: Array
    trapped: Mask
    broken: tuple[BrokenAssumption, ...] = ()

    @property
    def wide(self) -> tuple[float, float]:
        """Range of the long-run rate: all assumptions may be broken together, or none."""
        return self.lower * math.prod(1 + each.change for each in self.broken), self.upper

    @property
    def flips_per_part(self) -> float:
        """Mean number of flips of a part from its supply until it is picked; infinite if never."""
        mean = float(self.state.picks.mean)
        return (self.number - mean) / mean if mean > 0 else math.inf


def check_minutes(minutes: float) -> None:
    """Raise InvalidValueError unless the duration of a run is within its limits."""
    if not (isinstance(minutes, int | float) and 0 < minutes <= MAX_MINUTES):
        raise InvalidValueError(
            f'invalid minutes {shown(minutes)}: expected more than 0 and at most {MAX_MINUTES:g}'
        )


def forecast(
    model: FeederModel,
    number: int | None = None,
    *,
    minutes: float = 60.0,
    confidence: float = CONFIDENCE,
    seed: int = 1,
) -> Forecast:
    """Forecast the parts per minute with a number of parts on the tray, by default the best one.

    The interval of the mean has the quantiles of rates of draws from the posteriors of the drops
    and of the transitions. The prediction interval has those of runs of ``minutes`` that begin
    with an empty tray, each with one of these draws.

    Raises
    ------
    InvalidValueError
        If a value is invalid, or if the number of parts does not fit on the tray.
    """
    check_confidence(confidence)
    if number is not None:
        check_number('number of parts on the tray', number)
    check_minutes(minutes)
    table, rates, mix = _table(model, number, seed)
    overlapping = free_shares(model.tray, model.footprints, mix, seed, len(rates), separated=False)
    limit = coverage_limit(model.tray, model.footprints, model.drop / model.drop.sum())
    # Overlaps separate in the model, and not at all in the other one: the truth is between them.
    both = rates + model.rates(overlapping)[: len(rates)]
    best = int(both[:limit].argmax()) + 1 if rates.any() else None
    numbers = np.arange(1, len(rates) + 1)
    # If nothing can be picked, the number with most free parts.
    chosen = number or best or int((model.free(table) * numbers).argmax()) + 1
    state = model.state(table, chosen)
    spread = model.spread(table, chosen)
    generator = np.random.default_rng(seed)
    drawn = drawn_moves(model.drop, model.transitions, DRAWS, generator)
    tail = (1 - confidence) / 2
    points = _points(len(rates), chosen, best or chosen)
    draws = np.array([drawn_rates(model, drawn, table, n) for n in points])
    shown_rates = rates[points - 1]
    lower, upper = containing(shown_rates, *np.quantile(draws, [tail, 1 - tail], axis=1))
    here = int(np.flatnonzero(points == chosen)[0])
    rate = float(rates[chosen - 1])
    runs = _runs(draws[here], spread, rate, model.times.feeder, minutes, generator)
    low, high = np.quantile(runs, [tail, 1 - tail])
    cycle = model.times, state.picks, state.supplied
    # Parts that are lost are missing in the image.
    present = np.array(chosen - float(state.lost))
    shares = table.between(present), overlapping.between(present)
    return Forecast(
        number=chosen,
        best_number=best,
        at_limit=best is not None and 1 < best == min(limit, len(rates)),
        rate=rate,
        lower=float(lower[here]),
        upper=float(upper[here]),
        prediction=(float(low), float(high)),
        minutes=float(minutes),
        state=state,
        coverage=coverage(model.tray, model.footprints, state.mix, chosen),
        time_shares=time_shares(*cycle),
        sensitivity=sensitivity(*cycle),
        limited_by=limited_by(*cycle),
        curve=Curve(
            number=points,
            rate=shown_rates,
            lower=lower,
            upper=upper,
            empty_cycles=np.array([float(model.state(table, n).picks.none) for n in points]),
            free=model.free(table)[points - 1],
        ),
        free=table.at(chosen),
        trapped=model.trapped,
        broken=broken_assumptions(model, chosen, *shares) if rate > 0 else (),
    )


def _table(model: FeederModel, number: int | None, seed: int) -> tuple[FreeShares, Array, Array]:
    """Return the shares of free parts for the mix on the tray, the rates (n,), and the mix."""

    def with_mix(mix: Array) -> tuple[FreeShares, Array, Array]:
        table = free_shares(model.tray, model.footprints, mix, seed, number or 0)
        return table, model.rates(table), mix

    mix = model.drop / model.drop.sum()
    table, rates, _ = with_mix(mix)
    at = min(number or int(rates.argmax()) + 1, len(rates))
    found = model.state(table, at).mix
    if len(set(model.footprints)) == 1 or np.abs(found - mix).max() < MIX_CHANGE:
        return table, rates, mix
    return with_mix(found)


def _points(last: int, *needed: int) -> Counts:
    """Return the numbers of parts of the curve, ascending, with those that are needed."""
    halves = (np.linspace(1, last, POINTS // 2), np.geomspace(1, last, POINTS // 2))
    return np.unique(np.concatenate([*halves, needed]).round().astype(np.int64))


def drawn_rates(model: FeederModel, drawn: Moves, table: FreeShares, number: int) -> Array:
    """Return the parts per minute (d,) of each of the drawn moves."""
    if not table.at(number)[model.pickable].any():
        return np.zeros(len(drawn.drop))
    every = np.ones_like(model.pickable)
    found = tray_state(drawn, table, model.pickable, every, number, model.max_picks)
    return parts_per_minute(model.times, found.picks, found.supplied)


def _runs(
    rates: Array,
    spread: RunSpread,
    rate: float,
    feeder: float,
    minutes: float,
    generator: np.random.Generator,
) -> Array:
    """Return parts per minute of random runs (d, r), of which r have each of the rates (d,).

    ``spread`` is that of the point estimate; it is assumed to be proportional to the rate.
    A run ends anywhere in a cycle, so that up to the picks of ``feeder``, s, are missing.
    """
    relative = (rates / rate if rate else np.zeros_like(rates))[:, None]
    deviation = generator.standard_normal((len(rates), RUNS))
    start = spread.start * relative / minutes
    end = rates[:, None] * feeder / 60 / minutes * generator.random(deviation.shape)
    runs = start + np.sqrt(spread.variance * relative / minutes) * deviation
    return np.maximum(rates[:, None] + runs - end, 0.0)
