"""The fit and the measured bodies of `make validate`."""

import numpy as np
import pytest
import validate_engine
from dropper import Dropper
from measured import cases
from sensitivity import fit

from resting_aspects_ros.core.aspects.aspect import find_aspects
from resting_aspects_ros.core.statistics.comparison import compare
from resting_aspects_ros.simulation.plan import make_job
from resting_aspects_ros.simulation.process_workers import ProcessWorkers


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


@pytest.mark.slow
def test_tables_match_the_drops(part, monkeypatch):
    workers = ProcessWorkers(1)
    try:
        dropper = Dropper(workers)
        dropper.parts = [part('l_bracket')]
        monkeypatch.setattr(validate_engine, 'STEP_DROPS', 250)
        monkeypatch.setattr(validate_engine, 'DECISION_DROPS', 250)
        (step,) = rows(validate_engine.time_step(dropper))
        (decided,) = rows(validate_engine.decision(dropper))
        mat = dropper.surfaces.get()
        coarse, fine = (
            dropper.distribution(
                part('l_bracket'), make_job(part('l_bracket'), mat, 1, **how), 250
            )
            for how in ({}, {'refinement': 2})
        )
    finally:
        workers.stop()
    found = compare(fine, coarse, np.random.default_rng(1))
    assert step[:3] == ['l_bracket', '160', f'{found.largest_deviation:+.4f}']
    name, energy, agree, stillness, *none = decided[:8]
    assert name == 'l_bracket'
    assert int(energy) + int(stillness) == 250
    assert int(energy) > 240
    assert agree == energy
    assert none == ['0', '0', '0', '0']
    # What runs on takes longer.
    assert float(decided[9]) > float(decided[8])


def rows(lines):
    """The cells of the tables' rows that begin with the name of a part."""
    return [
        [cell.strip() for cell in line.split('|')[1:-1]]
        for line in lines
        if line.startswith('| l_bracket')
    ]
