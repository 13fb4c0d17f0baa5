"""Rules of today: what they pick, when they flip, and how many parts they supply."""

import dataclasses

import numpy as np
import pytest

from resting_aspects_ros.feeding.control import (
    Choice,
    ControllerModel,
    SeenPart,
    flip_and_refill,
    hopper_rule,
    supply_below,
)
from resting_aspects_ros.feeding.footprint import Footprint, FreeShares, Tray
from resting_aspects_ros.feeding.forecast import FeederModel
from resting_aspects_ros.feeding.steady_state import CycleTimes

MODEL = ControllerModel(
    FeederModel(
        np.array([60, 40]),
        np.array([[60, 40], [50, 50]]),
        np.array([False, True]),
        [Footprint(0.03, 0.02)] * 2,
        Tray((0.2, 0.2), 0.005),
        CycleTimes(robot=1.0, vibrate=0.8, settle=0.5, image=0.2),
    ),
    FreeShares(np.ones((12, 2)), False),
    best_number=10,
)
NONE, WANTED = SeenPart(1), SeenPart(2)


def test_flip_follows_picks_at_once_or_after_another_image():
    seen = [NONE, WANTED, NONE]
    at_once = flip_and_refill(MODEL)(seen)
    assert (at_once.choice, at_once.picks, at_once.then) == (Choice.PICK, (1,), Choice.FLIP)
    assert at_once.supply == 8
    later = flip_and_refill(MODEL, look=True)(seen)
    assert (later.choice, later.then, later.supply) == (Choice.PICK, None, 0)
    flip = flip_and_refill(MODEL, look=True)([NONE, NONE])
    assert (flip.choice, flip.supply) == (Choice.FLIP, 8)


@pytest.mark.parametrize(('number', 'supplied'), [(4, 6), (5, 0), (10, 0), (11, 0)])
def test_parts_are_refilled_below_a_fixed_number(number, supplied):
    advice = supply_below(MODEL, 5)([NONE] * number)
    assert (advice.choice, advice.supply) == (Choice.FLIP, supplied)


@pytest.mark.parametrize(('number', 'supplied'), [(0, 6), (5, 3), (10, 0), (12, 0)])
def test_hopper_rule_is_proportional_to_the_missing_parts(number, supplied):
    assert hopper_rule(MODEL, 6)([NONE] * number).supply == supplied


@pytest.mark.parametrize('look', [False, True])
def test_last_part_is_picked_and_the_empty_tray_is_supplied(look):
    rule = hopper_rule(MODEL, 6, look=look)
    last = rule([WANTED])
    assert (last.choice, last.then, last.supply) == (Choice.PICK, Choice.SUPPLY, 6)
    empty = rule([])
    assert (empty.choice, empty.supply) == (Choice.SUPPLY, 6)


def test_rule_waits_only_for_an_empty_tray_without_supply():
    dry = dataclasses.replace(MODEL, max_supply=0)
    assert flip_and_refill(dry)([]).choice is Choice.WAIT
    assert flip_and_refill(dry)([NONE]).choice is Choice.FLIP
    last = flip_and_refill(dry)([WANTED])
    assert (last.choice, last.then, last.supply) == (Choice.PICK, None, 0)
