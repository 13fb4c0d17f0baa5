"""Objectives: shares and entropies against formulas, and the coverage of their posteriors."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binom

import resting_aspects_ros as ra
from resting_aspects_ros.studies.optimum import (
    Objective,
    compared,
    estimated,
    make_objective,
)

SHARE = Objective((1, 3), ((1, 3),))
ENTROPY = Objective((), ((1,), (2, 3)))


def test_values_are_those_of_the_formulas():
    counts = np.array([5, 7, 11, 1, 0, 2, 0, 0])
    assert SHARE.columns(counts).tolist() == [16, 10]
    assert ENTROPY.columns(counts).tolist() == [5, 18, 3]
    shares = np.array([[0.5, 0.5, 0.0], [1.0, 0.0, 0.0], [0.2, 0.8, 0.0]])
    expected = [np.log(2), 0, -0.2 * np.log(0.2) - 0.8 * np.log(0.8)]
    assert ENTROPY.values(shares) == pytest.approx(expected)
    assert (SHARE.sign, ENTROPY.sign) == (1, -1)
    # Parts that are in no aspect do not lower the entropy.
    lost = np.linspace(0, 1, 11)
    values = ENTROPY.values(np.column_stack([0.1 * (1 - lost), 0.9 * (1 - lost), lost]))
    assert (np.diff(values) > 0).all()
    assert values[-1] == pytest.approx(np.log(2))


def test_posterior_corrects_the_bias_of_the_entropy():
    rng = np.random.default_rng(0)
    shares, drops = np.array([0.4, 0.3, 0.2, 0.1, 0.0]), 100
    objective = Objective((), ((1,), (2,), (3,), (4,)))
    truth = float(objective.values(shares))
    tables = rng.multinomial(drops, shares, 400)
    plain = objective.values(tables / drops)
    posterior = np.array([objective.posterior(row, rng, 100).mean() for row in tables])
    error = plain.std() / np.sqrt(len(tables))
    # Miller (1955): -sum p ln p of shares is too small by (k - 1) / 2 n.
    assert plain.mean() - truth == pytest.approx(-3 / (2 * drops), abs=3 * error)
    assert abs(posterior.mean() - truth) < 3 / (4 * drops) + 3 * error


@pytest.mark.parametrize('objective', [SHARE, ENTROPY])
def test_intervals_of_fresh_drops_cover_the_truth(objective):
    rng = np.random.default_rng(1)
    runs, drops = 150, 400
    one, other = (np.array([[0.55, 0.45], [0.5, 0.5]]) if objective is SHARE else
                  np.array([[0.2, 0.75, 0.05], [0.3, 0.68, 0.02]]))  # fmt: skip
    values = objective.values(np.array([one, other]))
    difference = values[0] - values[1]
    covered = np.zeros(2)
    for _ in range(runs):
        counts = rng.multinomial(drops, one), rng.multinomial(drops, other)
        draws = [objective.posterior(each, rng, 1000) for each in counts]
        value = estimated(draws[0], 0.9)
        ((found,), _) = compared(draws, 0.9)
        covered += [
            value.lower <= values[0] <= value.upper,
            found.gain.lower <= difference <= found.gain.upper,
        ]
    low, high = binom.ppf([0.001, 0.999], runs, 0.9)
    assert ((low <= covered) & (covered <= high)).all()


@pytest.fixture(scope='module')
def box():
    return ra.find_aspects(ra.load_part('box_10x20x30'))


def test_classes_are_resolved_to_their_aspects(box):
    objective = make_objective(box, None, [1])
    members = [a.id for a in box.classes()[0]]
    assert list(objective.wanted) == members
    assert objective.text == f'largest share of aspects {members[0]} and {members[1]}'


@pytest.mark.parametrize(
    ('wanted', 'message'),
    [
        ({'wanted': [1], 'minimise_entropy': True}, 'expected one of wanted aspects'),
        ({'wanted': []}, 'expected at least one'),
        ({'wanted': [7]}, 'invalid wanted aspect 7: expected 1 to 6'),
        ({'wanted_classes': [4]}, 'invalid wanted symmetry class 4: expected 1 to 3'),
    ],
)
def test_invalid_objectives_are_named(wanted, message, box):
    with pytest.raises(ra.InvalidValueError, match=message):
        make_objective(box, **wanted)


def test_entropy_needs_several_classes():
    with pytest.raises(ra.InvalidValueError, match='several symmetry classes'):
        make_objective(ra.find_aspects(ra.load_part('tetrahedron')), minimise_entropy=True)


counts = st.lists(st.sampled_from([0, 0, 1, 5, 10_000]), min_size=3, max_size=3)


@given(counts, counts, st.sampled_from([SHARE, ENTROPY]), st.sampled_from([0.51, 0.8, 0.9999]))
def test_credible_intervals_of_an_objective_contain_the_mean(one, other, objective, confidence):
    rng = np.random.default_rng(1)
    draws = [objective.posterior(np.array(each), rng, 1000) for each in (one, other)]
    ((found,), certainty) = compared(draws, confidence)
    for each in (estimated(draws[0], confidence), found.gain):
        assert each.lower <= each.value <= each.upper
    assert 0 <= certainty <= 1
