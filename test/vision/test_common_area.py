"""The area that polygons have in common, even if they are almost equal."""

import numpy as np
import pytest
import shapely
from hypothesis import example, given
from hypothesis import strategies as st
from shapely.affinity import rotate, translate

from resting_aspects_ros.vision.boundary import common_area

# With this yaw GEOS 3.14 finds that the hexagon and its copy have two points in common.
YAW = 1.1209129495833339


@given(sides=st.integers(3, 8), yaw=st.floats(-3, 3), power=st.floats(-19, -10))
@example(sides=6, yaw=YAW, power=-17.9)
def test_polygon_and_its_copy_have_all_in_common(sides, yaw, power):
    angles = 2 * np.pi * np.arange(sides) / sides
    polygon = shapely.Polygon(0.01 * np.stack([np.cos(angles), np.sin(angles)], axis=1))
    polygon = rotate(polygon, np.degrees(yaw), origin=(0, 0))
    copy = translate(polygon, 10**power, 5.5 * 10 ** (power - 1))
    assert common_area(polygon, copy) == pytest.approx(polygon.area, rel=1e-5)


def test_squares_that_touch_or_are_apart_have_nothing_in_common():
    square = shapely.box(0, 0, 0.01, 0.01)
    assert common_area(square, translate(square, 0.01, 0)) == 0
    assert common_area(square, translate(square, 0.02, 0)) == 0
    assert common_area(square, translate(square, 0.004, 0)) == pytest.approx(6e-5)
