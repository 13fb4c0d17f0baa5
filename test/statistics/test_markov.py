"""Chains of repeated actions and the best plan: closed formulas, series, all policies."""

import itertools
import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.statistics.markov import (
    best_plan,
    long_run,
    long_run_bounds,
    reach,
)

from .conftest import CONFIDENCES, assert_ordered, generator

seeds = st.integers(0, 2**32 - 1)


def chain(seed, loses=True):
    """Return random transitions, with many zeros, the rest of each row, and a drop."""
    generator = np.random.default_rng(seed)
    k = int(generator.integers(1, 7))
    rows = generator.random((k, k + 1)) * (generator.random((k, k + 1)) < 0.35)
    rows[:, -1] *= loses and generator.random(k) < 0.3
    empty = rows.sum(axis=1) == 0
    rows[empty, np.flatnonzero(empty)] = 1.0
    rows /= rows.sum(axis=1, keepdims=True)
    drop = generator.random(k) * (generator.random(k) < 0.5)
    drop[generator.integers(k)] += 0.1
    return rows[:, :-1], rows[:, -1], drop


def mean_of_powers(rows, doublings=45):
    """Return the mean of the first 2^doublings powers of a stochastic matrix."""
    power, mean = rows, np.eye(len(rows))
    for _ in range(doublings):
        mean = (mean + power @ mean) / 2
        power = power @ power
        power /= power.sum(axis=1, keepdims=True)
        mean /= mean.sum(axis=1, keepdims=True)
    return mean


@given(st.tuples(*[st.floats(1e-9, 0.5)] * 6))
def test_long_run_of_three_aspects_is_that_of_the_tree_theorem(t):
    ab, ac, ba, bc, ca, cb = t
    rows = np.array([[1 - ab - ac, ab, ac], [ba, 1 - ba - bc, bc], [ca, cb, 1 - ca - cb]])
    of_a, of_b = ba * ca + ba * cb + bc * ca, ab * cb + ab * ca + ac * cb
    trees = np.array([of_a, of_b, ac * bc + ac * ba + ab * bc])
    shares = long_run(rows, np.zeros(3), np.ones(3)).shares
    assert shares == pytest.approx(trees / trees.sum(), rel=1e-13)


@given(seeds, st.booleans())
def test_long_run_is_the_mean_over_many_actions_after_a_drop(seed, loses):
    rows, left, drop = chain(seed, loses)
    start = drop / drop.sum()
    mean = mean_of_powers(rows + np.outer(left, start))
    result = long_run(rows, left, drop)
    assert result.shares == pytest.approx(start @ mean, abs=1e-8)
    for members, weight in zip(result.closed, result.weights, strict=True):
        assert weight == pytest.approx((start @ mean)[list(members)].sum(), abs=1e-8)
        # Every aspect of a closed class leads to every other.
        assert (mean[np.ix_(members, members)] > 0).all()
    assert list(result.transient) == np.flatnonzero(mean.max(axis=0) < 1e-8).tolist()
    # Aspects are unreachable where no sequence of drops and actions has any part.
    step, parts = rows + np.outer(left, start), start
    for _ in rows:
        parts = (parts + parts @ step) / 2
    assert list(result.unreachable) == np.flatnonzero(parts == 0).tolist()


@given(seeds)
def test_reach_is_the_series_over_the_number_of_actions(seed):
    rows, _, _ = chain(seed)
    rows = 0.9 * rows  # a tenth leaves at each action, so that the series converges
    wanted = np.random.default_rng(seed + 1).random(len(rows)) < 0.4
    free = ~wanted
    inside, arrives = rows[np.ix_(free, free)], rows[np.ix_(free, wanted)].sum(axis=1)
    total, weighted = np.zeros(free.sum()), np.zeros(free.sum())
    for n in range(1, 500):
        total, weighted = total + arrives, weighted + n * arrives
        arrives = inside @ arrives
    probability, actions = reach(rows, wanted)
    assert (probability[wanted] == 1).all()
    assert (actions[wanted] == 0).all()
    assert probability[free] == pytest.approx(total, rel=1e-12)
    mean = np.divide(weighted, total, out=np.full(len(total), np.nan), where=total > 0)
    assert actions[free] == pytest.approx(mean, rel=1e-12, nan_ok=True)


def test_rows_of_wanted_aspects_are_not_used():
    rows = np.array([[0.5, 0.5], [np.nan, np.nan]])
    wanted = np.array([False, True])
    probability, actions = reach(rows, wanted)
    assert (probability.tolist(), actions.tolist()) == ([1, 1], [2, 0])
    assert best_plan(rows[None], np.array([1.0]), wanted).time.tolist() == [2, 0]


@pytest.mark.parametrize('denominator', [2**26, 9 * 10**7, 11 * 10**7])
def test_reach_of_rare_transitions_is_as_accurate_as_of_frequent_ones(denominator):
    # Exact fractions: two rare steps and a return in between. I - T has a condition number of
    # about 1e15, so that a direct solution has few correct digits, and so has one that takes
    # rounding errors of the sum of a row for lost parts.
    rare = Fraction(1, denominator)
    rows = [
        [1 - rare, rare, Fraction(0), Fraction(0)],
        [1 - rare, Fraction(0), rare / 3, rare * 2 / 3],
        [Fraction(1, 2), Fraction(1, 2), Fraction(0), Fraction(0)],
        [Fraction(0), Fraction(0), Fraction(0), Fraction(1)],
    ]
    matrix = [[(i == j) - rows[i][j] for j in range(3)] for i in range(3)]
    expected = [float(each) for each in fractions_solution(matrix, [1] * 3)]
    assert expected[0] > 9e14
    probability, actions = reach(np.array(rows, dtype=np.float64), np.arange(4) == 3)
    assert probability == pytest.approx([1] * 4, rel=1e-14)
    assert actions[:3] == pytest.approx(expected, rel=1e-14)


