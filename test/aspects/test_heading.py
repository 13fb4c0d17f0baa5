"""The rotation about the vertical that represents an aspect does not depend on the mesh file."""

import numpy as np
import pytest
import shapely
import trimesh

from resting_aspects_ros.aspects.find import find_aspects, surface_moments
from resting_aspects_ros.system import parts_folder
from resting_aspects_ros.vision.outline import find_outlines, seen_outline


def notched_disc():
    """A disc whose moments are all small: diameter 20 mm, with a notch of 2 x 1.5 mm."""
    disc = shapely.Point(0, 0).buffer(10, quad_segs=8)
    return trimesh.creation.extrude_polygon(disc - shapely.box(8.5, -1, 11, 1), 3)


def gear():
    """A gear with 8 teeth."""
    angle = np.linspace(0, 2 * np.pi, 33)[:-1]
    radius = 10 + np.where(np.arange(32) % 4 < 2, 1, -1)
    outline = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    return trimesh.creation.extrude_polygon(shapely.Polygon(outline), 4)


def example(name):
    return lambda: trimesh.load(parts_folder() / f'{name}.stl')


def likeness(one, other):
    return shapely.intersection(one, other).area / shapely.union(one, other).area


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize(
    'make',
    [example('l_bracket'), example('t_prism'), notched_disc, gear],
    ids=['l_bracket', 't_prism', 'notched_disc', 'gear'],
)
def test_outline_is_that_of_a_rotated_file(solid, make):
    mesh = make()
    turned = mesh.copy()
    turned.apply_transform(trimesh.transformations.euler_matrix(0.3, 1.1, -2.0))
    turned.apply_translation([5, -40, 12])
    turned = turned.subdivide()
    before, after = (find_outlines(p, find_aspects(p)) for p in (solid(mesh), solid(turned)))
    for one, other in zip(before, after, strict=True):
        assert likeness(one.polygon, other.polygon) > 0.999


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize('name', ['t_prism', 'hex_nut', 'tetrahedron'])
def test_aspects_of_a_class_look_the_same_from_above(solid, name):
    part = solid(example(name)())
    aspects = find_aspects(part)
    for outline, members in zip(find_outlines(part, aspects), aspects.classes(), strict=True):
        for aspect in members:
            assert likeness(seen_outline(part, aspect.orientation), outline.polygon) > 0.999


@pytest.mark.parametrize('sides', [(30, 20, 10), (20, 20, 10)])
def test_long_side_is_along_x_and_a_square_along_the_axes(solid, sides):
    part = solid(trimesh.creation.box(sides))
    for aspect in find_aspects(part).aspects:
        x, y, _, _ = seen_outline(part, aspect.orientation).bounds
        assert x <= y + 1e-9
        assert seen_outline(part, aspect.orientation).area == pytest.approx(4 * x * y)


def test_moments_of_a_box_are_exact(solid):
    """A cube of side 2: mean of x^2 over its surface is (2 x 1 + 4 / 3) / 6."""
    tensors = surface_moments(solid(trimesh.creation.box([2, 2, 2]))).tensors
    assert 3 * tensors[2][0, 0] == pytest.approx((2 + 4 / 3) / 6)
    assert 27 * tensors[6][0, 0, 0, 0, 0, 0] == pytest.approx((2 + 4 / 7) / 6)
