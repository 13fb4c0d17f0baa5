"""Effects of known functions: Sobol indices, largest changes and findings, with few errors."""

import numpy as np
import pytest
from scipy.stats import binom

import resting_aspects_ros as ra
from resting_aspects_ros.studies import effects as effects_module
from resting_aspects_ros.studies.design import Factor, factorial, make_design
from resting_aspects_ros.studies.effects import (
    NOT_WORTH,
    OPEN,
    WORTH,
    LineCounts,
    curve_of,
    effects_of,
    findings_of,
    fresh_change,
    indices_of,
    largest_candidates,
    mean_change,
)
from resting_aspects_ros.studies.points import Case

FACTORS = [Factor('restitution', 0.3, 0.7), Factor('friction', 0.1, 0.5)]
# Drops of which only rounding to counts remains.
EXACT = 10**12


def constant(u):
    return np.full(len(u), 0.3)


def linear(u):
    return 0.3 + 0.3 * u[:, 0] + 0.15 * u[:, 1]


def interacting(u):
    return linear(u) + 0.6 * (u[:, 0] - 0.5) * (u[:, 1] - 0.5)


# Variances of the two linear terms and of the interaction.
PARTS = np.array([0.3**2, 0.15**2, 0.6**2 / 12]) / 12
INTERACTING = PARTS[:2] / PARTS.sum(), (PARTS[:2] + PARTS[2]) / PARTS.sum()


def line_counts(share, base_points, drops, seed=1):
    """Return counts of two classes along the lines of each factor, with shares of a function."""
    return counted(make_design('curves', FACTORS, base_points, seed), share, drops, seed)


def counted(design, share, drops, seed):
    p = share(design.points)
    count = np.random.default_rng(seed).binomial(drops, p) if drops < EXACT else drops * p
    table = np.column_stack([count, drops - count]).astype(np.int64)
    return [LineCounts.of(table, lines) for lines in design.lines]


def indices(lines, seed=0):
    return indices_of(lines, 0.95, np.random.default_rng(seed))


@pytest.mark.parametrize(
    ('share', 'first', 'total'),
    [(linear, [0.8, 0.2], [0.8, 0.2]), (interacting, *INTERACTING)],
    ids=['linear', 'interacting'],
)
def test_indices_are_those_of_a_known_function(share, first, total):
    found = indices(line_counts(share, 64, EXACT))
    # The variance of 64 points of a Sobol sequence is within 2 % of that over the square.
    np.testing.assert_allclose(found.first[0], first, atol=0.02)
    np.testing.assert_allclose(found.total[0], total, atol=0.02)
    np.testing.assert_allclose(found.first[-1], found.first[0], atol=1e-9)  # both classes vary


def test_indices_of_shares_that_do_not_vary_are_not_stated():
    found = indices(line_counts(constant, 16, 400))
    assert np.isnan(found.first).all()
    assert np.isnan(found.total_bounds).all()


def test_indices_of_a_factorial_design_are_those_of_its_levels():
    """A sum of two factors with 4 and 3 levels: variances of equally spaced levels."""
    levels = [Factor('a', 0, 1, 4), Factor('b', 0, 1, 3)]
    found = indices(counted(factorial(levels), linear, EXACT, 1))
    parts = np.array([0.3, 0.15]) ** 2 * [np.linspace(0, 1, n).var() for n in (4, 3)]
    np.testing.assert_allclose(found.first[0], parts / parts.sum(), atol=1e-6)
    np.testing.assert_allclose(found.total[0], parts / parts.sum(), atol=1e-6)


@pytest.mark.slow
def test_sampling_does_not_bias_the_indices(monkeypatch):
    """The mean of many studies with few drops is the index, and the intervals contain it."""
    monkeypatch.setattr(effects_module, 'RESAMPLES', 100)
    points = 8
    runs, inside, values = 20, np.zeros(4), []
    truth = np.concatenate(INTERACTING)
    for seed in range(runs):
        found = indices(line_counts(interacting, points, 100, seed), seed)
        low, high = np.hstack([found.first_bounds[:, 0], found.total_bounds[:, 0]])
        inside += (low <= truth) & (truth <= high)
        values.append(np.concatenate([found.first[0], found.total[0]]))
    error = np.std(values, axis=0) / np.sqrt(runs)
    # A base point more or less in a corner changes the variance over few points by some percent.
    assert (np.abs(np.mean(values, axis=0) - truth) < 4 * error + 0.2 / points).all()
    assert (inside >= binom.ppf(0.001, runs, 0.9)).all()


