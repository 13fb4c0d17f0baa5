"""The fit and the measured bodies of `make validate`."""

import dataclasses

import numpy as np
import pytest
from validation import engine as validate_engine
from validation import engines as validate_engines
from validation.dropper import Dropper
from validation.measured import cases
from validation.sensitivity import fit

from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.simulation.job import make_job
from resting_aspects_ros.simulation.workers import LocalWorkers, drop_range
from resting_aspects_ros.statistics.distribution import aspect_ids


@pytest.fixture(scope='module')
def problem():
    generator = np.random.default_rng(1)
    slopes = generator.standard_normal((12, 4))
    return generator.standard_normal(12) / 20, slopes, generator.uniform(0.01, 0.05, 12)


def best_step(residuals, slopes, deviations):
    rows = slopes / deviations[:, None]
    return np.linalg.lstsq(rows, -residuals / deviations, rcond=None)[0]


def test_step_is_the_weighted_least_squares_solution(problem):
    np.testing.assert_allclose(fit(*problem).step, best_step(*problem), atol=1e-12)


def test_left_out_matches_a_fit_of_all_other_cases(problem):
    residuals, slopes, deviations = problem
    found = fit(*problem).left_out
    for k in range(len(residuals)):
        others = np.arange(len(residuals)) != k
        step = best_step(residuals[others], slopes[others], deviations[others])
        assert found[k] == pytest.approx(residuals[k] + slopes[k] @ step, abs=1e-10)


def test_spread_matches_fits_to_noisy_measurements(problem):
    residuals, slopes, deviations = problem
    generator = np.random.default_rng(2)
    n = 4000
    noise = generator.standard_normal((n, len(residuals))) * deviations
    steps = np.array([fit(residuals + each, slopes, deviations).step for each in noise])
    # The standard error of a standard deviation is 1 / sqrt(2 n), of itself.
    np.testing.assert_allclose(steps.std(axis=0), fit(*problem).spread, rtol=4 / np.sqrt(2 * n))


@pytest.mark.slow
def test_measured_faces_are_aspects_of_the_bodies():
    for case in cases():
        aspects = find_aspects(case.part)
        down = np.array([a.down_in_part for a in aspects.aspects])
        kinds = {a.id: case.hits(a.down_in_part[None]) for a in aspects.aspects}
        on = [a for a in aspects.aspects if kinds[a.id]]
        assert 0 < len(on) < len(aspects), case.name
        # All faces that were counted, and the shares of all faces that were not are the rest.
        assert case.hits(down) == sum(kinds.values())
        assert 0 < case.share < 1
    side = next(case for case in cases() if case.name.startswith('coin'))
    assert [a.rolls for a in find_aspects(side.part).aspects if side.hits(a.down_in_part[None])]


@pytest.fixture
def dropper(part):
    workers = LocalWorkers(1)
    found = Dropper(workers)
    found.parts = [part('l_bracket')]
    yield found
    workers.stop()


def test_convergence_states_the_drops_that_end_differently(dropper, monkeypatch):
    n = 2000
    monkeypatch.setattr(validate_engine, 'DROPS', n)
    monkeypatch.setattr(validate_engine, 'AIMS', {'thrown': (0.1, 0.005)})
    ((_, surface, differ, aim, aspect, shift, interval, _),) = rows(
        validate_engine.convergence(dropper)
    )
    (shape,) = dropper.parts
    job = make_job(shape, dropper.surfaces.get('thrown'), 1)
    aspects = find_aspects(shape)
    before, after = (
        aspect_ids(aspects, drop_range(each, 0, n))
        for each in (job, dataclasses.replace(job, refinement=4))
    )
    assert (surface, aim) == ('thrown', '0.1')
    changed = before != after
    assert changed.any()
    assert differ == f'{changed.mean():.4f}'
    moved = (after == int(aspect)).mean() - (before == int(aspect)).mean()
    assert shift == f'{moved:+.4f}'
    # Two standard errors of a difference of shares of the same drops.
    c = (changed & ((before == int(aspect)) | (after == int(aspect)))).mean()
    low, high = map(float, interval.split(' to '))
    assert (high - low) / 2 == pytest.approx(1.96 * np.sqrt((c - moved**2) / n), rel=0.1)


def test_decision_adds_up_to_all_drops(dropper, monkeypatch):
    monkeypatch.setattr(validate_engine, 'DECISION_DROPS', 250)
    (decided,) = rows(validate_engine.decision(dropper))
    name, energy, agree, stillness, *none = decided[:8]
    assert name == 'l_bracket'
    assert int(energy) + int(stillness) == 250
    assert int(energy) > 240
    assert agree == energy
    assert none == ['0', '0', '0', '0']
    # What runs on takes longer.
    assert float(decided[9]) > float(decided[8])


def test_difference_of_equal_engines_is_within_chance():
    generator = np.random.default_rng(1)
    p, n, samples = [0.5, 0.3, 0.19, 0.01], 1000, 400
    above = 0
    for _ in range(samples):
        one, other = (generator.multinomial(n, p, size=2) for _ in range(2))
        statistic, value, *_ = validate_engines.difference(one, other).split(' | ')
        assert statistic.endswith('(6)')
        above += float(value) < 0.05
    # The rare end makes the statistic only roughly chi-square.
    assert abs(above / samples - 0.05) < 4 * np.sqrt(0.05 * 0.95 / samples)


def test_difference_of_two_shares_is_that_of_a_fourfold_table():
    one, other = np.array([[300, 700, 0]]), np.array([[360, 640, 0]])
    cells = validate_engines.difference(one, other).split(' | ')
    # Pearson's statistic of a table of two rows and two columns.
    statistic = 2000 * (300 * 640 - 360 * 700) ** 2 / (1000 * 1000 * 660 * 1340)
    assert cells[0] == f'{statistic:.1f} (1)'
    assert abs(float(cells[2])) == pytest.approx(0.06)
    error = 1.96 * np.sqrt((0.3 * 0.7 + 0.36 * 0.64) / 1000)
    low, high = map(float, cells[3].split(' to '))
    assert (high - low) / 2 == pytest.approx(error, abs=1e-4)


def rows(lines):
    """The cells of the tables' rows that begin with the name of a part."""
    return [
        [cell.strip() for cell in line.split('|')[1:-1]]
        for line in lines
        if line.startswith('| l_bracket')
    ]
