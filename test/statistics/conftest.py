"""Counts at the border of what is possible, and batches whose shares scatter."""

import numpy as np
from hypothesis import strategies as st

COUNT = st.one_of(st.sampled_from([0, 0, 1, 2, 10**12]), st.integers(0, 300))
CONFIDENCES = st.one_of(st.sampled_from([0.5000001, 0.95, 0.999999]), st.floats(0.501, 0.9999))


def generator(seed=1):
    return np.random.default_rng(seed)


def assert_ordered(lower, value, upper):
    assert np.all(np.asarray(lower) <= value), (lower, value, upper)
    assert np.all(value <= np.asarray(upper)), (lower, value, upper)


def batches(rng, shares, number, deviation, size=30):
    """Return counts of batches whose true shares have this standard deviation (Dirichlet)."""
    if deviation:
        within = deviation**2 / np.mean(shares * (1 - shares))
        shares = rng.dirichlet(shares * (1 / within - 1), size=number)
    return rng.multinomial(size, shares, size=number)
