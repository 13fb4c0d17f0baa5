"""Simulated trays against the forecast, the table of free parts, and times added by hand."""

import numpy as np
import pytest

from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.feeding.control import (
    Advice,
    Choice,
    ControllerModel,
    advise,
    controller_model,
    flip_and_refill,
)
from resting_aspects_ros.feeding.footprint import Footprint, FreeShares, Tray
from resting_aspects_ros.feeding.forecast import FeederModel, SteadyStates
from resting_aspects_ros.feeding.steady_state import CycleTimes
from resting_aspects_ros.feeding.tray_simulation import (
    DensityPlaces,
    RandomPlaces,
    SimulatedTray,
    simulate,
)

TIMES = CycleTimes(robot=1.0, vibrate=0.8, settle=0.5, image=0.2, supply=0.1, place=0.3)
FEEDER = FeederModel(
    np.array([600, 400]),
    np.array([[60, 35, 5], [50, 50, 0]]),
    np.array([False, True]),
    [Footprint(0.03, 0.02), Footprint(0.02, 0.01)],
    Tray((0.2, 0.2), 0.005),
    TIMES,
)
NUMBER = 12


@pytest.fixture(scope='module')
def model():
    return controller_model(FEEDER, spread=0.4, number=NUMBER)


def test_rate_of_the_cycle_of_the_forecast_is_the_forecast(model):
    run = simulate(flip_and_refill(model), model, 20_000, np.random.default_rng(1))
    spread = SteadyStates(FEEDER).spread(model.table, NUMBER)
    assert abs(run.rate - 60 * model.values.rate) < 4 * np.sqrt(spread.variance / (20_000 / 60))


@pytest.mark.slow
def test_controller_is_not_below_the_cycle_of_the_forecast(model):
    rates = np.array(
        [
            [
                simulate(rule, model, 2400, np.random.default_rng(seed)).rate
                for rule in (lambda seen: advise(seen, model), flip_and_refill(model))
            ]
            for seed in range(3)
        ]
    )
    ours, theirs = rates.mean(axis=0)
    assert ours > 0.99 * theirs


@pytest.mark.parametrize('places', [DensityPlaces, RandomPlaces])
def test_free_parts_have_the_shares_of_the_table(model, places):
    generator = np.random.default_rng(2)
    tray = SimulatedTray(model, places(model, generator), generator)
    tray.supply(6)
    tray.supply(6)
    counts = np.zeros((2, 2))
    for _ in range(200):
        tray.spread()
        for part in tray.seen():
            counts[part.symmetry_class - 1] += [part.clearance >= 0.005, 1]
    found = counts[:, 0] / counts[:, 1]
    # Free parts of one tray are correlated, and the mix differs a little from that of the table.
    assert found == pytest.approx(model.table.at(12), abs=0.05)


def test_flip_has_the_shares_of_the_transitions(model):
    generator = np.random.default_rng(3)
    tray = SimulatedTray(model, DensityPlaces(model, generator), generator)
    tray.supply(4000)
    before = tray.classes.copy()
    first = before == 0
    tray.flip()
    expected = np.array([first.sum() * 0.6 + (~first).sum() * 0.5, 0])
    expected[1] = first.sum() * 0.35 + (~first).sum() * 0.5
    # Four standard deviations of a binomial number of 4000.
    assert np.bincount(tray.classes) == pytest.approx(expected, abs=4 * np.sqrt(4000 / 4))


def test_positions_do_not_overlap_and_removal_keeps_the_others(model):
    generator = np.random.default_rng(4)
    tray = SimulatedTray(model, RandomPlaces(model, generator), generator)
    tray.supply(10)
    before = [part.clearance for part in tray.seen()]
    assert min(before) >= 0
    free = [k for k, clearance in enumerate(before) if clearance >= 0.005]
    tray.remove(free)
    after = [part.clearance for part in tray.seen()]
    # A free part blocks no other.
    assert all(clearance < 0.005 for clearance in after)
    assert len(after) == 10 - len(free)


def scripted(steps):
    """Give a controller that follows a list of choices, with 4 parts for each supply."""
    remaining = iter(steps)

    def decide(seen):
        choice, then, picks = next(remaining)
        supply = 4 * (Choice.SUPPLY in (choice, then))
        return Advice(choice, tuple(range(picks)), then, supply, {}, '')

    return decide


def test_times_add_up():
    table = FreeShares(np.ones((20, 2)), False)
    model = ControllerModel(FEEDER, table, NUMBER, spread=0.4)
    steps = [
        (Choice.SUPPLY, None, 0),  # 0.4 + 0.5 + 0.2
        (Choice.PICK, Choice.SPREAD, 1),  # 1.0 + 0.4 + 0.5 + 0.2 - 0.3
        (Choice.PICK, None, 1),  # 1.0 + 0.2 - 0.2: only the image overlaps
        (Choice.WAIT, None, 0),  # 0.2 + 1.0
        (Choice.FLIP, None, 0),  # 0.8 + 0.5 + 0.2
    ]
    run = simulate(scripted(steps), model, 6.55, np.random.default_rng(1))
    assert run.seconds == pytest.approx(1.1 + 1.8 + 1.0 + 1.2 + 1.5)
    assert (run.picks, run.images, run.supplied) == (2, 5, 4)


def test_missed_parts_stay_and_unrecognised_ones_have_no_class(model):
    generator = np.random.default_rng(5)
    run = simulate(flip_and_refill(model), model, 3000, generator, success=0.5)
    full = simulate(flip_and_refill(model), model, 3000, np.random.default_rng(5))
    assert 0 < run.picks < full.picks
    tray = SimulatedTray(model, DensityPlaces(model, generator), generator, unrecognised=1.0)
    tray.supply(5)
    assert {part.symmetry_class for part in tray.seen()} == {0}


def test_same_seed_gives_the_same_run(model):
    one, other = (
        simulate(flip_and_refill(model), model, 500, np.random.default_rng(7)) for _ in range(2)
    )
    assert (one.picks, one.seconds) == (other.picks, other.seconds)


def test_duration_of_a_run_must_be_positive(model):
    with pytest.raises(InvalidValueError, match='expected more than 0'):
        simulate(flip_and_refill(model), model, 0.0, np.random.default_rng(1))
