"""Cycles and forecasts against exact distributions, a discrete-event simulation and formulas."""

import dataclasses
import math

import numpy as np
import pytest
from feeders import simulated_picks
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import binom

from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.feeding import footprint
from resting_aspects_ros.feeding import forecast as forecast_module
from resting_aspects_ros.feeding.footprint import Footprint, Tray
from resting_aspects_ros.feeding.forecast import FeederModel, forecast
from resting_aspects_ros.feeding.steady_state import (
    CycleTimes,
    Moves,
    cycle_time,
    drawn_moves,
    limited_by,
    moves_of,
    parts_per_minute,
    picks,
    refilled_later,
    run_spread,
    steady_state,
)

TRANSITIONS = np.array(
    [[300, 80, 19, 1, 0, 0, 0], [150, 200, 45, 0, 5, 0, 0], [50, 50, 290, 0, 0, 0, 10]]
)
DROP = np.array([600, 300, 100])
MOVES = moves_of(DROP, TRANSITIONS)
FREE = np.array([0.0, 0.7, 0.4])
TIMES = CycleTimes(robot=1.2, vibrate=0.8, settle=0.5, image=0.2, supply=0.05)
FOOTPRINTS = [Footprint(0.03, 0.02), Footprint(0.03, 0.01), Footprint(0, 0, 0.008)]
MODEL = FeederModel(
    DROP,
    TRANSITIONS,
    np.array([False, True, True]),
    FOOTPRINTS,
    Tray((0.2, 0.2), 0.005),
    TIMES,
)
MINUTES = 100  # of a simulation
OVERLAP = dataclasses.replace(TIMES, place=0.6)


@pytest.fixture(autouse=True)
def few_parts_are_placed(monkeypatch):
    monkeypatch.setattr(footprint, 'PLACED', 2000)
    monkeypatch.setattr(forecast_module, 'DRAWS', 60)


# The binomial distribution of SciPy overflows for the smallest numbers.
@given(st.integers(1, 40), st.just(0.0) | st.floats(1e-300, 1), st.integers(1, 45))
def test_picks_have_the_moments_of_a_limited_binomial_number(number, share, most):
    found = picks(number, np.array(share), most)
    count = np.arange(number + 1)
    chance = binom.pmf(count, number, share)
    limited = np.minimum(count, most)
    mean = chance @ limited
    assert found.mean == pytest.approx(mean, abs=1e-9)
    assert found.variance == pytest.approx(chance @ limited**2 - mean**2, abs=1e-9)
    assert found.none == pytest.approx(chance[0], abs=1e-12)


def test_cycle_time_adds_up_and_overlaps_only_after_a_pick():
    times = CycleTimes(robot=1.0, vibrate=0.5, settle=0.3, image=0.2, supply=0.1, place=0.4)
    found = picks(2, np.array(0.5))
    seconds = 1.0 + 1.0 + 0.1 - 0.4 * 0.75
    assert cycle_time(times, found, np.array(1.0)) == pytest.approx(seconds)
    assert parts_per_minute(times, found, np.array(1.0)) == pytest.approx(60 / seconds)
    # It is at most the time of the feeder.
    assert CycleTimes(3.0, 0.1, 0.1, 0.1, place=1.5).overlap == pytest.approx(0.3)


def test_longest_time_limits():
    found = picks(10, np.array(0.3))
    for resource, name in (('robot', 'robot'), ('vibrate', 'feeder'), ('image', 'vision')):
        times = dataclasses.replace(CycleTimes(0.1, 0.1, 0.1, 0.1), **{resource: 2.0})
        assert limited_by(times, found, found.mean) == name


