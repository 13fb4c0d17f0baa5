"""Descriptions of what a part rests on, compared with bodies whose sides are known."""

import numpy as np
import pytest
import trimesh

from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.aspects.support import resting_on

TURNED = trimesh.transformations.rotation_matrix(2.1, (0.3, -0.5, 0.81))
TURNED[:3, 3] = 4, -7, 2
create = trimesh.creation


def descriptions(part):
    """What each symmetry class rests on."""
    return sorted(resting_on(part, members[0]) for members in find_aspects(part).classes())


def revolved(*outline):
    """A body of revolution; the outline is (radius, z)."""
    return create.revolve(np.array(outline, dtype=float), sections=64)


def prism(*outline, depth=20):
    """A prism over a polygon (x, y), counter-clockwise, that its last corner sees as a whole."""
    n = len(outline)
    points = [(*p, z) for z in (0.0, depth) for p in outline]
    caps = [(n - 1, k, k + 1) for k in range(n - 2)]
    faces = [(a, c, b) for a, b, c in caps] + [(a + n, b + n, c + n) for a, b, c in caps]
    for k in range(n):
        j = (k + 1) % n
        faces += [(k, j, n + j), (k, n + j, n + k)]
    return trimesh.Trimesh(points, faces)


def scaled(mesh, *factors):
    mesh.apply_scale(factors)
    return mesh


def caltrop():
    """A small tetrahedron with a spike on each of its faces."""
    inner = np.array([(1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1)]) * 3.0
    points = np.concatenate([inner, -5 * inner])
    faces = [(a, b, 4 + k) for k in range(4) for a, b in sides([j for j in range(4) if j != k])]
    mesh = trimesh.Trimesh(points, faces)
    trimesh.repair.fix_normals(mesh)
    return mesh


def sides(corners):
    return [(corners[k], corners[(k + 1) % len(corners)]) for k in range(len(corners))]


BODIES = {
    'box': (
        create.box((10, 20, 30)),
        ['flat side 10 x 20 mm', 'flat side 10 x 30 mm', 'flat side 20 x 30 mm'],
    ),
    'cylinder': (
        create.cylinder(4, 30, sections=48),
        ['cylinder, diameter 8 mm (rolls)', 'round flat side, diameter 8 mm'],
    ),
    'washer': (
        create.annulus(4, 8, 1.6, sections=64),
        ['cylinder, diameter 16 mm (rolls)', 'flat ring, diameter 16 mm'],
    ),
    'cone': (
        create.cone(10, 30, sections=64),
        ['cone, diameter 20 mm (rolls)', 'round flat side, diameter 20 mm'],
    ),
    'sphere': (create.icosphere(3, 10), ['ball, diameter 20 mm (rolls)']),
    'ellipsoid': (scaled(create.icosphere(3, 10), 1, 1.3, 1.7), ['dome']),
    'egg that rolls': (
        scaled(create.icosphere(3, 10), 1, 1, 1.7),
        ['curved side, diameter 20 mm (rolls)'],
    ),
    # The tube of a torus touches the surface in a circle around its hole.
    'torus': (create.torus(20, 5), ['ring, diameter 40 mm']),
    'tetrahedron': (
        trimesh.Trimesh(
            [(20, 20, 20), (20, -20, -20), (-20, 20, -20), (-20, -20, 20)],
            [(0, 1, 2), (0, 3, 1), (0, 2, 3), (1, 3, 2)],
        ),
        ['flat side 49 x 56.6 mm'],
    ),
    'caltrop': (caltrop(), ['three corners']),
    'pin with a head': (
        revolved((0, 0), (10, 0), (10, 3), (4, 3), (4, 30), (0, 30)),
        [
            'round flat side, diameter 20 mm',
            'round flat side, diameter 8 mm',
            'two rims, diameters 20 and 8 mm (rolls)',
        ],
    ),
    'two discs on a rod': (
        revolved((0, 0), (10, 0), (10, 2), (3, 2), (3, 28), (10, 28), (10, 30), (0, 30)),
        ['round flat side, diameter 20 mm', 'two round sides, diameter 20 mm (rolls)'],
    ),
    # Its leg and its toe: the hull has a side between them that the part has not.
    'L bracket': (
        prism((10, 40), (0, 40), (0, 0), (30, 0), (30, 10), (10, 10)),
        [
            'flat side 20 x 30 mm',
            'flat side 20 x 40 mm',
            'flat side 30 x 40 mm',
            'flat side 30 x 40 mm',
            'two edges',
        ],
    ),
    # The rectangles along its legs and along its longest side have the same area.
    'wedge': (
        prism((0, 0), (30, 0), (0, 20), depth=40),
        [
            'flat side 20 x 30 mm',
            'flat side 20 x 30 mm',
            'flat side 20 x 40 mm',
            'flat side 30 x 40 mm',
            'flat side 36.1 x 40 mm',
        ],
    ),
    'half a rod': (
        prism(*[(10 * np.cos(a), 10 * np.sin(a)) for a in np.linspace(0, np.pi, 33)], depth=30),
        ['curved side, radius 10 mm (rocks)', 'flat side 10 x 20 mm', 'flat side 20 x 30 mm'],
    ),
}


@pytest.mark.quick_cases(6)
@pytest.mark.parametrize('name', BODIES)
def test_what_a_turned_body_rests_on(solid, name):
    mesh, expected = BODIES[name]
    assert descriptions(solid(mesh.copy().apply_transform(TURNED))) == expected


@pytest.mark.parametrize(
    ('name', 'expected'),
    [
        ('hex_nut', ['flat side 17 x 19.6 mm', 'flat side 8.4 x 9.81 mm']),
        # Upside down a U stands on both of its arms.
        (
            'u_bracket',
            [
                'flat side 20 x 25 mm',
                'flat side 20 x 30 mm',
                'flat side 25 x 30 mm',
                'two flat sides',
            ],
        ),
    ],
)
def test_descriptions_of_an_example_part(part, name, expected):
    assert descriptions(part(name)) == expected


def test_description_contains_the_size(solid):
    small, large = (solid(create.box((10, 20, 30)), unit=unit) for unit in ('um', 'm'))
    assert descriptions(small)[0] == 'flat side 0.01 x 0.02 mm'
    assert descriptions(large)[0] == 'flat side 10000 x 20000 mm'


def test_noise_of_a_scan_leaves_a_side_flat(solid):
    mesh = create.box((10, 20, 30)).subdivide().subdivide()
    mesh.vertices += np.random.default_rng(3).normal(0, 1e-5, mesh.vertices.shape)
    assert descriptions(solid(mesh))[:1] == ['flat side 10 x 20 mm']


def test_support_is_described_without_the_mesh(part):
    bracket = part('l_bracket')
    aspects = find_aspects(bracket).aspects
    assert resting_on(None, aspects[0]) == 'within 30 x 40 mm'
    roll = find_aspects(part('cylinder_d20_h20')).aspects[0]
    assert resting_on(None, roll) == 'curved side (rolls)'
