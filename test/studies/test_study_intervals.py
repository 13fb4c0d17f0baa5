"""Intervals of studies contain their estimates, also for counts at the border."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from resting_aspects_ros.studies.objective import Objective, compared, estimated
from resting_aspects_ros.studies.propagate import sampled_shares

confidences = st.sampled_from([0.51, 0.8, 0.95, 0.9999])
counts = st.lists(st.sampled_from([0, 0, 1, 5, 10_000]), min_size=3, max_size=3)
SHARE, ENTROPY = Objective((1,), ((1,), (2,))), Objective((), ((1,), (2,)))


@given(counts, counts, st.sampled_from([SHARE, ENTROPY]), confidences)
def test_credible_intervals_of_an_objective_contain_the_mean(one, other, objective, confidence):
    rng = np.random.default_rng(1)
    draws = [objective.posterior(np.array(each), rng, 1000) for each in (one, other)]
    ((found,), certainty) = compared(draws, confidence)
    for each in (estimated(draws[0], confidence), found.gain):
        assert each.lower <= each.value <= each.upper
    assert 0 <= certainty <= 1


def test_interval_of_skewed_draws_contains_the_mean():
    found = estimated(np.array([0.0] * 99 + [1.0]), 0.95)
    assert (found.lower, found.value, found.upper) == (0.0, 0.01, 0.01)


@given(st.lists(st.tuples(*[st.integers(0, 10)] * 2), min_size=2, max_size=9), confidences)
def test_intervals_with_the_surface_contain_the_share_and_those_of_the_sampling(rows, confidence):
    found = sampled_shares(np.array(rows), 20, confidence)
    for one, both in zip(found.sampling, found.total, strict=True):
        assert 0 <= both.lower <= both.probability <= both.upper <= 1
        assert one.lower <= one.probability <= one.upper
