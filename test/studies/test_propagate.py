"""The uncertainty of a surface, carried through to the distribution of a part."""

import dataclasses
import html
import json
from functools import cache

import numpy as np
import pytest
from scipy.stats import chi2

import resting_aspects_ros as ra
from resting_aspects_ros.api.conditions import shipped_surfaces
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.statistics.distribution import OUTSIDE as OTHER
from resting_aspects_ros.studies.propagate import (
    PropagatedResult,
    UncertainSurface,
    uncertain_surface,
)


@pytest.fixture(scope='module')
def part():
    return ra.load_part('l_bracket')


@cache
def aspects_of(part):
    return find_aspects(part)


def made_result(part, probabilities, m, rng):
    """Return a result with counts that are drawn from probabilities (s,) of the first aspect."""
    aspects = aspects_of(part)
    counts = np.zeros((len(probabilities), len(aspects)), dtype=np.int64)
    counts[:, 0] = rng.binomial(m, probabilities)
    counts[:, 1] = m - counts[:, 0]
    conditions = shipped_surfaces().get()
    samples = ({'friction': 0.3},) * len(counts)
    other = np.zeros((len(counts), len(OTHER)), dtype=np.int64)
    return PropagatedResult(part, aspects, conditions, samples, counts, other, m, 1, 0.95, True)


def test_variance_between_samples_is_unbiased(part):
    """Law of total variance: what is left without the sampling is the spread of the surface."""
    rng, s, m, spread, runs = np.random.default_rng(5), 32, 200, 0.05, 400
    found = []
    for _ in range(runs):
        result = made_result(part, 0.4 + spread * rng.standard_normal(s), m, rng)
        found.append(result.by_aspect.between[0])
    sampling = 0.24 / m
    # Standard deviation of a variance of s values, and of the mean of the runs.
    error = (spread**2 + sampling) * np.sqrt(2 / (s - 1) / runs)
    assert abs(np.mean(found) - spread**2) < 4 * error


def test_interval_covers_the_true_surface(part):
    """The truth is one more draw of the surface: about 95 % of intervals contain it."""
    rng, s, m, spread, runs = np.random.default_rng(6), 32, 300, 0.05, 500
    inside = alone = 0
    for _ in range(runs):
        result = made_result(part, 0.4 + spread * rng.standard_normal(s), m, rng)
        truth = 0.4 + spread * rng.standard_normal()
        inside += result.by_aspect.total[0].lower <= truth <= result.by_aspect.total[0].upper
        alone += result.by_aspect.sampling[0].lower <= truth <= result.by_aspect.sampling[0].upper
    # 4 standard deviations of a share of the runs, and 2 points: s samples make a t distribution.
    assert abs(inside / runs - 0.95) < 4 * np.sqrt(0.95 * 0.05 / runs) + 0.02
    assert alone / runs < 0.6


def test_equal_shares_have_the_sampling_interval(part):
    result = made_result(part, np.full(16, 0.4), 100, np.random.default_rng(7))
    counts = np.zeros_like(result.counts)
    counts[:, 0], counts[:, 1] = 40, 60
    result = dataclasses.replace(result, counts=counts)
    for one, both in zip(result.by_aspect.sampling, result.by_aspect.total, strict=True):
        assert dataclasses.astuple(both) == pytest.approx(dataclasses.astuple(one), abs=1e-12)
    assert result.sentence().startswith('No effect')


def test_test_of_homogeneity_has_its_level(part):
    """With one surface for all samples, 5 % of the p values are below 0.05."""
    rng, runs = np.random.default_rng(8), 600
    low = [made_result(part, np.full(32, 0.4), 200, rng).by_class.p_value for _ in range(runs)]
    assert abs(np.mean(np.array(low) < 0.05) - 0.05) < 4 * np.sqrt(0.05 * 0.95 / runs)


def test_limit_of_the_surface_covers_its_deviation(part):
    """Limits of k classes hold together in 95 % of the runs or more, one of them more often."""
    rng, runs, spread = np.random.default_rng(9), 400, 0.03
    limits = [
        made_result(part, 0.4 + spread * rng.standard_normal(16), 200, rng).by_aspect.between_limit
        for _ in range(runs)
    ]
    share = 1 - 0.05 / 5
    missed = np.mean([limit[0] < spread**2 for limit in limits])
    assert missed < 1 - share + 4 * np.sqrt(share * (1 - share) / runs)


