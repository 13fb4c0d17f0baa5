"""Polygons that a vision system may send: accepted, repaired or refused with the reason."""

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.vision.identification import MAX_POINTS, observed_polygon

SQUARE = np.array([[0, 0], [0.02, 0], [0.02, 0.01], [0, 0.01]])
HOLE = [[0.005, 0.002], [0.01, 0.002], [0.01, 0.008]]


@pytest.mark.parametrize(
    'given_polygon', [SQUARE.tolist(), SQUARE[:, None], {'outer': SQUARE}, shapely.Polygon(SQUARE)]
)
def test_all_forms_of_a_polygon_are_equal(given_polygon):
    assert observed_polygon(given_polygon).equals(shapely.Polygon(SQUARE))


# A rectangle with dense points on three sides, and two thirds of a circle.
DENSE = shapely.get_coordinates(shapely.LineString(SQUARE).segmentize(1e-3))
ARC = 0.01 * np.stack([np.cos(np.arange(40) / 10), np.sin(np.arange(40) / 10)], axis=1)


@pytest.mark.parametrize('ring', [DENSE, ARC, SQUARE])
def test_ring_is_closed_whichever_point_is_first(ring):
    expected = shapely.Polygon(ring)
    for start in range(len(ring)):
        turned = np.roll(ring, -start, axis=0)
        for points in (turned, [*turned, turned[0]], turned[::-1]):
            found = observed_polygon(points)
            assert found.equals(expected)
            assert found.area == pytest.approx(expected.area, rel=1e-12)


def test_holes_are_kept_and_clockwise():
    found = observed_polygon({'outer': SQUARE, 'holes': [HOLE]})
    assert found.area == pytest.approx(0.0002 - 0.5 * 0.005 * 0.006)
    assert not found.interiors[0].is_ccw


def test_small_crossing_is_repaired():
    loop = [[0.0101, 0.01], [0.0099, 0.0102], [0.0101, 0.0102], [0.0099, 0.01]]
    ring = [*SQUARE[:3].tolist(), *loop, [0, 0.01]]
    assert not shapely.Polygon(ring).is_valid
    found = observed_polygon(ring)
    assert found.is_valid
    assert found.area == pytest.approx(0.0002, rel=0.01)


@pytest.mark.parametrize(
    ('given_polygon', 'words'),
    [
        (SQUARE[[0, 2, 1, 3]], 'cross'),
        ([[0, 0], [0.02, 0], [0.02, 1e-9]], 'encloses'),
        (SQUARE * 1e3 + 0.5, 'pixels or millimetres'),
        (np.where(SQUARE == 0.01, np.nan, SQUARE), 'finite numbers'),
        (np.zeros((MAX_POINTS + 5, 2)), 'at most'),
        ({'points': SQUARE}, 'expected outer'),
        ({'outer': SQUARE, 'holes': [np.add(HOLE, 0.03)]}, 'holes inside'),
        ({'outer': SQUARE, 'hole': [HOLE]}, "key 'hole'.*expected one of outer, holes"),
    ],
)
def test_refused_polygons_name_the_reason(given_polygon, words):
    with pytest.raises(InvalidValueError, match=words):
        observed_polygon(given_polygon)


@given(st.lists(st.tuples(st.floats(), st.floats(-0.1, 0.1)), max_size=12))
def test_any_points_are_accepted_or_refused(points):
    try:
        found = observed_polygon(points)
    except InvalidValueError:
        return
    assert found.is_valid
    assert found.area > 0
