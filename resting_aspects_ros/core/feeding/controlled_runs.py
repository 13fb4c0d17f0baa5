"""Forecast of the parts per minute of runs in which a controller decides, by simulation.

The cycle of `forecast` flips all parts after each image. `decision.advise` decides after each
image instead, so its rate follows from no formula: runs are simulated from an empty tray, with
parts at places without overlap. The uncertainty of the drops and flips is that of the formula.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from resting_aspects_ros.core.errors import InvalidValueError, shown
from resting_aspects_ros.core.feeding.baselines import Controller
from resting_aspects_ros.core.feeding.controller_model import ControllerModel
from resting_aspects_ros.core.feeding.cycle import cycle_time
from resting_aspects_ros.core.feeding.decision import advise
from resting_aspects_ros.core.feeding.forecast import (
    DRAWS,
    MAX_MINUTES,
    RUNS,
    drawn_rates,
)
from resting_aspects_ros.core.feeding.model import SteadyStates
from resting_aspects_ros.core.feeding.steady_state import drawn_moves
from resting_aspects_ros.core.feeding.tray_places import Places
from resting_aspects_ros.core.feeding.tray_simulation import simulate
from resting_aspects_ros.core.statistics.intervals import CONFIDENCE, check_confidence

# Simulated runs, and how many cycles of the forecast each lasts if the requested run is longer.
SIMULATED, CYCLES = 32, 60
# Share of a simulated run after which the tray counts as filled and mixed.
WARM_UP = 0.25


@dataclass(frozen=True, eq=False)
class ControlledRuns:
    """Parts per minute of a feeder with a controller.

    rate, lower, upper : float
        In the long run, with the interval that follows from the counts and the simulation.
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
    if not (isinstance(minutes, int | float) and 0 < minutes <= MAX_MINUTES):
        raise InvalidValueError(
            f'invalid minutes {shown(minutes)}: expected more than 0 and at most {MAX_MINUTES:g}'
        )
    feeder, number = model.feeder, model.best_number
    state = SteadyStates(feeder).at(model.table, number)
    cycle = float(cycle_time(feeder.times, state.picks, state.supplied)) / 60
    length = min(float(minutes), CYCLES * cycle)
    generator = np.random.default_rng(seed)
    decide = controller or partial(advise, model=model)
    found = [
        simulate(
            decide,
            model,
            60 * length,
            each,
            positions=True,
            places=None if places is None else places(each),
        ).picked
        for each in generator.spawn(SIMULATED)
    ]
    counts = np.array(
        [np.searchsorted(run, [60 * WARM_UP * length, 60 * length]) for run in found]
    )
    steady = (1 - WARM_UP) * length
    later = counts[:, 1] - counts[:, 0]
    rate, variance = later.mean() / steady, later.var(ddof=1) / steady
    error = variance / (steady * SIMULATED)
    expected = (counts[:, 1].mean() + rate * (minutes - length)) / minutes
    drawn = drawn_moves(feeder.drop, feeder.transitions, DRAWS, generator)
    rates = drawn_rates(feeder, drawn, model.table, number)
    relative = (rates / rates.mean() if rates.any() else np.ones(DRAWS))[:, None]
    normal = generator.standard_normal((2, DRAWS, RUNS))
    means = rate * relative + math.sqrt(error) * normal[0]
    spread = np.sqrt(variance * relative / minutes + error)
    runs = expected * relative + spread * normal[1]
    tail = (1 - confidence) / 2
    (lower, upper), (low, high) = (
        np.maximum(np.quantile(each, [tail, 1 - tail]), 0.0).tolist() for each in (means, runs)
    )
    return ControlledRuns(float(rate), lower, upper, (low, high), float(minutes))