def test_mean_curve_is_within_its_interval():
    """The other factor moves all lines by up to 40 points, and their mean not at all."""
    runs, inside, levels = 100, 0, 7
    for seed in range(runs):
        line = line_counts(lambda u: 0.2 + 0.2 * u[:, 0] + 0.4 * u[:, 1], 8, 200, seed)[0]
        curve = curve_of(line, 0.9)
        # The shape of the curve, about its own mean.
        truth = 0.2 * (line.levels - 0.5) + line.weights @ curve.mean[:, 0]
        inside += ((curve.lower[:, 0] <= truth) & (truth <= curve.upper[:, 0])).sum()
    assert inside >= binom.ppf(0.001, runs * levels, 0.9)


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize(
    ('share', 'size'),
    [(constant, 0.0), (lambda u: 0.3 + 0.4 * u[:, 0] * (1 - u[:, 0]), 0.1)],
    ids=['none', 'hill'],
)
def test_largest_change_is_within_its_bounds(share, size):
    """The bounds allow for the choice of the largest one of many changes."""
    runs, inside = 100, 0
    for seed in range(runs):
        change = mean_change(line_counts(share, 8, 200, seed)[0], 0.9)
        inside += change.lower <= size <= change.upper
        assert change.lower <= change.size <= change.upper
    assert inside >= binom.ppf(0.001, runs, 0.9)


def test_fresh_drops_find_the_largest_change_without_bias():
    """Without an effect, the largest of many lines is lucky; fresh drops there are not."""
    runs, drops, lucky, fresh, above = 50, 400, [], [], 0
    for seed in range(runs):
        rng = np.random.default_rng(seed)
        line = line_counts(constant, 16, drops, seed)[0]
        (first, *_) = candidates = largest_candidates(line)
        lucky.append(np.ptp(line.shares, axis=1).max())
        tables = [rng.multinomial(8 * drops, [0.3, 0.7], 2) for _ in candidates]
        change = fresh_change(candidates, tables, 0.95)
        shares = tables[0] / tables[0].sum(axis=1, keepdims=True)
        fresh.append(shares[1, first.column] - shares[0, first.column])
        above += change.lower > 0
    error = np.sqrt(2 * 0.21 / (8 * drops) / runs)
    assert np.mean(lucky) > 0.08
    assert abs(np.mean(fresh)) < 4 * error
    assert above <= binom.ppf(0.999, runs, 0.05)


def verdicts(tolerance, drops, change=0.2, seed=1):
    """Return effects and verdicts for shares that restitution changes, and friction does not."""
    part, design = ra.load_part('cylinder_d20_h20'), make_design('curves', FACTORS, 16, 3)
    rng, share = np.random.default_rng(seed), 0.4 + change * design.points[:, 0]
    counts, fresh = (
        np.stack([count, n - count], axis=1)
        for count, n in ((rng.binomial(n, share), n) for n in (drops, 8 * drops))
    )
    none = np.zeros((len(counts), 5), dtype=int)
    case = Case(part, ra.find_aspects(part), counts, none, fresh=dict(enumerate(fresh)))
    effects = effects_of(case, design, 1, 0.95)
    found = findings_of(case, effects, design, FACTORS, tolerance, 0.95)
    return effects, [(finding.factor, finding.verdict) for finding in found]


def test_factor_that_moves_the_shares_is_worth_measuring():
    effects, found = verdicts(0.05, 400)
    assert effects.factors[0].lower < 0.2 < effects.factors[0].upper
    # The larger change is first.
    assert found == [('restitution', WORTH), ('friction', NOT_WORTH)]
    # A change near the tolerance is not decided.
    assert verdicts(0.2, 50)[1][0] == ('restitution', OPEN)


@pytest.mark.slow
def test_verdicts_have_few_errors(monkeypatch):
    """A change of exactly the tolerance is called larger in at most 5 % of the studies."""
    monkeypatch.setattr(effects_module, 'RESAMPLES', 2)
    runs, wrong, decided = 30, 0, 0
    for seed in range(runs):
        found = dict(verdicts(0.05, 400, change=0.05, seed=seed)[1])
        wrong += found['restitution'] == WORTH
        decided += found['friction'] == NOT_WORTH
    assert wrong <= binom.ppf(0.999, runs, 0.05)
    assert decided > 0.7 * runs


def test_impossible_points_cost_their_levels_and_lines():
    design = make_design('curves', FACTORS, 8, 1)
    table = np.full((len(design.points), 2), 50)
    possible = design.points[:, 0] >= 0.2
    table[~possible] = 0
    one, two = (LineCounts.of(table, lines) for lines in design.lines)
    assert one.levels.min() >= 0.2
    assert len(one.counts) == 8
    assert one.weights.sum() == pytest.approx(1)
    assert len(two.counts) == possible[design.lines[1].points[:, 0]].sum()
    assert (two.drops == 100).all()
