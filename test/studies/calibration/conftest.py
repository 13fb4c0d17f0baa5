"""Fits to counts of known origin; no drops are simulated."""

from pathlib import Path

import numpy as np
import pytest
from scipy.special import expit

from resting_aspects_ros.studies.calibration import posterior
from resting_aspects_ros.studies.calibration.counts_file import make_surface_counts
from resting_aspects_ros.studies.calibration.fit import fit_counts, fit_shares
from resting_aspects_ros.studies.design import sobol

HEIGHTS = (10, 15, 20)
PER_POINT = 250


def box_shares(points, height):
    """Shares of the square faces of a box, as an invented simulation has them."""
    x, y = np.asarray(points).T
    logit = (
        (15 - height) / 4 + 1.5 * (x - 0.3) * (1 + height / 20) + (25 - height) / 10 * (y - 0.5)
    )
    return np.stack([expit(logit), expit(-logit)], axis=-1)


def surface_counts(counts, surface='a_table'):
    """Counts of boxes: of each the number on its square faces, and all."""
    parts = [
        {'name': f'box {h}', 'box': [20, 20, h], 'counts': {'z': int(k), 'rest': int(n - k)}}
        for h, (k, n) in zip(HEIGHTS, counts, strict=True)
    ]
    document = {
        'surface': surface,
        'source': 'Invented for a test',
        'conditions': {'height': '100 mm'},
        'parts': parts,
    }
    return make_surface_counts(document, Path())


class Invented:
    """Simulated counts and counted parts of the invented simulation."""

    def __init__(self):
        rng = np.random.default_rng(7)
        self.design = sobol(2, 64, 1)
        self.simulated = [rng.multinomial(PER_POINT, box_shares(self.design, h)) for h in HEIGHTS]
        self.surrogates = fit_shares(self.design, self.simulated, 0)

    def fit(self, counts, *, surface='a_table', discrepancy=True):
        given = surface_counts(counts, surface)
        return fit_counts(
            given, self.design, self.simulated, self.surrogates, discrepancy=discrepancy
        )

    def counted(self, point, drops, rng):
        """Counts at a point of the unit cube."""
        return [(rng.binomial(drops, box_shares([point], h)[0, 0]), drops) for h in HEIGHTS]


@pytest.fixture(scope='session')
def invented():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(posterior, 'GRID_SIDE', 60)  # a ninth of the points
        yield Invented()


@pytest.fixture(scope='session')
def agreeing(invented):
    """A fit to counts that the simulation explains."""
    return invented.fit(invented.counted((0.4, 0.6), 300, np.random.default_rng(3)))


@pytest.fixture(scope='session')
def contradicting(invented):
    """A fit to counts that no conditions explain: the flat box is upright, the tall one flat."""
    return invented.fit([(30, 300), (150, 300), (270, 300)], surface='no_table')