@pytest.mark.parametrize(('spread', 'shown'), [(0.08, True), (0.005, False)])
def test_sentence_follows_test_and_variances(part, spread, shown):
    """Alternating shares have a known variance: spread^2 s / (s - 1), and p (1 - p) / m less."""
    s, m = 32, 1000
    counts = np.zeros((s, 5), dtype=np.int64)
    counts[:, 0] = np.round(m * np.where(np.arange(s) % 2, 0.4 + spread, 0.4 - spread))
    counts[:, 1] = m - counts[:, 0]
    result = dataclasses.replace(
        made_result(part, np.full(s, 0.4), m, np.random.default_rng(7)), counts=counts
    )
    found = result.by_class
    # Pearson's statistic of a 32 x 2 table: s m spread^2 / (p (1 - p)).
    assert found.p_value == pytest.approx(chi2.sf(s * m * spread**2 / 0.24, s - 1))
    between = spread**2 * s / (s - 1) - (0.24 - spread**2) / (m - 1)
    assert found.between[0] == pytest.approx(max(between, 0))
    if not shown:
        assert result.sentence().startswith('No effect of the unknown surface is shown')
        limit = 100 * np.sqrt(found.between_limit.max())
        assert f'at most {limit:.1f} points' in result.sentence()
        return
    part_of_surface = between * 33 / 32 / (between * 33 / 32 + 0.24 / s / m)
    assert f'causes {100 * part_of_surface:.0f} % of the variance' in result.sentence()


def test_page_shows_both_intervals(part, tmp_path):
    rng = np.random.default_rng(6)
    result = made_result(part, 0.4 + 0.08 * rng.standard_normal(32), 300, rng)
    page = result.report(tmp_path).read_text(encoding='utf-8')
    one, both = result.by_class.sampling[0], result.by_class.total[0]
    for each in (one, both):
        assert f'{100 * each.lower:.1f} to {100 * each.upper:.1f} %' in page
    assert result.sentence() in html.unescape(page)
    assert page.count('data:image/png') == len(result.case.class_names)


def test_point_mass_has_independent_drops(part, here):
    """Equal draws are dropped with different seeds, so that only sampling is left."""
    surface = UncertainSurface(shipped_surfaces().get(), ({'friction': 0.3},) * 8)
    result = ra.propagate(part, surface, 320, samples=8, workers=here(), seed=3)
    assert result.complete
    assert result.drops == 320
    assert result.counts.sum() + sum(result.other_ends().values()) == 320
    assert len(np.unique(result.counts, axis=0)) > 1
    # Less than what 4 standard deviations of the variance of 8 shares can feign.
    limit = 4 * np.sqrt(2 / 7) * 0.25 / result.drops_per_sample
    assert (result.by_aspect.between < limit).all()


@pytest.mark.slow
def test_spread_of_two_heights_is_found(part, here):
    """Half of the samples are dropped from 1 mm, the others from 0.3 m."""
    draws = ({'height': 0.001},) * 4 + ({'height': 0.3},) * 4
    surface = UncertainSurface(shipped_surfaces().get(), draws)
    result = ra.propagate(part, surface, 8000, samples=8, workers=here(), seed=4)
    low = np.array([sample['height'] < 0.01 for sample in result.samples])
    shares = result.counts / result.drops_per_sample
    gap = shares[low].mean(axis=0) - shares[~low].mean(axis=0)
    sampling = 0.25 / result.drops_per_sample
    assert np.abs(gap).max() > 4 * np.sqrt(sampling / 2)  # each mean has 4 samples
    # Two groups of 4 values: their variance is gap^2 / 4 * 8 / 7, and the scatter within them.
    scatter = 4 * np.sqrt(2 / 6) * sampling
    assert np.abs(result.by_aspect.between - gap**2 / 4 * 8 / 7).max() < scatter
    assert result.sentence().startswith('Not knowing the surface')


def test_impossible_sample_is_refused_before_the_first_drop(part, here):
    base = shipped_surfaces().get().changed(height_of=1)  # centre of mass
    workers = here()
    draws = ({'height': 0.001},) + ({'height': 0.3},) * 7
    with pytest.raises(ra.InvalidValueError, match='height'):
        ra.propagate(part, UncertainSurface(base, draws), 80, samples=8, workers=workers)
    assert workers.submitted == []


def test_results_state_drops_in_no_aspect(part):
    result = made_result(part, np.full(8, 0.4), 100, np.random.default_rng(7))
    counts, other = (
        result.counts - [1, 0, 0, 0, 0],
        result.other + np.eye(len(OTHER), dtype=np.int64)[0],
    )
    result = dataclasses.replace(result, counts=counts, other=other)
    assert result.document()['other']['unclassified'] == 8
    assert '1.00 %   (8 drops)' in str(result)


def test_surface_without_draws_is_refused(tmp_path):
    file = tmp_path / 'calibration.json'
    file.write_text(json.dumps({'surface': 'steel', 'conditions': {}}))
    for given in (file, tmp_path / 'absent.json', {}):
        with pytest.raises(ra.InvalidValueError, match='resting_aspects calibrate'):
            uncertain_surface(given)
