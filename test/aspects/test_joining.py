"""Which minima are one aspect: the shape of the part decides, not its mesh."""

import numpy as np
import pytest

from resting_aspects_ros.aspects.find import join_minima
from resting_aspects_ros.aspects.landscape import Landscape
from resting_aspects_ros.part.tessellation import CurvedEdges


def chamfered(n, chamfer):
    profile = [(1 - chamfer, -10), (1, chamfer - 10), (1, 10 - chamfer), (1 - chamfer, 10)]
    return 'revolved', (profile, n), 3


def half_turn(angle):
    """A box, one of whose sides is two facets with an angle between them, degrees."""
    rise = 10 * np.tan(np.radians(angle) / 2)
    outline = [(-10, -8), (10, -8), (10, 8), (0, 8 + rise), (-10, 8)]
    return 'extruded', (outline, 14), 6


def lens():
    """Slivers at its poles have the centre of mass over their rim but for less than the margin."""
    slope = np.linspace(0, np.arcsin(10 / 60), 9)
    top = [(60 * np.sin(a), 60 * (np.cos(a) - np.cos(slope[-1]))) for a in slope]
    return 'revolved', ([*top, *((r, -z) for r, z in top)], 48), 2


CASES = [
    ('prism', (15, 10.0, 20.0), 3),
    ('prism', (14, 10.0, 20.0), 16),
    ('washer', (23,), 3),
    ('prism', (16, 10.0, 1.0), 3),  # a disc
    ('prism', (64, 1.0, 20.0), 3),  # a 10:1 pin
    chamfered(16, 0.1),
    chamfered(64, 0.4),
    ('rounded_cylinder', (1, 20, 0.4, 32, 4), 3),
    ('rounded_cylinder', (8, 1.6, 0.2, 32, 4), 3),
    ('rounded_cylinder', (10, 6, 2, 48, 4), 3),  # from its rim it rises by 0.005 R to fall over
    ('rounded_cylinder', (5, 30, 5, 32, 8), 1),  # a capsule
    ('icosphere', (0,), 20),
    ('icosphere', (1,), 1),
    ('uv_sphere', (17,), 1),
    lens(),
    ('random_sphere', (1000, (1, 1, 0.5)), 2),
    ('random_cylinder', (1000,), 3),
    *[
        ('ellipsoid', (*axes, 2, 5), aspects)
        for *axes, aspects in ((10, 10, 9, 2), (14, 10, 7, 2), (10, 10, 11, 1), (10, 10, 20, 1))
    ],
    *[
        ('filleted_box', ((10, 12, 30), fillet, steps), 6)
        for fillet, steps in ((0.2, 3), (1, 2), (2, 4))
    ],
    ('filleted_box', ((10, 14, 20), 4, 6), 6),
    *[
        ('rounded_prism', (n, 9, fillet, steps), n + 2)
        for n, fillet, steps in ((8, 0.5, 2), (6, 1.5, 3), (8, 1.5, 4), (6, 3, 7))
    ],
    ('rounded_prism', (8, 9, 1.5, 1), 18),  # chamfered: the part stands on a chamfer, too
    half_turn(0.8),
    ('half_round_bar', (64,), 4),
    ('d_shaft', (32, 9.5), 4),
    ('revolved', ([(10, 0), (0, 20)], 64), 2),  # a cone
    ('revolved', ([(10, 0), (6, 20)], 16), 3),
    *[('revolved', (10 * np.array([(np.sin(a), -np.cos(a)) for a in t]), 4 * len(t) - 4), 2)
      for t in (np.linspace(0, np.pi / 2, k) for k in (5, 9))],  # hemispheres
    ('binom3', (), 4),
    ('extruded', ([(0, 0), (30, 0), (0, 8)], 12), 5),  # a wedge
    ('box', (0.3, 0.2, 25), 4),  # a needle: its ends are below noise
    ('box', (60, 50, 0.5), 2),  # a plate: so are its sides
]  # fmt: skip


@pytest.mark.quick_cases(15)
@pytest.mark.parametrize(('name', 'arguments', 'aspects'), CASES)
def test_aspects_of_various_shapes(solids, solid, name, arguments, aspects):
    mesh = getattr(solids, name)(*arguments)
    landscape = Landscape(solid(solids.turned(mesh, solids.a_turn(1))))
    assert len(join_minima(landscape)) == aspects


@pytest.mark.parametrize(('name', 'arguments', 'flat'), [
    ('prism', (16,), 2), ('prism', (12,), 14), ('box', (9, 9, 9), 6), ('icosphere', (0,), 20),
    ('icosphere', (2,), 0), ('washer', (64,), 2),
])  # fmt: skip
def test_only_sides_that_are_meshed_in_small_steps_are_curved(
    solids, solid, name, arguments, flat
):
    landscape = Landscape(solid(getattr(solids, name)(*arguments)))
    joined = join_minima(landscape)
    assert sum(not group.curved for group in joined) == flat
    steps = landscape.hull.angles[CurvedEdges(landscape.hull).curved]
    assert len(steps) == 0 if flat == len(joined) else steps.max() < np.radians(25)


def test_height_of_a_cylinder_is_its_circumscribed_radius(solids, solid):
    for n in (16, 64):
        landscape = Landscape(solid(solids.prism(n)))
        (side,) = (group for group in join_minima(landscape) if group.curved)
        assert side.level == len(side.minima) == n
        assert side.step == pytest.approx(2 * np.pi / n, rel=1e-4)  # float32
        assert side.height * landscape.radius == pytest.approx(10e-3, rel=1e-6)
