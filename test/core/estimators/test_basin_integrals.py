"""Integrals over basins, held to closed forms."""

import numpy as np
import pytest

from resting_aspects_ros.core.estimators.basin_integrals import BasinIntegrals
from resting_aspects_ros.core.estimators.resting_shape import RestingShape

# The largest error of the quadrature on the sides of a cylinder of 48 sides, sr.
QUADRATURE = 1e-3


def integrals(shape):
    owners = shape.aspect_of_facets[shape.landscape.minima]
    return BasinIntegrals(shape.landscape, owners, len(shape.aspects))


@pytest.mark.parametrize('sides', [(10, 20, 30), (9, 9, 9), (3, 30, 34)])
def test_support_height_of_a_box_has_its_mean_width(solids, solid, sides):
    shape = RestingShape(solid(solids.turned(solids.box(*sides), solids.a_turn(1))))
    found = integrals(shape).integral(lambda s: s**2 / 2).sum() / (4 * np.pi)
    # The mean width of a box is half the sum of its sides.
    mean = sum(sides) / 4 / (np.linalg.norm(sides) / 2)
    assert found == pytest.approx(mean, rel=1e-5)


@pytest.mark.parametrize('seed', range(3))
def test_integral_of_one_is_the_basin(solids, solid, seed):
    shape = RestingShape(solid(solids.irregular(seed)))
    shares = integrals(shape).integral(lambda s: s) / (4 * np.pi)
    expected = [aspect.basin_share for aspect in shape.aspects.aspects]
    np.testing.assert_allclose(shares, expected, atol=1e-5)


def test_power_of_the_height_over_the_basins_of_a_cylinder(solids, solid):
    """The basin of an end is a cone; on it, the part touches with its rim."""
    shape = RestingShape(solid(solids.prism(48, 10.0, 20.0)))
    rolls = np.array([aspect.rolls for aspect in shape.aspects.aspects])
    found = integrals(shape).integral(lambda s: s**3 / 3)
    # s = cos(t - 45 deg) at the angle t from the axis, up to t = 45 deg.
    angle = np.linspace(0, np.pi / 4, 2001)
    inner = np.cos(angle - np.pi / 4) ** 2 * np.sin(angle)
    end = 2 * np.pi * float(np.trapezoid(inner, angle))
    # A polygon of n sides differs from a circle by 1 - cos(pi / n), 2e-3.
    np.testing.assert_allclose(found[~rolls], end, rtol=4e-3)
