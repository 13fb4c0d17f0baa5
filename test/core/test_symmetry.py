"""The symmetry of parts, held to geometry: groups that anybody can count on the solid."""

from itertools import product

import numpy as np
import pytest
import trimesh
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial import Delaunay
from scipy.spatial.transform import Rotation
from trimesh.creation import box, capsule, cone, cylinder, icosahedron, icosphere, uv_sphere

from resting_aspects_ros.core.aspects import find_aspects
from resting_aspects_ros.core.symmetry import find_symmetry

GOLDEN = (1 + np.sqrt(5)) / 2
NO_LANDMARKS = np.zeros((0, 3))
turns = st.integers(0, 2**32 - 1).map(
    lambda seed: Rotation.from_quat(np.random.default_rng(seed).standard_normal(4)).as_matrix()
)
few = settings(
    max_examples=4, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


def hull(points):
    return trimesh.convex.convex_hull(np.array(points, dtype=float) * 10)


def circle(radius, sides, centre=(0.0, 0.0), phase=0.0):
    angle = 2 * np.pi * np.arange(sides) / sides + phase
    return np.stack([np.cos(angle), np.sin(angle)], axis=1) * radius + centre


def inside(points, outline):
    """Whether points are inside a star-shaped outline, counter-clockwise about its mean."""
    middle = outline.mean(axis=0)
    angle = np.arctan2(*(outline - middle).T[::-1])
    at = points - middle
    turn = np.argsort(angle)
    which = turn[np.searchsorted(angle[turn], np.arctan2(at[:, 1], at[:, 0])) % len(turn) - 1]
    a, b = outline[which], np.roll(outline, -1, axis=0)[which]
    return (b - a)[:, 0] * (points - a)[:, 1] - (b - a)[:, 1] * (points - a)[:, 0] > 0


def sheet(outline, holes, z, up):
    """A flat face with holes at a height; convex outlines are needed where there are holes."""
    if holes:
        points = np.concatenate([outline, *holes])
        simplices = Delaunay(points).simplices
        middles = points[simplices].mean(axis=1)
        keep = inside(middles, outline)
        for hole in holes:
            keep &= ~inside(middles, hole)
        triangles = points[simplices[keep]]
    else:
        middle = np.broadcast_to(outline.mean(axis=0), outline.shape)
        triangles = np.stack([middle, outline, np.roll(outline, -1, axis=0)], axis=1)
    a, b, c = np.moveaxis(triangles, 1, 0)
    left = (b - a)[:, 0] * (c - a)[:, 1] > (b - a)[:, 1] * (c - a)[:, 0]
    triangles = np.where((left == up)[:, None, None], triangles, triangles[:, ::-1])
    return np.concatenate([triangles, np.full((*triangles.shape[:2], 1), z)], axis=2)


def wall(outline, low, high, outward=True):
    a, b = outline, np.roll(outline, -1, axis=0)
    at = [np.column_stack([p, np.full(len(p), z)]) for z in (low, high) for p in (a, b)]
    triangles = np.concatenate(
        [np.stack([at[0], at[1], at[3]], 1), np.stack([at[0], at[3], at[2]], 1)]
    )
    return triangles if outward else triangles[:, ::-1]


def plate(outline, height, holes=(), depth=None):
    """A plate with holes, through or to a depth from the top; mm."""
    floor = 0.0 if depth is None else height - depth
    parts = [sheet(outline, holes, height, True), wall(outline, 0, height)]
    parts += [sheet(outline, holes if depth is None else (), 0.0, False)]
    for hole in holes:
        parts.append(wall(hole, floor, height, outward=False))
        if depth is not None:
            parts.append(sheet(hole, (), floor, True))
    triangles = np.concatenate(parts)
    return trimesh.Trimesh(triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3))


def around(mesh_radius, count, size, sides=24, phase=0.3):
    """Circles on a circle."""
    return [circle(size, sides, c) for c in circle(mesh_radius, count, phase=phase)]


def gear(teeth, shape):
    """The outline of a gear: share of the pitch and radius of the corners of a tooth."""
    pitch = 2 * np.pi / teeth
    corners = [(r, (t + s) * pitch) for t in range(teeth) for s, r in shape]
    return np.array([[r * np.cos(a), r * np.sin(a)] for r, a in corners])


SPUR = [(0.0, 9.0), (0.3, 9.0), (0.4, 10.0), (0.6, 10.0), (0.7, 9.0)]
RATCHET = [(0.0, 9.0), (0.05, 10.2)]


def pyramid(sides, height):
    return hull([*np.column_stack([circle(1, sides), np.zeros(sides)]), (0, 0, height)])


def twisted(angle, sides=3):
    """A prism with its ends turned against each other: without mirror images of its own."""
    ends = [
        np.column_stack([circle(1, sides, phase=p), np.full(sides, z)])
        for p, z in ((0, -0.6), (angle, 0.6))
    ]
    return hull(np.concatenate(ends))


def scaled(mesh, factors):
    return mesh.copy().apply_transform(np.diag([*factors, 1]))


