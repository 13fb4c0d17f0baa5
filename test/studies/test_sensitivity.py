"""Sobol indices of known functions, and findings of shares that are known."""

import re

import numpy as np
import pytest
from scipy.stats import sobol_indices

import resting_aspects_ros as ra
from resting_aspects_ros.studies.design import Factor
from resting_aspects_ros.studies.designs import sobol
from resting_aspects_ros.studies.effects import effects_of, entropy
from resting_aspects_ros.studies.findings import NOT_WORTH, OPEN, WORTH, findings_of
from resting_aspects_ros.studies.sensitivity import _saltelli, indices_of
from resting_aspects_ros.studies.share_surrogate import ShareSurrogate
from resting_aspects_ros.studies.study_cases import StudyCase

FACTORS = [Factor('restitution', 0.3, 0.7), Factor('friction', 0.1, 0.5)]
# Sobol indices of the function of Ishigami and Homma (1990) with a = 7, b = 0.1.
A, B = 7.0, 0.1
V1 = 0.5 * (1 + B * np.pi**4 / 5) ** 2
V2 = A**2 / 8
V13 = B**2 * np.pi**8 * (1 / 18 - 1 / 50)
ISHIGAMI_FIRST = np.array([V1, V2, 0]) / (V1 + V2 + V13)
ISHIGAMI_TOTAL = np.array([V1 + V13, V2, V13]) / (V1 + V2 + V13)
# Of six estimates with 7 degrees of freedom, the largest error has this many standard errors with
# a probability of 0.001.
LARGEST = 7.5


def ishigami(u):
    x, y, z = np.pi * (2 * u.T - 1)
    return np.sin(x) + A * np.sin(y) ** 2 + B * z**4 * np.sin(x)


def test_indices_of_ishigami_are_within_their_errors():
    found = indices_of(lambda u: ishigami(u)[:, None], 3, 1)
    assert found.variance[0] == pytest.approx(V1 + V2 + V13, rel=0.02)
    for estimate, error, truth in (
        (found.first[0], found.first_error[0], ISHIGAMI_FIRST),
        (found.total[0], found.total_error[0], ISHIGAMI_TOTAL),
    ):
        assert (np.abs(estimate - truth) < LARGEST * error).all()
        assert error.max() < 0.05


@pytest.mark.slow
def test_indices_of_ishigami_from_drops_are_within_their_errors():
    # Shares that are linear in the function have its indices.
    generator = np.random.default_rng(1)
    points = sobol(3, 256, 5)
    count = generator.binomial(2000, 0.35 + 0.02 * ishigami(points))
    surrogate = ShareSurrogate.fit(points, np.column_stack([count, 2000 - count]), generator)
    found = indices_of(
        surrogate.shares, 3, 1, lambda u: surrogate.draws(u, np.random.default_rng(0), 100)
    )
    assert (np.abs(found.first[0] - ISHIGAMI_FIRST) < 4 * found.first_error[0]).all()
    assert (np.abs(found.total[0] - ISHIGAMI_TOTAL) < 4 * found.total_error[0]).all()
    assert found.total_error[0].max() < 0.15


def test_indices_of_all_outputs_are_weighted_by_their_variances():
    found = indices_of(lambda u: np.column_stack([2 * u[:, 0], u[:, 1], 0 * u[:, 0] + 1]), 2, 1)
    np.testing.assert_allclose(found.first[:2], np.eye(2), atol=0.02)
    assert found.first[2].tolist() == [0, 0]  # a constant depends on nothing
    np.testing.assert_allclose(found.total[3], [0.8, 0.2], atol=0.01)


def test_entropy():
    assert entropy(np.array([1.0, 0.0])) == 0
    assert entropy(np.full(4, 0.25)) == pytest.approx(2)


@pytest.fixture(scope='module')
def cylinder():
    part = ra.load_part('cylinder_d20_h20')
    return part, ra.find_aspects(part)


def case_of(cylinder, share, drops=4000, seed=1):
    """Counts of drops whose share of the first class is a function of the point."""
    points = sobol(2, 32, 3)
    count = np.random.default_rng(seed).binomial(drops, share(points))
    classes = np.column_stack([count, drops - count])
    return StudyCase(*cylinder, classes, np.zeros((32, 5), dtype=int)), points


def verdicts(case, points, tolerance):
    effects = effects_of(case, points, 1, 0.95)
    found = findings_of(case, effects, FACTORS, tolerance, 0.95)
    return effects, {finding.factor: finding for finding in found}


