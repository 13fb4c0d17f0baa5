"""Fits to counts of known origin, with drops of a simulation that is invented."""

import dataclasses
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.special import expit

from resting_aspects_ros.studies.calibration.counts_file import make_surface_counts
from resting_aspects_ros.studies.calibration.posterior import fit_surface

HEIGHTS = (10, 15, 20)


def box_shares(points, height):
    """Return the shares (n, 2) of the square faces of a box and of its other faces."""
    x, y = np.asarray(points).T
    logit = (
        (15 - height) / 4 + 1.5 * (x - 0.3) * (1 + height / 20) + (25 - height) / 10 * (y - 0.5)
    )
    return np.stack([expit(logit), expit(-logit)], axis=-1)


@cache
def boxes(heights):
    """Return counts of boxes, whose numbers are replaced."""
    counts = {'z': 1, 'rest': 1}
    parts = [{'name': f'box {h}', 'box': [20, 20, h], 'counts': counts} for h in heights]
    document = {'source': 'Invented', 'conditions': {'height': '100 mm'}, 'parts': parts}
    return make_surface_counts(document, Path())


def surface_counts(counts, surface='a_table', heights=HEIGHTS):
    """Return counts of boxes: of each the number on its square faces, and all."""
    given = boxes(heights)
    parts = tuple(
        dataclasses.replace(part, counts=np.array([k, n - k]))
        for part, (k, n) in zip(given.parts, counts, strict=True)
    )
    return dataclasses.replace(given, surface=surface, parts=parts)


def fitted(counts, *, surface='a_table', per_point=1000, points=64, seed=1, **options):
    """Return the fit of counts (k, n) of each box to the invented simulation."""
    rng = np.random.default_rng(seed)

    def simulate(where):
        return [rng.multinomial(per_point, box_shares(where, h)) for h in HEIGHTS]

    return fit_surface(
        surface_counts(counts, surface), simulate, points=points, seed=seed, **options
    )


def counted(point, drops, rng):
    """Return counts of the boxes at a point of the unit cube."""
    return [(rng.binomial(drops, box_shares([point], h)[0, 0]), drops) for h in HEIGHTS]


@pytest.fixture(scope='session')
def agreeing():
    """A fit to counts that the simulation explains."""
    return fitted(counted((0.4, 0.6), 300, np.random.default_rng(3)))


@pytest.fixture(scope='session')
def contradicting():
    """A fit to counts that no conditions explain: the flat box is upright, the tall one flat."""
    return fitted([(30, 300), (150, 300), (270, 300)], surface='no_table')
