"""A chip of half a millimetre and a beam of two metres have the aspects of the same shape."""

import numpy as np
import pytest

from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.aspects.landscape import Landscape
from resting_aspects_ros.part.hull import MAX_CORNERS

SIZES = [0.5, 1990.0]  # mm, of the longest side; compared with 40 mm

SHAPES = [
    ('blocks', (1,)),
    ('irregular', (2,)),
    ('washer', (64,)),
    ('half_round_bar', (32,)),
    ('filleted_box', ((10, 14, 20), 2, 4)),
    ('ellipsoid', (14, 10, 7, 2, 5)),
    ('box', (2, 3, 100)),  # the beam
    ('box', (20, 10, 0.4)),  # the chip
]


def sized(solids, solid, name, arguments, size):
    mesh = solids.turned(getattr(solids, name)(*arguments), solids.a_turn(4))
    return solid(mesh.apply_scale(size / np.ptp(mesh.vertices, axis=0).max()), unit='mm')


@pytest.mark.quick_cases(2)
@pytest.mark.parametrize(('name', 'arguments'), SHAPES)
def test_aspects_are_the_same_in_any_size(solids, solid, name, arguments):
    usual = sized(solids, solid, name, arguments, 40.0)
    expected = find_aspects(usual)
    for size in SIZES:
        part = sized(solids, solid, name, arguments, size)
        assert part.warnings == ()
        assert part.hull_radius == pytest.approx(usual.hull_radius * size / 40, rel=1e-6)
        assert_alike(find_aspects(part), expected, part, usual)


def assert_alike(found, expected, part, usual):
    """The same aspects, with lengths in hull radii."""
    assert len(found) == len(expected)
    assert (found.symmetry.kind, found.symmetry.order) == (
        expected.symmetry.kind,
        expected.symmetry.order,
    )
    # float32 rounds another size otherwise: by 1e-7, which tips a facet of a mesh by more.
    for one, other in zip(found.aspects, expected.aspects, strict=True):
        assert one.id == other.id
        assert one.sweep is other.sweep
        assert (one.symmetry_class, one.multiplicity) == (other.symmetry_class, other.multiplicity)
        for length in ('com_height', 'min_barrier'):
            in_radii = [
                getattr(aspect, length) / of.hull_radius
                for aspect, of in ((one, part), (other, usual))
            ]
            assert in_radii[0] == pytest.approx(in_radii[1], abs=2e-6)
        assert one.basin_share == pytest.approx(other.basin_share, abs=2e-5)


@pytest.mark.slow
@pytest.mark.parametrize('size', [0.5, 1990.0])
def test_relative_error_of_a_hull_does_not_depend_on_size(solids, solid, size):
    shape = 'random_sphere', (4000, (1.4, 1, 0.7))
    parts = [sized(solids, solid, *shape, each) for each in (size, 40.0)]
    assert all(len(part.hull_vertices) <= MAX_CORNERS for part in parts)
    shares = [part.hull_error / part.hull_radius for part in parts]
    assert shares[0] == pytest.approx(shares[1], rel=0.1)
    heights = [Landscape(part).heights[0] / part.hull_radius for part in parts]
    assert heights[0] == pytest.approx(heights[1], abs=max(shares))
