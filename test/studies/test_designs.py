"""Designs: which points are simulated."""

import numpy as np
import pytest

from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.studies.design import Factor
from resting_aspects_ros.studies.designs import design_points, sobol

ONE, TWO = Factor('friction', 0.1, 0.5, 3), Factor('restitution', 0.2, 0.8)


def test_factorial_design_has_all_combinations():
    points = design_points('factorial', [ONE, TWO], [], 1)
    assert len(points) == 9
    assert {tuple(p) for p in points.tolist()} == {
        (a, b) for a in (0, 0.5, 1) for b in (0, 0.5, 1)
    }


def test_factorial_design_that_is_too_large_is_refused():
    many = [Factor(f'f{k}', 0, 1, 10) for k in range(6)]
    with pytest.raises(InvalidValueError, match='expected at most 100000 points together, not 10'):
        design_points('factorial', many, [], 1)


@pytest.mark.parametrize('design', ['lhs', 'sobol'])
def test_points_that_are_added_leave_the_others_as_they_are(design):
    factors = [TWO, Factor('friction', 0.1, 0.5), Factor('height', 0.1, 0.5)]
    first = design_points(design, factors, [16], 1)
    more = design_points(design, factors, [16, 8], 1)
    assert more.shape == (24, 3)
    assert (more[:16] == first).all()
    assert (design_points(design, factors, [16], 2) != first).any()


def test_latin_hypercube_has_one_point_in_each_row_and_column():
    points = design_points('lhs', [TWO, Factor('friction', 0.1, 0.5)], [20], 1)
    for column in points.T:
        assert sorted(np.floor(20 * column).astype(int)) == list(range(20))


def test_sobol_points_are_balanced():
    points = design_points('sobol', [TWO, Factor('friction', 0.1, 0.5)], [64], 1)
    cells = np.floor(points * 8).astype(int)
    assert len({tuple(cell) for cell in cells.tolist()}) == 64
    assert (sobol(2, 32, 1, first=32) == points[32:]).all()


@pytest.mark.parametrize('design', ['lhs', 'sobol'])
def test_factor_with_levels_has_only_these(design):
    points = design_points(design, [ONE, TWO], [12], 1)
    values, counts = np.unique(points[:, 0], return_counts=True)
    assert values.tolist() == [0, 0.5, 1]
    assert counts.min() >= 3
    assert len(design_points(design, [ONE], [12], 1)) == 3  # no point is simulated twice


def test_invalid_design_is_refused():
    with pytest.raises(InvalidValueError, match="design 'x': expected one of factorial"):
        design_points('x', [ONE], [4], 1)
    for points in (0, 2.0, 10**6):
        with pytest.raises(InvalidValueError, match='points'):
            design_points('sobol', [ONE], [points], 1)
