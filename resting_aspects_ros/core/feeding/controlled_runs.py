"""Forecast of the parts per minute of runs in which a controller decides, by simulation.

The cycle of `forecast` flips all parts after each image. `decision.advise` decides after each
image instead, so its rate follows from no formula: runs are simulated from an empty tray, with
parts at places without overlap. The true moves of each run are drawn from the posterior of the
drops and flips, so that the runs contain their uncertainty, while the controller knows the counts.
How the rate depends on the moves is a straight line over the rate of the formula, whose draws are
many and fast.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from resting_aspects_ros.core.feeding.baselines import Controller
from resting_aspects_ros.core.feeding.controller_model import ControllerModel
from resting_aspects_ros.core.feeding.cycle import cycle_time, parts_per_minute
from resting_aspects_ros.core.feeding.decision import advise
from resting_aspects_ros.core.feeding.forecast import (
    DRAWS,
    RUNS,
    check_minutes,
    drawn_rates,
)
from resting_aspects_ros.core.feeding.model import SteadyStates
from resting_aspects_ros.core.feeding.steady_state import Moves, drawn_moves
from resting_aspects_ros.core.feeding.tray_places import Places
from resting_aspects_ros.core.feeding.tray_simulation import simulate
from resting_aspects_ros.core.statistics.intervals import (
    CONFIDENCE,
    Array,
    check_confidence,
    containing,
)

# Simulated runs, and how many cycles of the forecast each lasts if the requested run is longer.
SIMULATED, CYCLES = 32, 60
# Share of a simulated run after which the tray counts as filled and mixed.
WARM_UP = 0.25
# Successive parts of the rest of a run, whose variance is that of its cycles.
BATCHES = 3
# Sum of squares of relative rates below which they count as equal.
SAME = 1e-12


@dataclass(frozen=True, eq=False)
class ControlledRuns:
    """Parts per minute of a feeder with a controller.

    rate, lower, upper : float
        In the long run: the rate if the counts were the probabilities, and the interval that
        follows from the counts and the simulation.
    prediction : (float, float)
        Interval of a run of ``minutes``, which begins with an empty tray.
    minutes : float
    """

    rate: float
    lower: float
    upper: float
    prediction: tuple[float, float]
    minutes: float


def forecast_controller(
    model: ControllerModel,
    minutes: float = 60.0,
    *,
    places: Callable[[np.random.Generator], Places] | None = None,
    controller: Controller | None = None,
    confidence: float = CONFIDENCE,
    seed: int = 1,
) -> ControlledRuns:
    """Forecast the parts per minute of a run of ``minutes``; takes 5 to 20 s.

    Parameters
    ----------
    model : ControllerModel
        Known to the controller, and the truth up to the uncertainty of its counts.
    minutes : float
    places : function, optional
        Returns the places of a run; by default the footprints of the model (RandomPlaces).
    controller : function, optional
        By default `advise` with the model.
    confidence : float
    seed : int

    Raises
    ------
    InvalidValueError
        If a value is invalid.
    """
    check_confidence(confidence)
    check_minutes(minutes)
    generator = np.random.default_rng(seed)
    decide = controller or partial(advise, model=model)
    runs = _simulated(model, decide, float(minutes), places, generator)
    rate, slope = runs.line
    of_line, of_moves, of_minute = runs.variances(generator)
    off = runs.relative[:, None] - 1
    noise = generator.standard_normal((2, DRAWS, RUNS))
    means = rate + slope * off + np.sqrt(of_line + of_moves) * noise[0]
    ends = of_line + of_moves + of_minute * np.maximum(1 + off, 0.0) / minutes
    found = rate + slope * off + runs.start / minutes + np.sqrt(ends) * noise[1]
    tail = (1 - confidence) / 2
    (lower, upper), (low, high) = (
        np.maximum(np.quantile(each, [tail, 1 - tail]), 0.0).tolist() for each in (means, found)
    )
    at_counts = max(rate + slope * (runs.point - 1), 0.0)
    lower, upper = (float(each) for each in containing(at_counts, lower, upper))
    return ControlledRuns(at_counts, lower, upper, (low, high), float(minutes))


@dataclass(frozen=True, eq=False)
class SimulatedRuns:
    """Simulated runs, each with other true moves.

    relative : (d,) float
        Rate of each draw of the moves by the formula of the fixed cycle, divided by their mean;
        the first ones are those of the runs.
    point : float
        The same of the counts, as if they were the probabilities.
    batches : (r, BATCHES) float
        Picks per minute of each run in successive parts of ``steady`` minutes.
    start : float
        Mean difference of the picks of a run from rate x duration, because the tray is empty.
    """

    relative: Array
    point: float
    batches: Array
    steady: float
    start: float

    @cached_property
    def line(self) -> tuple[float, float]:
        """Rate where the formula gives the mean of the draws, and its change with ``relative``.

        A controller does not depend on the moves as the fixed cycle does.
        """
        rates, off = self.batches.mean(axis=1), self.relative[: len(self.batches)] - 1
        square = ((off - off.mean()) ** 2).sum()
        slope = (off - off.mean()) @ rates / square if square > SAME else 0.0
        return float(rates.mean() - slope * off.mean()), float(slope)

    def variances(self, generator: np.random.Generator) -> tuple[Array, Array, Array]:
        """Return draws (DRAWS, 1) of the variance of the rate that the line leaves, 1/min^2.

        Of the line itself; of the moves; and of a minute of a run, which decreases with its
        length. That of the moves is the difference of two estimates, whose errors have chi square
        distributions; without draws of them it would often be 0.
        """
        number, batches = len(self.batches), self.batches.shape[1]
        mean, slope = self.line
        rest = self.batches.mean(axis=1) - mean - slope * (self.relative[:number] - 1)
        inside = self.batches - self.batches.mean(axis=1, keepdims=True)
        free, free_inside = number - 2, number * (batches - 1)
        whole = (rest**2).sum() / generator.chisquare(free, (DRAWS, 1))
        minute = (inside**2).sum() / generator.chisquare(free_inside, (DRAWS, 1))
        minute *= self.steady / batches
        return whole / number, np.maximum(whole - minute / self.steady, 0.0), minute


def _simulated(
    model: ControllerModel,
    decide: Controller,
    minutes: float,
    places: Callable[[np.random.Generator], Places] | None,
    generator: np.random.Generator,
) -> SimulatedRuns:
    """Simulate runs of at most ``minutes`` whose true moves are drawn from their posterior."""
    feeder, number = model.feeder, model.best_number
    state = SteadyStates(feeder).at(model.table, number)
    cycle = float(cycle_time(feeder.times, state.picks, state.supplied)) / 60
    length = min(minutes, CYCLES * cycle)
    drawn = drawn_moves(feeder.drop, feeder.transitions, DRAWS, generator)
    rates = drawn_rates(feeder, drawn, model.table, number)
    ends = 60 * length * np.linspace(WARM_UP, 1, BATCHES + 1)
    counts = []
    for k, each in enumerate(generator.spawn(SIMULATED)):
        picked = simulate(
            decide,
            model,
            60 * length,
            each,
            positions=True,
            places=None if places is None else places(each),
            moves=Moves(drawn.drop[k], drawn.transitions[k], drawn.left[k]),
        ).picked
        counts.append(np.searchsorted(picked, ends))
    steady = (1 - WARM_UP) * length
    batches = np.diff(counts, axis=1) / (steady / BATCHES)
    mean = rates.mean()
    at_counts = float(parts_per_minute(feeder.times, state.picks, state.supplied))
    return SimulatedRuns(
        rates / mean if mean > 0 else np.ones(DRAWS),
        at_counts / mean if mean > 0 else 1.0,
        batches,
        steady,
        float(np.array(counts)[:, -1].mean() - batches.mean() * length),
    )