def test_factor_that_moves_the_shares_is_worth_measuring(cylinder):
    case, points = case_of(cylinder, lambda u: 0.4 + 0.2 * u[:, 0])
    effects, found = verdicts(case, points, 0.05)
    change = effects.changes[0]
    assert change.lower < 0.2 < change.upper
    assert found['restitution'].verdict == WORTH
    assert found['restitution'].sentence.endswith(
        'more than the tolerance of 5 points: measuring it is worth while.'
    )
    assert found['friction'].verdict == NOT_WORTH
    assert 'measuring it is not worth while' in found['friction'].text
    assert list(found) == ['restitution', 'friction']  # the larger one first
    assert effects.indices.first[0, 0] > 0.9
    assert effects.indices.total[0, 1] < 0.1
    curve = effects.curves[0]
    truth = 0.4 + 0.2 * curve.shares
    inside = (curve.lower[:, 0] <= truth) & (truth <= curve.upper[:, 0])
    assert inside.mean() > 0.5


def test_change_near_the_tolerance_is_not_decided(cylinder):
    case, points = case_of(cylinder, lambda u: 0.4 + 0.2 * u[:, 0], drops=200)
    _, found = verdicts(case, points, 0.2)
    assert found['restitution'].verdict == OPEN
    # The change is nearly the tolerance, so that no practical number of points would decide.
    text = found['restitution'].text
    assert re.search(r'(about \d+|more than 100) times as many points would decide', text)


def test_stated_number_of_points_decides(cylinder):
    """Intervals are shorter by the square root of the stated number, and then decide."""
    case, points = case_of(cylinder, lambda u: 0.4 + 0.2 * u[:, 0], drops=50)
    _, found = verdicts(case, points, 0.16)
    assert found['restitution'].verdict == OPEN
    times = int(re.search(r'about (\d+) times', found['restitution'].text)[1])
    # Twice as many as stated, because the change itself is known with an error only.
    case, points = case_of(cylinder, lambda u: 0.4 + 0.2 * u[:, 0], drops=100 * times)
    _, found = verdicts(case, points, 0.16)
    assert found['restitution'].verdict == WORTH


def test_surrogate_that_explains_little_decides_nothing(cylinder):
    # A share that oscillates faster than the points.
    case, points = case_of(cylinder, lambda u: 0.5 + 0.3 * np.sign(np.sin(200 * u[:, 0])))
    effects, found = verdicts(case, points, 0.05)
    assert not effects.reliable(0.05)
    assert {finding.verdict for finding in found.values()} == {OPEN}
    assert 'explains only' in found['restitution'].text


def test_part_with_one_class_has_no_effects():
    part = ra.load_part('tetrahedron')
    aspects = ra.find_aspects(part)
    case = StudyCase(part, aspects, np.full((32, 1), 9), np.zeros((32, 5), dtype=int))
    effects, found = verdicts(case, sobol(2, 32, 3), 0.05)
    assert effects is None
    assert found['friction'].verdict == NOT_WORTH
    assert 'cannot move the shares' in found['friction'].text


@pytest.mark.parametrize('factors', [1, 2])
@pytest.mark.parametrize('constant', [0, 1, 2])
def test_indices_of_one_output_beside_constant_ones(factors, constant):
    # The only output that varies is linear in the first factor, so its indices are 1 and 0.
    def function(points):
        return np.column_stack([points[:, 0], *[np.ones(len(points))] * constant])

    found = indices_of(function, factors, 1)
    expected = np.zeros((constant + 2, factors))
    expected[[0, -1], 0] = 1
    for indices in (found.first, found.total):
        np.testing.assert_allclose(indices, expected, atol=1e-3)


def test_indices_are_those_of_scipy():
    tables = np.random.default_rng(1).random((5, 4, 64))
    function = {'f_A': tables[0], 'f_B': tables[1], 'f_AB': tables[2:]}
    middle = np.concatenate([tables[0], tables[1]], axis=1).mean(axis=1)[:, None]
    theirs = sobol_indices(func={k: each - middle for k, each in function.items()}, n=64)
    first, total, _ = _saltelli(tables)
    np.testing.assert_allclose(first[:-1], theirs.first_order, atol=1e-12)
    np.testing.assert_allclose(total[:-1], theirs.total_order, atol=1e-12)