@pytest.mark.parametrize(
    ('times', 'number', 'most'), [(TIMES, 12, None), (OVERLAP, 12, 2), (OVERLAP, 2, None)]
)
def test_rate_and_variance_are_those_of_a_discrete_event_simulation(times, number, most):
    found = simulated_picks(MOVES, FREE, number, times, most, 60 * MINUTES, seed=1)
    state = steady_state(MOVES, FREE, number, most)
    rate = float(parts_per_minute(times, state.picks, state.supplied))
    variance = run_spread(MOVES, state, number, times).variance
    # Correlations between places, which a limit causes, are of the order 1 / number.
    slack = 0.01 * rate if most else 0.0
    assert abs(len(found) / MINUTES - rate) < 4 * math.sqrt(variance / MINUTES) + slack
    pieces = np.histogram(found, bins=MINUTES // 5, range=(0, 60 * MINUTES))[0]
    # The variance of n normal numbers has a relative standard error of sqrt(2 / (n - 1)). The ends
    # of a piece, within a cycle, add a little.
    tolerance = 4 * math.sqrt(2 / (len(pieces) - 1)) + 0.2
    assert pieces.var(ddof=1) / 5 == pytest.approx(variance, rel=tolerance)


@pytest.mark.slow
def test_runs_are_within_the_prediction_interval():
    """Runs whose probabilities are drawn from the posterior, of which 95 % are expected inside."""
    found = forecast(MODEL, 10, minutes=20)
    free = np.append(np.where(MODEL.pickable, found.free, 0.0), 0.0)
    generator = np.random.default_rng(3)
    drawn = refilled_later(drawn_moves(DROP, TRANSITIONS, 20, generator))
    low, high = found.prediction
    within = 0
    for k in range(20):
        moves = Moves(drawn.drop[k], drawn.transitions[k], drawn.left[k])
        picked = simulated_picks(moves, free, 10, TIMES, None, 60 * 20, seed=k)
        within += low <= len(picked) / 20 <= high
    # At least 15 of 20 in 99.9 % of cases, if each is within with 95 %.
    assert within >= 15


@pytest.mark.slow
@given(st.integers(0, 2**32 - 1), st.integers(1, 60))
def test_fixed_point_is_that_of_iteration(seed, number):
    generator = np.random.default_rng(seed)
    k = int(generator.integers(2, 6))
    rows = generator.dirichlet(np.ones(k + 1), k)
    moves = Moves(generator.dirichlet(np.ones(k)), rows[:, :k], rows[:, k])
    free = generator.random(k) * (np.arange(k) < generator.integers(1, k + 1))
    state = steady_state(moves, free, number)
    parts = number * moves.drop
    for _ in range(3000):
        picked = parts * free
        rest = parts - picked
        supplied = picked.sum() + rest @ moves.left
        parts = rest @ moves.transitions + supplied * moves.drop
    assert number * state.mix == pytest.approx(parts, abs=1e-9 * number)
    assert state.picks.mean == pytest.approx((parts * free).sum())
    assert state.supplied == pytest.approx(supplied)


def changed(**values):
    return dataclasses.replace(MODEL, **values)


def test_parts_that_can_always_be_picked_have_a_closed_form():
    model = changed(pickable=np.ones(3, dtype=bool), tray=Tray((0.2, 0.2), 0.0))
    found = forecast(model, 8)
    assert found.rate == pytest.approx(60 * 8 / (1.5 + 8 * 1.25))
    assert found.state.picks.variance == pytest.approx(0, abs=1e-9)  # a difference of squares
    found = forecast(model, 1)
    seconds = 1.2 + 0.8 + 0.5 + 0.2 + 0.05
    assert found.rate == pytest.approx(60 / seconds)
    assert (found.lower, found.upper) == pytest.approx([60 / seconds] * 2)
    # A run begins with an empty tray: the first image follows after settling and supply.
    expected = 60 / seconds * (1 - (0.5 + 0.2 + 0.05) / 3600)
    # It ends anywhere in a cycle, of which the feeder and the camera take 1.5 s.
    low, high = found.prediction
    assert expected - 60 / seconds * 1.5 / 3600 < low < high < expected
    assert found.flips_per_part == pytest.approx(0, abs=1e-9)
    # With a clearance as large as the tray, each of two parts blocks the other.
    assert forecast(changed(tray=Tray((0.2, 0.2), 0.2))).best_number == 1


@pytest.mark.slow
def test_action_without_effect_fills_the_tray_with_unpickable_parts():
    """Aspect 0 is not pickable, and the action changes nothing: the tray fills with it."""
    found = forecast(changed(transitions=100 * np.eye(3, 7, dtype=np.int64)))
    assert found.rate == 0
    assert found.best_number is None
    assert found.trapped.tolist() == [True, False, False]
    assert found.flips_per_part == math.inf
    # A transition that was never seen in 100 actions is possible.
    assert found.upper > 1


def test_wrong_values_are_refused():
    for wrong in ({'number': 2.5}, {'number': 10_000}, {'minutes': math.nan}):
        with pytest.raises(InvalidValueError, match='expected'):
            forecast(MODEL, **wrong)
    with pytest.raises(InvalidValueError, match='expected drops that come to rest'):
        changed(drop=np.zeros(3, dtype=np.int64))
    with pytest.raises(InvalidValueError, match='invalid settle time nan'):
        dataclasses.replace(TIMES, settle=math.nan)


@pytest.mark.slow
@settings(max_examples=3)
@given(st.data())
def test_interval_of_the_rate_contains_it_at_the_border(data):
    row = st.lists(st.integers(0, 2), min_size=7, max_size=7).filter(any)
    drop = np.array(data.draw(st.lists(st.integers(0, 2), min_size=3, max_size=3).filter(any)))
    transitions = np.array([data.draw(row) for _ in range(3)])
    found = forecast(changed(drop=drop, transitions=transitions), 3)
    assert found.lower <= found.rate <= found.upper
    assert (found.curve.lower <= found.curve.rate).all()
    assert (found.curve.rate <= found.curve.upper).all()
