"""The best plan: against all stationary policies of small random cases, and closed formulas."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.statistics.markov import best_plan, reach

seeds = st.integers(0, 2**32 - 1)


def random_case(seed, max_actions=3, max_aspects=5):
    """Return transitions with many zeros, so that there are traps, times and wanted aspects."""
    generator = np.random.default_rng(seed)
    a = int(generator.integers(1, max_actions + 1))
    k = int(generator.integers(1, max_aspects + 1))
    rows = generator.random((a, k, k)) * (generator.random((a, k, k)) < 0.35)
    action, start = np.nonzero(rows.sum(axis=2) == 0)
    rows[action, start, generator.integers(k, size=len(start))] = 1.0
    rows /= rows.sum(axis=2, keepdims=True)
    times = generator.uniform(0.1, 3.0, a)
    return rows, times, generator.random(k) < 0.3


def time_of_policy(rows, times, wanted, policy):
    """Return the expected time (k,) of a policy; infinite if the part may never arrive."""
    k = len(wanted)
    chosen = np.where(wanted[:, None], np.eye(k), rows[policy, np.arange(k)])
    steps = [set(np.flatnonzero(row).tolist()) for row in chosen]
    arriving = set(np.flatnonzero(wanted).tolist())
    while more := {i for i in range(k) if steps[i] & arriving} - arriving:
        arriving |= more
    failing = set(range(k)) - arriving
    while more := {i for i in range(k) if steps[i] & failing and not wanted[i]} - failing:
        failing |= more
    certain = np.array([i for i in range(k) if i not in failing and not wanted[i]], dtype=int)
    time = np.where(wanted, 0.0, np.inf)
    inside = chosen[np.ix_(certain, certain)]
    time[certain] = np.linalg.solve(np.eye(len(certain)) - inside, times[policy][certain])
    return time


@given(seeds)
def test_plan_is_the_best_of_all_stationary_policies(seed):
    rows, times, wanted = random_case(seed)
    policies = itertools.product(range(len(times)), repeat=len(wanted))
    every = [time_of_policy(rows, times, wanted, np.array(each)) for each in policies]
    plan = best_plan(rows, times, wanted)
    assert plan.time == pytest.approx(np.min(every, axis=0), rel=1e-9)


@given(seeds)
def test_actions_of_the_plan_take_its_time(seed):
    rows, times, wanted = random_case(seed, max_actions=6, max_aspects=12)
    plan = best_plan(rows, times, wanted)
    free = plan.action >= 0
    assert free.tolist() == (np.isfinite(plan.time) & ~wanted).tolist()
    assert (plan.action < len(times)).all()
    assert (plan.time[wanted] == 0).all()
    policy = np.where(free, plan.action, 0)
    time = time_of_policy(rows, times, wanted, policy)
    assert time[free] == pytest.approx(plan.time[free], rel=1e-9)


@given(seeds)
def test_plan_of_a_single_action_takes_its_number_of_actions(seed):
    rows, _, wanted = random_case(seed, max_actions=1, max_aspects=8)
    probability, actions = reach(rows[0], wanted)
    plan = best_plan(rows, np.array([0.7]), wanted)
    certain = probability > 1 - 1e-9
    assert plan.time[certain] == pytest.approx(0.7 * actions[certain], rel=1e-12)
    assert (plan.time[~certain] == np.inf).all()


def test_rare_transitions_do_not_blur_the_choice():
    # Both succeed once in 10^8 attempts, of 1.0 s and of 0.9 s.
    rows = np.array([[[1 - 1e-8, 1e-8], [0, 1]]] * 2)
    plan = best_plan(rows, np.array([1.0, 0.9]), np.array([False, True]))
    assert plan.action.tolist() == [1, -1]
    assert plan.time[0] == pytest.approx(0.9e8, rel=1e-12)


@pytest.mark.parametrize('wanted', [False, True])
def test_plan_has_no_action_if_all_or_no_aspects_are_wanted(wanted):
    rows = np.array([[[0.5, 0.5], [0.5, 0.5]]])
    plan = best_plan(rows, np.array([1.0]), np.full(2, wanted))
    assert plan.action.tolist() == [-1, -1]
    assert plan.time.tolist() == [0 if wanted else np.inf] * 2


def test_rows_of_wanted_aspects_are_not_used():
    rows = np.array([[[0.5, 0.5], [np.nan, np.nan]]])
    assert best_plan(rows, np.array([1.0]), np.array([False, True])).time.tolist() == [2, 0]


@pytest.mark.parametrize('time', [0.0, -1.0, math.inf, math.nan])
def test_time_of_an_action_must_be_positive_and_finite(time):
    with pytest.raises(InvalidValueError, match='invalid times'):
        best_plan(np.eye(2)[None].repeat(2, axis=0), np.array([1.0, time]), np.ones(2, bool))


@pytest.mark.parametrize('row', [[0.5, 0.4], [math.nan, 1], [1.5, -0.5]])
def test_plan_rejects_an_invalid_row(row):
    rows = np.array([np.eye(2), [row, [0, 1]]])
    with pytest.raises(InvalidValueError, match=r'^invalid row 1 of the transition matrix'):
        best_plan(rows, np.array([1.0, 1.0]), np.array([False, True]))
