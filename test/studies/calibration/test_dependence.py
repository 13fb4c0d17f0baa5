"""Dependence of the errors of surrogates, on simulations that are invented for it."""

import numpy as np
import pytest
from scipy.special import expit

from resting_aspects_ros.studies.calibration import dependence
from resting_aspects_ros.studies.calibration.dependence import find_dependence
from resting_aspects_ros.studies.calibration.fit import fit_shares
from resting_aspects_ros.studies.calibration.likelihood import (
    likelihood_powers,
    own_discrepancies,
)
from resting_aspects_ros.studies.calibration.posterior import DISCREPANCIES
from resting_aspects_ros.studies.design import sobol

DROPS = 2000
PARTS = 6


def simulated(points, common, rng):
    """Counts of parts whose logits are linear, but for equal waves or for others of each part."""
    x, y = points.T
    tables = []
    for _ in range(PARTS):
        a, b = (40.0, 37.0) if common else rng.uniform(30, 60, 2)
        wave = 0.35 * np.sin(a * x) * np.sin(b * y)
        share = expit(1.5 * (x - 0.5) + (y - 0.5) + wave)
        tables.append(rng.multinomial(DROPS, np.stack([share, 1 - share], axis=1)))
    return tables


@pytest.mark.slow
def test_equal_errors_of_all_parts_are_dependent(monkeypatch):
    monkeypatch.setattr(dependence, 'PLACES', 512)
    points = sobol(2, 32, 1)
    found = []
    for common in (True, False):
        tables = simulated(points, common, np.random.default_rng(3))
        found.append(find_dependence(fit_shares(points, tables, 0), points, tables, 0))
    # Six equal errors are one: ideally six times the factor of independent ones.
    assert found[0] > 2 * found[1]


@pytest.mark.slow
def test_surrogates_that_fit_are_independent(invented):
    found = find_dependence(invented.surrogates, invented.design, invented.simulated, 0)
    assert found <= 3


def test_power_is_that_of_the_share_of_the_variance():
    # Surrogate and sampling add equal variances, and the surrogate's counts three times.
    assert likelihood_powers(np.array([0.01]), np.array([100]), 3.0) == pytest.approx([1 / 2])
    assert likelihood_powers(np.array([0.0, 0.1]), np.array([100, 9]), 1.0).tolist() == [1, 1]


def test_discrepancies_of_parts_vary_about_the_common_one():
    own = own_discrepancies(DISCREPANCIES)
    assert own.sum(axis=1) == pytest.approx(1)
    rng = np.random.default_rng(1)
    k = 8
    drawn = DISCREPANCIES[k] * np.sqrt(4 / rng.chisquare(4, 20_000))
    edges = np.sqrt(DISCREPANCIES[1:] * DISCREPANCIES[:-1])
    shares = np.bincount(np.searchsorted(edges, drawn), minlength=len(own)) / len(drawn)
    assert np.abs(shares - own[k]).max() < 4 * np.sqrt(0.25 / len(drawn))
