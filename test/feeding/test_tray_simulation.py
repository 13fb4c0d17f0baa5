"""Simulated trays against the table of free parts, and times added by hand."""

import numpy as np
import pytest
from feeders import DensityPlaces, density_run, fixed_cycle

from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.feeding.control import Advice, Choice, ControllerModel, advise
from resting_aspects_ros.feeding.footprint import Footprint, FreeShares, Tray, free_shares
from resting_aspects_ros.feeding.forecast import FeederModel
from resting_aspects_ros.feeding.steady_state import CycleTimes
from resting_aspects_ros.feeding.tray_simulation import SimulatedTray
from resting_aspects_ros.vision.outline import find_outlines
from resting_aspects_ros.vision.tray_image import OutlinePlaces

FEEDER = FeederModel(
    np.array([600, 400]),
    np.array([[60, 35, 5], [50, 50, 0]]),
    np.array([False, True]),
    [Footprint(0.03, 0.02), Footprint(0.02, 0.01)],
    Tray((0.2, 0.2), 0.005),
    CycleTimes(robot=1.0, vibrate=0.8, settle=0.5, image=0.2, supply=0.1, place=0.3),
)
NUMBER = 12


@pytest.fixture(scope='module')
def model():
    mix = FEEDER.drop / FEEDER.drop.sum()
    table = free_shares(FEEDER.tray, FEEDER.footprints, mix, 1, NUMBER)
    return ControllerModel(FEEDER, table, NUMBER, spread=0.4)


@pytest.mark.slow
def test_controller_is_not_below_the_cycle_of_the_forecast(model):
    def rate(rule):
        picked, seconds = density_run(rule, model, 4800, np.random.default_rng(0))
        return len(picked) / seconds

    ours, theirs = rate(lambda seen: advise(seen, model)), rate(fixed_cycle(model))
    assert ours > 0.99 * theirs


@pytest.mark.slow
def test_free_parts_have_the_shares_of_the_table(model, part):
    """Outlines that are rectangles are free as often as their footprints."""
    box = part('box_10x20x30')
    outlines = find_outlines(box, find_aspects(box))[1:]
    sizes = [Footprint(each.length, each.width) for each in outlines]
    table = free_shares(FEEDER.tray, sizes, FEEDER.drop, 1, NUMBER)
    generator = np.random.default_rng(2)
    tray = SimulatedTray(model, OutlinePlaces(outlines, FEEDER.tray.size, generator), generator)
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


def test_flip_has_the_shares_of_the_transitions(model):
    generator = np.random.default_rng(3)
    tray = SimulatedTray(model, DensityPlaces(model, generator), generator)
    tray.supply(4000)
    first = tray.classes == 0
    # Four standard deviations of a binomial number of 4000.
    tolerance = 4 * np.sqrt(4000 / 4)
    assert first.sum() == pytest.approx(2400, abs=tolerance)
    tray.flip()
    one, other = first.sum(), (~first).sum()
    expected = [0.6 * one + 0.5 * other, 0.35 * one + 0.5 * other]
    assert np.bincount(tray.classes) == pytest.approx(expected, abs=tolerance)


def test_times_add_up():
    model = ControllerModel(FEEDER, FreeShares(np.ones((20, 2)), False), NUMBER, spread=0.4)
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
