"""Solids, in mm, whose aspects follow from their shape: given as functions, by name."""

from types import SimpleNamespace

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation
from shapely.geometry import Polygon


def hull(points):
    return trimesh.convex.convex_hull(points)


def box(*sides):
    return trimesh.creation.box(sides)


def tetrahedron():
    return hull([(10, 10, 10), (10, -10, -10), (-10, 10, -10), (-10, -10, 10)])


def icosphere(divisions):
    return trimesh.creation.icosphere(divisions, radius=10)


def washer(n):
    return trimesh.creation.annulus(4.2, 8, 1.6, sections=n)


def a_turn(seed):
    quaternion = np.random.default_rng(seed).standard_normal(4)
    return Rotation.from_quat(quaternion).as_matrix()


def turned(mesh, matrix, shift=(0, 0, 0)):
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = matrix, shift
    return mesh.copy().apply_transform(pose)


def circle(n, radius=10.0):
    angle = 2 * np.pi * np.arange(n) / n
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def extruded(outline, height):
    return hull([(x, y, z) for x, y in outline for z in (-height / 2, height / 2)])


def prism(n, radius=10.0, height=20.0):
    return extruded(circle(n, radius), height)


def revolved(profile, n):
    """The hull of circles of n corners: (radius, z) each."""
    return hull([(x, y, z) for r, z in profile for x, y in (circle(n, r) if r else [(0, 0)])])


def quarter(radius, steps):
    """(radius, height) along a quarter of a circle, from the pole."""
    angle = np.linspace(0, np.pi / 2, steps + 1)
    return np.stack([radius * np.sin(angle), radius * np.cos(angle)], axis=1)


def rounded_cylinder(radius, height, fillet, n, steps):
    profile = [
        (radius - fillet + r, end * (height / 2 - fillet + z))
        for r, z in quarter(fillet, steps)
        for end in (-1, 1)
    ]
    return revolved(profile, n)


def filleted_box(sides, fillet, steps):
    """A box with rounded edges; its corners are pieces of UV spheres."""
    core = np.array(sides) / 2 - fillet
    ring = quarter(fillet, steps)
    points = [
        (r * np.cos(azimuth), r * np.sin(azimuth), z)
        for r, z in ring
        for azimuth in np.linspace(0, np.pi / 2, steps + 1)
    ]
    signs = np.array(np.meshgrid(*[(-1, 1)] * 3)).reshape(3, -1).T
    return hull(np.concatenate([(core + np.array(points)) * sign for sign in signs]))


def rounded_prism(n, radius, fillet, steps, height=20.0):
    centres = circle(n, radius)
    arcs = [
        centre + fillet * np.array([np.cos(angle), np.sin(angle)])
        for k, centre in enumerate(centres)
        for angle in 2 * np.pi * k / n + np.pi / n * np.linspace(-1, 1, steps + 1)
    ]
    return extruded(arcs, height)


def half_round_bar(n):
    angle = np.linspace(0, np.pi, n // 2 + 1)
    return extruded(10 * np.stack([np.cos(angle), np.sin(angle)], axis=1), 40)


def d_shaft(n, flat):
    """A shaft of radius 10 with a flat at a distance from its axis."""
    outline = circle(n)
    half = np.sqrt(100 - flat**2)
    kept = outline[outline[:, 1] < flat]
    return extruded([*kept, (half, flat), (-half, flat)], 40)


def ellipsoid(a, b, c, divisions, seed=None):
    """An icosphere, turned at random if a seed is given, and stretched."""
    points = trimesh.creation.icosphere(divisions, radius=1).vertices
    if seed is not None:
        points = points @ a_turn(seed)
    return hull(points * [a, b, c])


def uv_sphere(n):
    return hull(trimesh.creation.uv_sphere(10, count=(n, n)).vertices)


def random_sphere(n, scale=(1, 1, 1)):
    points = np.random.default_rng(n).standard_normal((n, 3))
    return hull(10 * points / np.linalg.norm(points, axis=1, keepdims=True) * scale)


def random_cylinder(n):
    generator = np.random.default_rng(n)
    angle = generator.uniform(0, 2 * np.pi, n)
    ends = generator.choice([-1.0, 1.0], n)
    return hull(10 * np.stack([np.cos(angle), np.sin(angle), ends], axis=1))


def blocks(seed):
    """The hull of three blocks and a round boss, as CAD makes them."""
    generator = np.random.default_rng(seed)
    corners = [
        trimesh.creation.box(generator.uniform(3, 20, 3)).vertices + generator.uniform(-10, 10, 3)
        for _ in range(3)
    ]
    return hull(np.concatenate([*corners, prism(24, 4.0, 24.0).vertices]))


def binom3():
    """The die of Baktash et al. 2025."""
    h, k = 0.3543327, 0.3514274
    corners = [(-0.7935591, 0, 0.4791195), (0.3202141, 0, 0.3201930)]
    corners += [(0.1539833, y, 0.3400605) for y in (h, -h)]
    corners += [(0.1619182, 0, -0.9735855), (0.1602665, 0, 0.9658569)]
    corners += [(-0.7891129, 0, -0.4764671), (0.3175497, 0, -0.3291496)]
    corners += [(0.1573784, y, -0.3330442) for y in (k, -k)]
    return hull(10 * np.array(corners))


def irregular(seed, n=14):
    points = np.random.default_rng(seed).standard_normal((n, 3))
    return hull(points * [10, 14, 19])


def ratchet(teeth):
    """A wheel with saw teeth: its lowest moment has the order of the teeth."""
    angle = 2 * np.pi * np.repeat(np.arange(teeth), 2) / teeth
    angle[1::2] += 0.3 / teeth
    outline = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    outline *= np.tile([9.0, 10.2], teeth)[:, None]
    return trimesh.creation.extrude_polygon(Polygon(outline), 5)


def disphenoid():
    """Rotoreflection by 90 degrees: its upper half is the lower one, mirrored and turned."""
    upper = np.array([[12.0, 3, 10], [-12, -3, 10], [9, -8, 4], [-9, 8, 4]])
    x, y, z = upper.T
    return hull(np.concatenate([upper, np.stack([-y, x, -z], axis=1)]))


def directions(seed, n):
    found = np.random.default_rng(seed).standard_normal((n, 3))
    return found / np.linalg.norm(found, axis=1, keepdims=True)


@pytest.fixture(scope='session')
def solids():
    """Give the functions above by their names."""
    return SimpleNamespace(**{name: each for name, each in globals().items() if callable(each)})
