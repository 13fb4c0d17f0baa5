"""Forecasts of runs with a controller against simulated runs and a closed form."""

import dataclasses
from functools import partial

import numpy as np
import pytest
from feeders import DensityPlaces, density_run, fixed_cycle

from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.feeding import tray_simulation
from resting_aspects_ros.feeding.control import ControllerModel, advise
from resting_aspects_ros.feeding.footprint import Footprint, FreeShares, Tray
from resting_aspects_ros.feeding.forecast import FeederModel
from resting_aspects_ros.feeding.steady_state import CycleTimes, Moves, drawn_moves
from resting_aspects_ros.feeding.tray_simulation import SimulatedRuns, forecast_controller

DROP, FLIPS = np.array([600_000, 400_000]), np.array([[600_000, 350_000, 50_000]] * 2)
FEEDER = FeederModel(
    DROP,
    FLIPS,
    np.array([False, True]),
    [Footprint(0.03, 0.02), Footprint(0.02, 0.01)],
    Tray((0.2, 0.2), 0.005),
    CycleTimes(robot=1.0, vibrate=0.8, settle=0.5, image=0.2, supply=0.1),
)
TABLE = FreeShares(np.full((12, 2), 0.8), False)
MODEL = ControllerModel(FEEDER, TABLE, 8)


@pytest.fixture(autouse=True)
def few_draws(monkeypatch):
    monkeypatch.setattr(tray_simulation, 'DRAWS', 50)


def density(generator):
    return DensityPlaces(MODEL, generator)


def test_rate_of_the_cycle_of_the_forecast_is_that_of_the_formula():
    found = forecast_controller(MODEL, density, controller=fixed_cycle(MODEL))
    expected = FEEDER.rates(TABLE)[7]
    # The interval of the mean contains it in 95 % of cases, so twice its width nearly always.
    assert abs(found.rate - expected) < found.upper - found.lower
    assert found.prediction[0] < found.lower < found.rate < found.upper < found.prediction[1]


def test_line_and_variances_of_runs_are_found():
    """Runs of 4 minutes whose rates are known: see the arguments of the normal numbers."""
    generator, number = np.random.default_rng(2), 3000
    relative = generator.normal(1, 0.1, number)
    of_moves, of_minute = 0.5, 6.0
    rates = 30 + 45 * (relative - 1) + generator.normal(0, np.sqrt(of_moves), number)
    batches = rates[:, None] + generator.normal(0, np.sqrt(3 * of_minute / 4), (number, 3))
    runs = SimulatedRuns(relative, 1.0, batches, 4.0, 0.0)
    whole = of_moves + of_minute / 4
    # Standard errors: of a mean, of a slope, and of variances, sqrt(2 / n) of themselves.
    assert runs.line[0] == pytest.approx(30, abs=4 * np.sqrt(whole / number))
    assert runs.line[1] == pytest.approx(45, abs=4 * np.sqrt(whole / number) / 0.1)
    line, moves, minute = (each.mean() for each in runs.variances(generator))
    assert line == pytest.approx(whole / number, rel=4 * np.sqrt(2 / number))
    assert minute == pytest.approx(of_minute, rel=4 * np.sqrt(2 / (2 * number)))
    assert moves == pytest.approx(of_moves, abs=6 * whole * np.sqrt(2 / number))


@pytest.mark.slow
def test_interval_contains_what_the_counts_leave_open():
    """The true moves of each run are drawn; the controller knows counts of few drops and flips.

    With a limit of picks the fixed cycle depends less on the moves than the controller does.
    """
    feeder = dataclasses.replace(
        FEEDER,
        drop=np.array([60, 40]),
        transitions=np.array([[18, 2, 0], [6, 14, 0]]),
        max_picks=3,
    )
    model, minutes = ControllerModel(feeder, TABLE, 12), 5
    found = forecast_controller(model, lambda each: DensityPlaces(model, each), minutes)
    low, high = found.prediction
    drawn = drawn_moves(feeder.drop, feeder.transitions, 10, np.random.default_rng(5))
    within = 0
    for k in range(10):
        moves = Moves(drawn.drop[k], drawn.transitions[k], drawn.left[k])
        generator = np.random.default_rng(1000 + k)
        decide = partial(advise, model=model)
        picked, _ = density_run(decide, model, 60 * minutes, generator, moves)
        within += low <= np.searchsorted(picked, 60 * minutes) / minutes <= high
    # At least 7 of 10 in 99.9 % of cases, if each is within with 95 %.
    assert within >= 7


@pytest.mark.slow
def test_formula_predicts_runs_of_its_cycle():
    """From an empty tray, with parts that are lost and replaced after the next image."""
    spread, rate = FEEDER.spread(TABLE, 8), FEEDER.rates(TABLE)[7]
    found = [
        density_run(fixed_cycle(MODEL), MODEL, 300, np.random.default_rng(seed))
        for seed in range(60)
    ]
    deviations = np.array([len(picked) - rate * end / 60 for picked, end in found])
    error = np.sqrt(spread.variance * 5 / 60)
    assert abs(deviations.mean() - spread.start) < 4 * error
    # The variance of n normal numbers has a relative standard error of sqrt(2 / (n - 1)).
    assert deviations.var(ddof=1) == pytest.approx(5 * spread.variance, rel=4 * np.sqrt(2 / 59))


def test_invalid_duration_is_refused():
    for minutes in (0, np.nan, 1e9):
        with pytest.raises(InvalidValueError, match='invalid minutes'):
            forecast_controller(MODEL, density, minutes)
