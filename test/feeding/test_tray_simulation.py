"""Simulated trays: times added by hand, picks by place, and runs against forecast and formula."""

import dataclasses
from functools import partial

import numpy as np
import pytest
from feeders import DensityPlaces, density_run, fixed_cycle

from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.feeding import tray_simulation
from resting_aspects_ros.feeding.control import Advice, Choice, ControllerModel, advise
from resting_aspects_ros.feeding.footprint import Footprint, FreeShares, Tray, free_shares
from resting_aspects_ros.feeding.forecast import FeederModel
from resting_aspects_ros.feeding.steady_state import CycleTimes, Moves, drawn_moves
from resting_aspects_ros.feeding.tray_simulation import (
    REACH,
    SimulatedRuns,
    SimulatedTray,
    VirtualFeeder,
    forecast_controller,
)
from resting_aspects_ros.vision.outline import find_outlines
from resting_aspects_ros.vision.tray_image import OutlinePlaces

FEEDER = FeederModel(
    np.array([600_000, 400_000]),
    np.array([[600_000, 350_000, 50_000], [500_000, 500_000, 0]]),
    np.array([False, True]),
    [Footprint(0.03, 0.02), Footprint(0.02, 0.01)],
    Tray((0.2, 0.2), 0.005),
    CycleTimes(robot=1.0, vibrate=0.8, settle=0.5, image=0.2, supply=0.1, place=0.3),
)
TABLE = FreeShares(np.full((20, 2), 0.8), False)
MODEL = ControllerModel(FEEDER, TABLE, 8, spread=0.4)


@pytest.fixture(autouse=True)
def few_draws(monkeypatch):
    monkeypatch.setattr(tray_simulation, 'DRAWS', 50)


@pytest.mark.slow
def test_controller_is_not_below_the_cycle_of_the_forecast():
    table = free_shares(FEEDER.tray, FEEDER.footprints, FEEDER.drop, 1, 12)
    model = ControllerModel(FEEDER, table, 12, spread=0.4)

    def rate(rule):
        picked, seconds = density_run(rule, model, 4800, np.random.default_rng(0))
        return len(picked) / seconds

    assert rate(partial(advise, model=model)) > 0.99 * rate(fixed_cycle(model))


@pytest.mark.slow
def test_free_parts_have_the_shares_of_the_table(part):
    """Outlines that are rectangles are free as often as their footprints."""
    box = part('box_10x20x30')
    outlines = find_outlines(box, find_aspects(box))[1:]
    sizes = [Footprint(each.length, each.width) for each in outlines]
    table = free_shares(FEEDER.tray, sizes, FEEDER.drop, 1, 12)
    generator = np.random.default_rng(2)
    tray = SimulatedTray(MODEL, OutlinePlaces(outlines, FEEDER.tray.size, generator), generator)
    tray.supply(6)
    tray.supply(6)
    counts = np.zeros((2, 2))
    for _ in range(200):
        tray.spread()
        for seen in tray.seen():
            counts[seen.symmetry_class - 1] += [seen.clearance >= 0.005, 1]
    found = counts[:, 0] / counts[:, 1]
    # Free parts of one tray are correlated, and the mix differs a little from that of the table.
    assert found == pytest.approx(table.at(12), abs=0.05)


def test_times_add_up():
    model = dataclasses.replace(MODEL, table=FreeShares(np.ones((20, 2)), False))
    steps = iter(
        [
            (Choice.SUPPLY, None, 0),  # 0.4 + 0.5 + 0.2
            (Choice.PICK, Choice.SPREAD, 1),  # 1.0 + 0.4 + 0.5 + 0.2 - 0.3
            (Choice.PICK, None, 1),  # 1.0 + 0.2 - 0.2: only the image overlaps
            (Choice.WAIT, None, 0),  # 0.2 + 1.0
            (Choice.FLIP, None, 0),  # 0.8 + 0.5 + 0.2
        ]
    )

    def decide(_):
        choice, then, picks = next(steps)
        return Advice(choice, tuple(range(picks)), then, 4 * (choice is Choice.SUPPLY), {}, '')

    picked, seconds = density_run(decide, model, 6.55, np.random.default_rng(1))
    assert seconds == pytest.approx(1.1 + 1.8 + 1.0 + 1.2 + 1.5)
    assert picked == pytest.approx([1.1 + 1.0, 2.9 + 1.0])
    assert next(steps, None) is None


class Row:
    """Places in a row, 20 mm apart."""

    def shake(self, classes):
        self.centres = np.array([[0.02 * k, 0.0] for k in range(len(classes))])

    add = shake

    def keep(self, which):
        self.centres = self.centres[which]


def virtual_feeder(place=0.0):
    """Return a feeder whose drops are all of class 1, and whose flips lead to class 2."""
    feeder = dataclasses.replace(
        FEEDER,
        drop=np.array([9, 0]),
        transitions=np.array([[0, 9], [0, 9]]),
        times=CycleTimes(1.0, 0.5, 0.25, 0.125, 0.0625, place),
    )
    model = dataclasses.replace(MODEL, feeder=feeder, spread=0.375)
    return VirtualFeeder(model, Row(), np.random.default_rng(1))


@pytest.mark.parametrize('place', [0.25, 1.0])
def test_feeder_works_while_the_robot_places(place):
    cell = virtual_feeder(place)
    cell.move(Choice.SUPPLY, 4)
    begin = cell.seconds
    assert begin == 0.25 + 4 * 0.0625
    assert cell.pick(0.0, 0.0, 1)
    assert cell.seconds == begin + 1.0 - place  # the part has left the tray
    cell.move(Choice.FLIP)
    cell.take_image()
    assert cell.tray.classes.tolist() == [1] * 3
    cell.tray.classes[:] = 0
    assert cell.pick(0.02, 0.0, 1)
    # The next pick begins when the robot is back.
    assert cell.seconds == begin + 2.0 + max(0.875 - place, 0.0) - place


def test_part_is_found_by_its_place_and_class():
    cell = virtual_feeder()
    assert not cell.pick(0.0, 0.0, 1)  # an empty tray
    cell.move(Choice.SUPPLY, 3)
    assert not cell.pick(0.02 + 1.1 * REACH, 0.0, 1)
    assert not cell.pick(0.02, 0.0, 2)
    assert cell.pick(0.02, 0.9 * REACH, 1)
    assert not cell.pick(0.02, 0.0, 1)
    assert (cell.picks, len(cell.tray.classes)) == (1, 2)


def density(generator):
    return DensityPlaces(MODEL, generator)


def test_rate_of_the_cycle_of_the_forecast_is_that_of_the_formula():
    found = forecast_controller(MODEL, density, controller=fixed_cycle(MODEL))
    expected = FEEDER.rates(TABLE)[7]
    # The interval of the mean contains it in 95 % of cases, so twice its width nearly always.
    assert abs(found.rate - expected) < found.upper - found.lower
    assert found.prediction[0] < found.lower < found.rate < found.upper < found.prediction[1]
    with pytest.raises(InvalidValueError, match='invalid minutes'):
        forecast_controller(MODEL, density, np.nan)


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
    drop, flips = np.array([60, 40]), np.array([[18, 2, 0], [6, 14, 0]])
    feeder = dataclasses.replace(FEEDER, drop=drop, transitions=flips, max_picks=3)
    model, minutes = ControllerModel(feeder, TABLE, 12), 5
    found = forecast_controller(model, density, minutes)
    low, high = found.prediction
    drawn = drawn_moves(drop, flips, 10, np.random.default_rng(5))
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
