"""Parts per minute of a feeder, from the drops, the action, the tray and the times of a cycle."""

import math
from dataclasses import dataclass

import numpy as np

from resting_aspects_ros.core.errors import InvalidValueError, shown
from resting_aspects_ros.core.feeding.cycle import (
    limited_by,
    parts_per_minute,
    sensitivity,
    time_shares,
)
from resting_aspects_ros.core.feeding.density import (
    FreeShares,
    coverage,
    coverage_limit,
    free_shares,
)
from resting_aspects_ros.core.feeding.model import (
    FeederModel,
    SteadyStates,
    check_number,
    tray_state,
)
from resting_aspects_ros.core.feeding.steady_state import (
    Moves,
    RunSpread,
    SteadyState,
    drawn_moves,
)
from resting_aspects_ros.core.reorientation.markov import Mask
from resting_aspects_ros.core.statistics.intervals import (
    CONFIDENCE,
    Array,
    Counts,
    check_confidence,
    containing,
)

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
        Parts on the tray; best_number has the highest rate, None if no part can be picked.
    at_limit : bool
        Whether best_number is only the largest number for which the model holds.
    rate, lower, upper : float
        Parts per minute in the long run, with the interval that follows from the counts.
    prediction : (float, float)
        Interval of the parts per minute of a run of ``minutes``.
    variance : float
        Variance of the number of parts per minute of a run, 1/min.
    state : SteadyState
        By aspect or class, for the point estimate.
    coverage : float
        Share of the tray that the parts cover.
    time_shares, sensitivity : dict
        See `cycle.time_shares` and `cycle.sensitivity`.
    limited_by : str or None
    free : (k,) float
        Probability that a part of each aspect is free.
    trapped : (k,) bool
        Aspects from which no part gets into a pickable one; not empty if the rate is 0.
    """

    number: int
    best_number: int | None
    at_limit: bool
    rate: float
    lower: float
    upper: float
    prediction: tuple[float, float]
    minutes: float
    variance: float
    state: SteadyState
    coverage: float
    time_shares: dict[str, float]
    sensitivity: dict[str, tuple[float, float]]
    limited_by: str | None
    curve: Curve
    free: Array
    trapped: Mask

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
    states = SteadyStates(model)
    table, rates = _table(model, states, number, seed)
    limit = coverage_limit(model.tray, model.footprints, model.drop / model.drop.sum())
    best = int(rates[:limit].argmax()) + 1 if rates.any() else None
    numbers = np.arange(1, len(rates) + 1)
    # If nothing can be picked, the number with most free parts.
    chosen = number or best or int((states.free(table) * numbers).argmax()) + 1
    state = states.at(table, chosen)
    spread = states.spread(table, chosen)
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
    return Forecast(
        number=chosen,
        best_number=best,
        at_limit=best is not None and 1 < best == min(limit, len(rates)),
        rate=rate,
        lower=float(lower[here]),
        upper=float(upper[here]),
        prediction=(float(low), float(high)),
        minutes=float(minutes),
        variance=spread.variance,
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
            empty_cycles=np.array([float(states.at(table, n).picks.none) for n in points]),
            free=states.free(table)[points - 1],
        ),
        free=table.at(chosen),
        trapped=states.trapped,
    )


def _table(
    model: FeederModel, states: SteadyStates, number: int | None, seed: int
) -> tuple[FreeShares, Array]:
    """Return the shares of free parts for the mix on the tray, and the rates (n,)."""

    def with_mix(mix: Array) -> tuple[FreeShares, Array]:
        table = free_shares(model.tray, model.footprints, mix, seed, number or 0)
        return table, states.rates(table)

    mix = model.drop / model.drop.sum()
    table, rates = with_mix(mix)
    at = min(number or int(rates.argmax()) + 1, len(rates))
    found = states.at(table, at).mix
    if len(set(model.footprints)) == 1 or np.abs(found - mix).max() < MIX_CHANGE:
        return table, rates
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