def fractions_solution(matrix, right):
    """Return the solution of linear equations by Gaussian elimination."""
    rows = [[*row, each] for row, each in zip(matrix, right, strict=True)]
    for i in range(len(rows)):
        rows[i] = [each / rows[i][i] for each in rows[i]]
        for j in range(len(rows)):
            if j != i:
                rows[j] = [a - rows[j][i] * c for a, c in zip(rows[j], rows[i], strict=True)]
    return [row[-1] for row in rows]


def test_bounds_of_two_aspects_are_quantiles_of_beta_distributions():
    # With a drop only into the first aspect, and the second one leading only there, all columns
    # but one lead from 2 to 1: the long-run odds are a beta variate over another one.
    counts = np.array([[0, 1000, 0, 0, 0, 0], [700, 300, 0, 0, 0, 0]])
    generator = np.random.default_rng(13)
    lower, upper = long_run_bounds(counts, np.array([1.0, 0.0]), 0.9, generator, samples=20_000)
    up = generator.beta(1000 + 1 / 6, 5 / 6, 200_000)
    down = generator.beta(700 + 5 / 6, 300 + 1 / 6, 200_000)
    expected = np.quantile(down / (up + down), [0.05, 0.95])
    # Five standard errors of a quantile: sqrt(p (1 - p) / n) / density, with the density of a
    # normal distribution at its 5 % quantile, 0.103 / sd, and sd = width / 3.29.
    error = 5 * math.sqrt(0.05 * 0.95 / 20_000) / 0.103 * np.ptp(expected) / 3.29
    assert [lower[0], upper[0]] == pytest.approx(expected, abs=error)
    assert [upper[1], lower[1]] == pytest.approx(1 - expected, abs=error)


def test_samples_that_round_to_zero_do_not_break_the_bounds():
    # Of samples of a gamma distribution of shape 1/202, 3 in 100 are below the smallest float.
    counts = np.zeros((2, 202), dtype=np.int64)
    bounds = long_run_bounds(counts, np.array([0.0, 1.0]), 0.95, np.random.default_rng(3))
    assert np.isfinite(bounds).all()


@given(st.integers(1, 4), st.data(), CONFIDENCES)
def test_bounds_of_long_run_shares_contain_them(k, data, confidence):
    row = st.lists(st.integers(0, 5), min_size=k + 1, max_size=k + 1).filter(any)
    actions = np.array([data.draw(row) for _ in range(k)])
    drop = np.array(data.draw(st.lists(st.integers(0, 3), min_size=k, max_size=k).filter(any)))
    lower, upper = long_run_bounds(actions, drop, confidence, generator(), 50)
    share = actions / actions.sum(axis=1, keepdims=True)
    assert_ordered(lower, long_run(share[:, :k], share[:, k], drop).shares, upper)


@pytest.mark.parametrize(
    ('rows', 'left', 'drop', 'named'),
    [
        ([[0.5, 0.4], [0, 1]], [0.1, 0], [0, 0], 'drop probabilities'),
        ([[1, 0], [math.nan, math.nan]], [0, math.nan], [1, 0], 'row 2 of'),
        ([[0.5, 0.25], [0, 1]], [0, 0], [1, 0], 'row 1 of'),
    ],
)
def test_invalid_chain_is_refused(rows, left, drop, named):
    arguments = [np.array(each, dtype=np.float64) for each in (rows, left, drop)]
    with pytest.raises(InvalidValueError, match=named):
        long_run(*arguments)


@pytest.mark.parametrize('row', [[math.nan, 0.5], [0.75, 0.5], [1.5, -0.5]])
def test_reach_and_plan_refuse_invalid_rows_and_times(row):
    rows, wanted, times = np.array([row, [0, 1]]), np.array([False, True]), np.ones(1)
    for function in (lambda: reach(rows, wanted), lambda: best_plan(rows[None], times, wanted)):
        with pytest.raises(InvalidValueError, match='row 1 of'):
            function()
    with pytest.raises(InvalidValueError, match='invalid times'):
        best_plan(np.eye(2)[None], 0 * times, wanted)


def random_case(seed):
    """Return transitions with many zeros, so that there are traps, times and wanted aspects."""
    generator = np.random.default_rng(seed)
    a, k = int(generator.integers(1, 4)), int(generator.integers(1, 6))
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
    # Its actions take this time.
    free = plan.action >= 0
    assert free.tolist() == (np.isfinite(plan.time) & ~wanted).tolist()
    time = time_of_policy(rows, times, wanted, np.where(free, plan.action, 0))
    assert time[free] == pytest.approx(plan.time[free], rel=1e-9)


def test_rare_transitions_do_not_blur_the_choice():
    # Both succeed once in 10^8 attempts, of 1.0 s and of 0.9 s.
    rows = np.array([[[1 - 1e-8, 1e-8], [0, 1]]] * 2)
    plan = best_plan(rows, np.array([1.0, 0.9]), np.array([False, True]))
    assert plan.action.tolist() == [1, -1]
    assert plan.time[0] == pytest.approx(0.9e8, rel=1e-12)
