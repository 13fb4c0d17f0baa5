"""The model of a cycle: picks against their exact distribution, times, and wrong values."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binom

from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.feeding.steady_state import (
    CycleTimes,
    cycle_time,
    limited_by,
    parts_per_minute,
    picks,
)

TIMES = CycleTimes(robot=1.0, vibrate=0.5, settle=0.3, image=0.2, supply=0.1, place=0.4)


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
    found = picks(2, np.array(0.5))
    without = dataclasses.replace(TIMES, place=0.0)
    assert cycle_time(without, found, np.array(1.0)) == pytest.approx(1.0 + 1.0 + 0.1)
    assert cycle_time(TIMES, found, np.array(1.0)) == pytest.approx(2.1 - 0.4 * 0.75)
    assert parts_per_minute(TIMES, found, np.array(1.0)) == pytest.approx(60 / 1.8)
    # It is at most the time of the feeder.
    assert CycleTimes(3.0, 0.1, 0.1, 0.1, place=1.5).overlap == pytest.approx(0.3)


@pytest.mark.parametrize(
    ('resource', 'name'), [('robot', 'robot'), ('vibrate', 'feeder'), ('image', 'vision')]
)
def test_longest_time_limits(resource, name):
    times = dataclasses.replace(CycleTimes(0.1, 0.1, 0.1, 0.1), **{resource: 2.0})
    found = picks(10, np.array(0.3))
    assert limited_by(times, found, found.mean) == name


def test_wrong_time_is_refused():
    for wrong in ({'robot': 0.0}, {'vibrate': -0.1}, {'settle': math.nan}, {'place': 1.5}):
        with pytest.raises(InvalidValueError, match='expected'):
            dataclasses.replace(TIMES, **wrong)