def turned(mesh, matrix, shift=(0, 0, 0)):
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = matrix, shift
    return mesh.copy().apply_transform(pose)


def irregular():
    points = np.random.default_rng(3).standard_normal((14, 3)) * [1.0, 1.4, 1.9]
    return hull(points)


def tetrahedron():
    return hull([(1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1)])


def octahedron():
    return hull([*np.eye(3), *-np.eye(3)])


def dodecahedron():
    corners = list(product((-1, 1), repeat=3))
    for a, b in product((-GOLDEN, GOLDEN), (-1 / GOLDEN, 1 / GOLDEN)):
        corners += [(0, b, a), (b, a, 0), (a, 0, b)]
    return hull(corners)


def frustum(sides):
    ends = [np.column_stack([circle(r, sides), np.full(sides, z)]) for r, z in ((1, 0), (0.6, 1))]
    return hull(np.concatenate(ends))


FINITE = {
    'tetrahedron': (tetrahedron, 12),
    'cube': (lambda: box((9, 9, 9)), 24),
    'box': (lambda: box((9, 12, 20)), 4),
    'square_box': (lambda: box((9, 9, 20)), 8),
    'nearly_square_box': (lambda: box((9, 9.2, 20)), 4),
    'near_cube': (lambda: box((9, 9, 9 * 0.97)), 8),
    'nearer_cube': (lambda: box((9, 9, 9 * 0.99)), 8),
    'octahedron': (octahedron, 24),
    'icosahedron': (icosahedron, 60),
    'dodecahedron': (dodecahedron, 60),
    'triaxial_ellipsoid': (lambda: scaled(icosphere(3), (10, 13, 18)), 4),
    'twisted_prism': (lambda: twisted(0.35), 6),
    'its_mirror_image': (lambda: twisted(-0.35), 6),
    'irregular': (irregular, 1),
    'disc_with_pocket': (lambda: plate(circle(10, 64), 5, around(5, 1, 2), 2), 1),
    'disc_with_small_pocket': (lambda: plate(circle(10, 64), 5, around(5, 1, 0.2), 0.2), 1),
    'disc_with_hole': (lambda: plate(circle(10, 64), 5, around(5, 1, 2)), 2),
    'disc_with_three_pockets': (lambda: plate(circle(10, 64), 5, around(5, 3, 2), 2), 3),
    'disc_with_three_holes': (lambda: plate(circle(10, 64), 5, around(5, 3, 2)), 6),
    'disc_with_eight_holes': (lambda: plate(circle(10, 90), 5, around(7, 8, 1)), 16),
    'gear': (lambda: plate(gear(20, SPUR), 5), 40),
    'gear_of_57': (lambda: plate(gear(57, SPUR), 5), 114),
    'gear_with_pocket_in_the_middle': (
        lambda: trimesh.util.concatenate(
            plate(gear(20, SPUR), 5), cylinder(3, 2).apply_translation((0, 0, 6))
        ),
        20,
    ),
    'ratchet': (lambda: plate(gear(20, RATCHET), 5), 40),
    **{f'prism_{n}': (lambda n=n: plate(circle(10, n), 11), 2 * n) for n in range(3, 13)},
    **{f'pyramid_{n}': (lambda n=n: pyramid(n, 3), n) for n in range(3, 13)},
}
AXIAL = {
    'cylinder_16': (lambda: cylinder(10, 20, sections=16), 2),
    'cylinder_64': (lambda: cylinder(10, 20, sections=64), 2),
    'cylinder_256': (lambda: cylinder(10, 20, sections=256), 2),
    'disc_16': (lambda: cylinder(10, 2, sections=16), 2),
    'pin_16': (lambda: cylinder(1, 20, sections=16), 2),
    'cylinder_of_like_moments': (lambda: cylinder(10, 20 * 0.9, sections=32), 2),
    'cone': (lambda: cone(10, 20, sections=48), 1),
    'frustum_16': (lambda: frustum(16), 1),
    'frustum_64': (lambda: frustum(64), 1),
    'washer_48_30': (lambda: plate(circle(10, 48), 2, [circle(5, 30)]), 2),
    'washer_16_20': (lambda: plate(circle(10, 16), 2, [circle(5, 20)]), 2),
    'cup': (lambda: plate(circle(10, 48), 12, [circle(7, 40)], 6), 1),
    'capsule': (lambda: capsule(20, 8, count=(32, 32)), 2),
    'long_ellipsoid': (lambda: scaled(icosphere(3), (10, 10, 18)), 2),
    'flat_ellipsoid': (lambda: scaled(icosphere(3), (10, 10, 6)), 2),
}
SPHERES = {
    'icosphere_80': lambda: icosphere(1, 10),
    'icosphere_320': lambda: icosphere(2, 10),
    'icosphere_1280': lambda: icosphere(3, 10),
    'uv_sphere_32': lambda: uv_sphere(10, (32, 32)),
    'uv_sphere_20_40': lambda: uv_sphere(10, (20, 40)),
}


def landmarks(part):
    return np.array([a.down_in_part for a in find_aspects(part).aspects]).reshape(-1, 3)
