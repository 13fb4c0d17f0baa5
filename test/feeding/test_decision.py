"""Decisions against closed forms and an independent optimum by enumeration."""

import dataclasses
import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from resting_aspects_ros.feeding.control import (
    Choice,
    ControllerModel,
    SeenPart,
    advise,
)
from resting_aspects_ros.feeding.footprint import Footprint, FreeShares, Tray
from resting_aspects_ros.feeding.forecast import FeederModel
from resting_aspects_ros.feeding.steady_state import CycleTimes

TIMES = CycleTimes(robot=1.0, vibrate=0.8, settle=0.5, image=0.2, supply=0.05)
PART = Footprint(0.03, 0.02)
TRAY = Tray((0.2, 0.2), 0.005)
MIXED = np.array([[60, 40], [50, 50]])
BLOCKED = 0.001  # m
NONE = SeenPart(1)


def model_of(transitions, drop=(60, 40), times=TIMES, number=4, free=None, max_picks=None, **more):
    """Give a model in which class 2 is pickable; parts are always free unless given."""
    share = np.ones(12) if free is None else np.array(free)
    feeder = FeederModel(
        np.array(drop), transitions, np.array([False, True]), [PART] * 2, TRAY, times, max_picks
    )
    return ControllerModel(feeder, FreeShares(np.tile(share, (2, 1)).T, False), number, **more)


FALLING = np.exp(-0.1 * np.arange(12))


@pytest.fixture(scope='module')
def model():
    return model_of(MIXED, free=FALLING, spread=0.4)


def test_useless_flip_is_not_chosen():
    """A flip that changes no class leaves no way but to supply, or to spread blocked parts."""
    still = model_of(np.diag([100, 100]), spread=0.8, free=FALLING)
    assert advise([NONE] * 4, still).choice is Choice.SUPPLY
    blocked = [SeenPart(2, BLOCKED)] * 4
    turning = model_of(np.array([[50, 50], [100, 0]]), spread=0.8, free=FALLING)
    assert advise(blocked, turning).choice is Choice.SPREAD


def test_reason_names_what_excludes_the_parts(model):
    parts = [NONE, NONE, SeenPart(0), SeenPart(2, BLOCKED), SeenPart(2, score=0.0)]
    reason = advise(parts, model).reason
    for text in ('2 in another', '1 not recognised', '1 without room', '1 with a score below'):
        assert text in reason


def test_empty_tray_is_supplied_up_to_the_best_number():
    advice = advise([], model_of(MIXED))
    assert (advice.choice, advice.supply) == (Choice.SUPPLY, 4)
    assert advise([], model_of(MIXED, max_supply=3)).supply == 3
    # The controller waits only without parts and supply.
    without = model_of(MIXED, max_supply=0)
    assert advise([], without).choice is Choice.WAIT
    assert advise([NONE], without).choice is Choice.FLIP


@given(st.lists(st.tuples(st.integers(0, 2), st.booleans(), st.floats(0, 1)), max_size=12))
def test_something_is_done_and_only_valid_parts_are_picked(drawn):
    found = model_of(MIXED, free=FALLING, spread=0.4, max_picks=3)
    seen = [SeenPart(kind, math.inf if free else BLOCKED, p) for kind, free, p in drawn]
    advice = advise(seen, found)
    assert advice.choice is not Choice.WAIT
    assert (advice.choice is Choice.PICK) == bool(advice.picks)
    assert len(advice.picks) <= 3
    scores = [seen[i].score for i in advice.picks]
    assert scores == sorted(scores, reverse=True)
    assert all(seen[i].symmetry_class == 2 and seen[i].clearance > BLOCKED for i in advice.picks)
    assert len(seen) - len(advice.picks) + advice.supply <= 12
    best = max(advice.expected, key=lambda choice: advice.expected[choice].rate)
    assert advice.picks or best is advice.choice


def test_part_that_is_hardly_recognised_is_not_picked(model):
    assert advise([SeenPart(2, score=0.45)], model).choice is not Choice.PICK
    strict = dataclasses.replace(model, min_score=0.95)
    assert advise([SeenPart(2, score=0.9)], strict).choice is not Choice.PICK


def combinations(rows):
    """Yield the probability and the classes of each combination of the outcomes of some parts."""
    for each in itertools.product(*[list(enumerate(row)) for row in rows]):
        weight = math.prod(p for _, p in each)
        if weight:
            yield weight, tuple(sorted(kind for kind, _ in each))


def possible_actions(rest, drop, moved, times, room):
    """Yield each action, its time, and the shares of the classes of each part after it."""
    for supply in range(room - len(rest) + 1):
        time = times.settle + times.image + supply * times.supply
        rows = [moved[k] for k in rest] + [drop] * supply
        yield Choice.FLIP, time + times.vibrate, rows
        if supply:
            yield Choice.SUPPLY, time, [np.eye(2)[k] for k in rest] + [drop] * supply


def best_by_enumeration(parts, drop, moved, times, seconds, room):
    """Return the first action of the policy with most expected picks within a time.

    ``parts`` are the classes of the parts on the tray, all of them free; those of class index 1
    are picked.
    """
    memory = {}

    def value(parts, left):
        if (parts, left) not in memory:
            memory[parts, left] = best(parts, left)[0]
        return memory[parts, left]

    def best(parts, left):
        rest = tuple(kind for kind in parts if kind == 0)
        after = left - parts.count(1) * times.robot
        found = [(min(parts.count(1), max(left // times.robot, 0)), None)]
        for action, time, rows in possible_actions(rest, drop, moved, times, room):
            if after - time >= times.robot:
                end = round(after - time, 6)
                later = sum(weight * value(new, end) for weight, new in combinations(rows))
                found.append((parts.count(1) + later, action))
        return max(found, key=lambda each: each[0])

    return best(tuple(parts), seconds)[1]


@pytest.mark.parametrize('flip', [[95, 5], [70, 30], [10, 90]])
def test_decisions_are_those_of_enumeration_on_a_tiny_tray(flip):
    """The best first action on a tray for two parts over a horizon of many cycles."""
    moved = np.array([flip, flip])
    times = CycleTimes(robot=1.0, vibrate=2.0, settle=0.5, image=0.5, supply=0.5)
    found = model_of(moved, drop=(50, 50), times=times, number=2)
    for parts in ([], [0], [0, 0], [1], [0, 1]):
        action = best_by_enumeration(parts, [0.5, 0.5], moved / 100, times, 40.0, 2)
        advice = advise([SeenPart(kind + 1) for kind in parts], found)
        assert (advice.then if advice.picks else advice.choice) is action, parts
