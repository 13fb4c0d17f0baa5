"""Why an outline is not identified: holes, scale, and noise."""

import numpy as np
import pytest
import shapely
from shapely import affinity

from resting_aspects_ros.api.identify import identification_hint, identify_part, known_part
from resting_aspects_ros.vision.identification import observed_polygon


@pytest.fixture(scope='module')
def washer():
    return known_part('washer')


def answer_of(known, polygon):
    """Return the answer and its reason for a polygon, m, which is moved and turned."""
    moved = affinity.translate(affinity.rotate(polygon, 25), 0.1, -0.05)
    seen = observed_polygon(moved)
    found = identify_part(seen, known)
    return found.answer, identification_hint(found, seen, [known])


def test_known_outline_needs_no_reason(washer):
    assert answer_of(washer, washer.outlines[0].polygon) == ('part', '')


def test_missing_hole_is_not_touching_parts(washer):
    answer, text = answer_of(washer, shapely.Polygon(washer.outlines[0].polygon.exterior))
    assert answer == 'none'
    assert text.startswith(
        'Its outer boundary is that of washer, aspects 1, 2, but it has no holes where 1 hole is '
        'expected'
    )


@pytest.mark.parametrize(
    ('scale', 'expected'),
    [
        (1.2, 'its lengths are 1.2 times as long: check the scale of the camera'),
        (100, 'its lengths are 100 times as long: its coordinates are probably in cm instead'),
    ],
)
def test_wrong_scale_is_named(washer, scale, expected):
    polygon = affinity.scale(washer.outlines[0].polygon, scale, scale, origin=(0, 0))
    answer, text = answer_of(washer, polygon)
    assert answer != 'part'
    assert 'It has the shape of washer, aspects 1, 2, but' in text
    assert expected in text


def test_deviation_above_the_noise_is_stated(washer):
    turns = np.linspace(0, 2 * np.pi, 200, endpoint=False)
    radii = 0.00799 + 0.0005 * np.sin(9 * turns)
    outer = np.stack([radii * np.cos(turns), radii * np.sin(turns)], axis=1)
    hole = washer.outlines[0].polygon.interiors[0]
    answer, text = answer_of(washer, shapely.Polygon(outer, [hole.coords]))
    assert answer == 'none'
    assert 'deviates by 0.' in text
    assert 'a noise of 0.1 mm' in text


def test_other_shape_has_no_reason(washer):
    assert answer_of(washer, shapely.box(0, 0, 0.03, 0.02)) == ('none', '')
