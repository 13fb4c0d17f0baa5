"""Which minima are one aspect: the shape of the part decides, not its mesh."""

import numpy as np
import pytest

from resting_aspects_ros.aspects.find import join_minima
from resting_aspects_ros.aspects.landscape import Landscape


def half_turn(angle):
    """A box, one of whose sides is two facets with an angle between them, degrees."""
    rise = 10 * np.tan(np.radians(angle) / 2)
    outline = [(-10, -8), (10, -8), (10, 8), (0, 8 + rise), (-10, 8)]
    return 'extruded', (outline, 14), 6


CASES = [
    ('prism', (15, 10.0, 20.0), 3),
    ('prism', (14, 10.0, 20.0), 16),
    ('washer', (23,), 3),
    ('prism', (64, 1.0, 20.0), 3),  # a 10:1 pin
    ('rounded_cylinder', (8, 1.6, 0.2, 32, 4), 3),
    ('rounded_cylinder', (10, 6, 2, 48, 4), 3),  # from its rim it rises by 0.005 R to fall over
    ('rounded_cylinder', (5, 30, 5, 32, 8), 1),  # a capsule
    ('icosphere', (0,), 20),
    ('icosphere', (1,), 1),
    ('random_sphere', (1000, (1, 1, 0.5)), 2),
    ('random_cylinder', (1000,), 3),
    ('ellipsoid', (14, 10, 7, 2, 5), 2),
    ('ellipsoid', (10, 10, 11, 2, 5), 1),
    ('filleted_box', ((10, 12, 30), 0.2, 3), 6),
    ('filleted_box', ((10, 14, 20), 4, 6), 6),
    ('rounded_prism', (8, 9, 1.5, 4), 10),
    ('rounded_prism', (8, 9, 1.5, 1), 18),  # chamfered: the part stands on a chamfer, too
    half_turn(0.8),
    ('half_round_bar', (64,), 4),
    ('d_shaft', (32, 9.5), 4),
    ('revolved', ([(10, 0), (0, 20)], 64), 2),  # a cone
    ('box', (0.3, 0.2, 25), 4),  # a needle: its ends are below noise
    ('box', (60, 50, 0.5), 2),  # a plate: so are its sides
]


@pytest.mark.quick_cases(12)
@pytest.mark.parametrize(('name', 'arguments', 'aspects'), CASES)
def test_aspects_of_various_shapes(solids, solid, name, arguments, aspects):
    mesh = getattr(solids, name)(*arguments)
    landscape = Landscape(solid(solids.turned(mesh, solids.a_turn(1))))
    joined = join_minima(landscape)
    assert len(joined) == aspects
    minima = np.concatenate([each for group in joined for each in (group.minima, group.drained)])
    np.testing.assert_array_equal(np.sort(minima), np.arange(len(landscape.minima)))


def test_height_of_a_cylinder_is_its_circumscribed_radius(solids, solid):
    for n in (16, 64):
        landscape = Landscape(solid(solids.prism(n)))
        (side,) = (group for group in join_minima(landscape) if group.curved)
        assert side.level == len(side.minima) == n
        assert side.step == pytest.approx(2 * np.pi / n, rel=1e-4)  # float32
        assert side.height * landscape.radius == pytest.approx(10e-3, rel=1e-6)
