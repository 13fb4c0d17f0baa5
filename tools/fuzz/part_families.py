"""Random convex parts of families whose aspects are known, and an independent landscape.

Nothing here uses the code under test: the landscape is that of Qhull's facets.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import trimesh
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

Array = Any
Generator = np.random.Generator

# A barrier is certain if it is above this multiple of the depth of the mesh.
CERTAIN = 4.0
# Barriers up to this share of the height are noise, and are certain if they are not near it.
NOISE = 1e-3
NEAR_NOISE = 0.3


@dataclass(frozen=True)
class Shape:
    """A convex part.

    name : str
        Family and parameters.
    points : (n, 3) float
        Of any unit.
    aspects : int or None
        Number of aspects, if all barriers are far from noise and from the depth of the mesh.
    depth : float
        Depth of the flats of the mesh below the true shape, unit of the points.
    """

    name: str
    points: Array
    aspects: int | None
    depth: float


# -- The landscape --------------------------------------------------------------------------------


class Landscape:
    """Minima of the height of the centre of mass, and the lowest passes between them.

    Each triangle of the hull is a node with the height of its plane. On the way from one to the
    next, over their common edge, the part is highest above the foot of the perpendicular onto the
    edge, if this is between them. No other way between two triangles is lower: see Morse theory.
    """

    def __init__(self, points: Array) -> None:
        hull = ConvexHull(points)
        centre = _centre_of_mass(points, hull)
        self.points = points[hull.vertices] - centre
        self.radius = np.linalg.norm(self.points, axis=1).max()
        self.normals = hull.equations[:, :3]
        self.heights = -(hull.equations[:, 3] + self.normals @ centre)

        one, k = np.divmod(np.arange(hull.simplices.size), 3)
        other = hull.neighbors.ravel()
        start = points[hull.simplices[one, (k + 1) % 3]] - centre
        along = points[hull.simplices[one, (k + 2) % 3]] - centre - start
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        foot = start - _dot(start, along)[:, None] * along
        turn = np.cross(self.normals[one], self.normals[other])
        after = _dot(np.cross(self.normals[one], foot), turn) > 0
        before = _dot(np.cross(foot, self.normals[other]), turn) > 0
        level = np.maximum(self.heights[one], self.heights[other])
        top = np.maximum(np.linalg.norm(foot, axis=1), level)
        height = np.where(after & before, top, level)
        order = np.argsort(height, kind='stable')
        order = order[one[order] < other[order]]
        columns = (height[order].tolist(), one[order].tolist(), other[order].tolist())
        self.passes = list(zip(*columns, strict=True))

    def height(self, down: Array) -> Array:
        """Return the heights (n,) of the centre of mass for directions of gravity (n, 3)."""
        return (np.asarray(down) @ self.points.T).max(axis=1)

    def minima(self) -> list[tuple[int, float]]:
        """Return triangle and barrier of each minimum: the rise to the next lower one."""
        parent = list(range(len(self.heights)))
        found = []
        for height, a, b in self.passes:
            roots = (_root(parent, a), _root(parent, b))
            low, high = sorted(roots, key=lambda k: self.heights[k])
            if low != high:
                found.append((high, height - self.heights[high]))
                parent[high] = low
        return [(_root(parent, 0), np.inf), *found]

    def lowest_passes(self, group: Array) -> Array:
        """Return (g,) heights of the lowest passes from triangles of each group to other groups.

        ``group`` (f,) is the number of the group of each triangle, or -1.
        """
        parent = list(range(len(self.heights)))
        groups: list[set[int]] = [{int(g)} - {-1} for g in group]
        found = np.full(int(max(group)) + 1, np.inf)
        for height, a, b in self.passes:
            one, other = _root(parent, a), _root(parent, b)
            if one == other:
                continue
            both = groups[one] | groups[other]
            if groups[one] and groups[other] and len(both) > 1:
                for k in both:
                    if groups[one] != {k} or groups[other] != {k}:
                        found[k] = min(found[k], height)
            parent[other] = one
            groups[one] = both
        return found


def _centre_of_mass(points: Array, hull: ConvexHull) -> Array:
    """Return the centre of mass (3,) of a hull, from the tetrahedra of its triangles."""
    inside = points[hull.vertices].mean(axis=0)
    triangles = points[hull.simplices]
    a, b, c = np.moveaxis(triangles - inside, 1, 0)
    volume = np.abs(_dot(a, np.cross(b, c)))
    centres = (triangles.sum(axis=1) + inside) / 4
    return volume @ centres / volume.sum()


def _dot(a: Array, b: Array) -> Array:
    """Return the products (n,) of vectors (n, 3)."""
    return (a * b).sum(axis=1)


def _root(parent: list[int], k: int) -> int:
    """Return the root of a node, and shorten the way to it."""
    while parent[k] != k:
        parent[k] = parent[parent[k]]
        k = parent[k]
    return k


# -- Points ---------------------------------------------------------------------------------------


def circle(n: int, radius: float = 1.0) -> Array:
    """Return n points on a circle (n, 2)."""
    angle = 2 * np.pi * np.arange(n) / n
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def revolved(profile: Any, n: int) -> Array:
    """Return circles of n points, or points of the axis, for a profile of radii and z."""
    rows = []
    for radius, z in profile:
        points = circle(n, radius) if radius > 1e-9 else [(0.0, 0.0)]
        rows += [(x, y, z) for x, y in points]
    return np.array(rows)


def extruded(outline: Any, height: float) -> Array:
    """Return the corners of a prism."""
    return np.array([(x, y, end * height / 2) for x, y in outline for end in (-1, 1)])


def arc(stop: float, n: int) -> Array:
    """Return angles from 0 to ``stop`` in steps of at most 1 / n of a circle."""
    steps = max(2, int(np.ceil(stop * n / (2 * np.pi))))
    return np.linspace(0, stop, steps + 1)


def ball(n: int, kind: str, g: Generator) -> Array:
    """Return points on a ball of radius 1, about n on a great circle."""
    if kind == 'ico':
        return trimesh.creation.icosphere(max(1, round(np.log2(n / 5)))).vertices
    if kind == 'uv':
        return trimesh.creation.uv_sphere(1, count=[n, n]).vertices
    k = np.arange(int(n * n / np.pi)) + 0.5
    z, azimuth = 1 - 2 * k / len(k), np.pi * (1 + 5**0.5) * k + g.uniform(0, 6)
    radius = np.sqrt(1 - z**2)
    return np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth), z], axis=1)


def cut(points: Array, level: float) -> Array:
    """Return the convex part above z = level of the hull of points."""
    mesh = trimesh.convex.convex_hull(points)
    part = trimesh.intersections.slice_mesh_plane(mesh, [0, 0, 1], [0, 0, level])
    return np.asarray(part.vertices)


def sagitta(n: int) -> float:
    """Return the depth of the sides of a polygon of n sides below its circle of radius 1."""
    return 1 - np.cos(np.pi / n)


# -- The families ---------------------------------------------------------------------------------


def known_shape(name: str, points: Array, aspects: int, depth: float, known: bool) -> Shape:
    """Return a shape, whose number of aspects is stated if it is known."""
    return Shape(name, points, int(aspects) if known else None, depth)


def clear_of_noise(barrier: float) -> bool:
    """Return whether it is certain that a barrier, as a share of the height, is noise or not."""
    return abs(barrier / NOISE - 1) > NEAR_NOISE


def whole_ball(g: Generator) -> Shape:
    """Return a ball, which has one aspect: all heights are equal but for the mesh."""
    n, kind = int(g.integers(16, 72)), str(g.choice(['ico', 'uv', 'spiral']))
    return Shape(f'ball {kind} {n}', ball(n, kind, g), 1, 2 * (1 - np.cos(2 * np.pi / n)))


def ball_with_flats(g: Generator) -> Shape:
    """Return a ball with one flat or two opposite ones.

    Each flat is an aspect, and what is left of the ball is one more. One flat moves the centre of
    mass away from it, so that the ball also rests opposite to it; with two flats, all heights of
    the round side are equal. The barrier of a flat is what was cut off.
    """
    n, kind = int(g.integers(24, 72)), str(g.choice(['ico', 'uv', 'spiral']))
    flats = int(g.integers(1, 3))
    level = g.uniform(0.75, 0.97)
    points = cut(ball(n, kind, g), -level)
    if flats == 2:
        points = cut(points * [1, 1, -1], -level)
    depth = 2 * (1 - np.cos(2 * np.pi / n))
    name = f'ball {kind} {n}, {flats} flats at {level:.3f}'
    return known_shape(name, points, flats + 1, depth, 1 - level > CERTAIN * depth)


def ellipsoid(g: Generator) -> Shape:
    """Return an ellipsoid, which rests on the two ends of its shortest axis.

    The lowest way between them is over the middle axis, so that the barrier is the difference.
    """
    n = int(g.choice([20, 40]))
    axes = g.uniform(0.6, 1.0), g.uniform(0.3, 0.9)
    points = ball(n, 'ico', g) @ Rotation.random(random_state=int(g.integers(1 << 31))).as_matrix()
    b, c = max(axes), min(axes)
    depth = 2 * (1 - np.cos(2 * np.pi / n)) / c**2
    name = f'ellipsoid {n}, {b:.2f} x {c:.2f}'
    return known_shape(name, points * [1.0, b, c], 2, depth, b - c > CERTAIN * depth)


def shaft(g: Generator) -> Shape:
    """Return a shaft with a flat: two ends, the flat, and the round side opposite to it.

    The barrier of the flat is what was cut off; the ends are large, because the shaft is not long.
    """
    n, level, length = int(g.integers(32, 129)), g.uniform(0.8, 0.985), g.uniform(1.0, 6.0)
    points = d_shaft(n, level, length)
    name = f'D shaft {n}, flat {level:.3f}, {length:.2f} long'
    return known_shape(name, points, 4, sagitta(n), 1 - level > CERTAIN * sagitta(n))


def d_shaft(n: int, level: float, length: float) -> Array:
    """Return the corners of a shaft of n sides and radius 1 with a flat at y = level."""
    outline = circle(n)
    outline = outline[outline[:, 1] < level - 1e-3]
    half = np.sqrt(1 - level**2)
    return extruded([*outline, (half, level), (-half, level)], length)


def capsule(g: Generator) -> Shape:
    """Return a capsule, which rests all around, or one with a flat along its side.

    With a flat it rests on this and opposite to it, because the centre of mass is not central.
    """
    n, length = 4 * int(g.integers(6, 16)), g.uniform(0.5, 6.0)
    angles = arc(np.pi / 2, n)
    profile = [(np.cos(t), z * (length / 2 + np.sin(t))) for t in angles for z in (-1, 1)]
    points = revolved(profile, n)
    depth = 2 * sagitta(n)
    name = f'capsule {n}, {length:.2f} long'
    if g.random() < 0.5:
        return Shape(name, points, 1, depth)
    level = g.uniform(0.7, 0.97)
    points = cut(points[:, [1, 2, 0]], -level)
    name = f'{name}, flat {level:.3f}'
    return known_shape(name, points, 2, depth, 1 - level > CERTAIN * depth)


def cone(g: Generator) -> Shape:
    """Return a cone or a frustum, which rests on its base and its top.

    It rests on its side, too, if the foot of the perpendicular from its centre of mass is between
    the ends of the side.
    """
    n, top, height = int(g.integers(20, 100)), g.uniform(0.0, 0.9), g.uniform(0.5, 4.0)
    top = 0.0 if g.random() < 0.3 else top
    centre = height * (1 + 2 * top + 3 * top**2) / (4 * (1 + top + top**2))
    tilt, slant = np.arctan2(1 - top, height), np.hypot(1 - top, height)
    foot = (np.sin(tilt) + centre * np.cos(tilt)) / slant  # from the rim of the base, as a share
    clear = abs(foot - 1) > 0.1 and abs(foot) > 0.1 and (top == 0 or top > 0.1)
    # Noise can tip it over from a narrow top.
    above = height - centre
    clear &= top == 0 or np.hypot(above, top * np.cos(np.pi / n)) / above - 1 > 2 * NOISE
    aspects = 1 + (0 < foot < 1) + (top > 0)
    name = f'cone {n}, {top:.2f}, {height:.2f}'
    return known_shape(name, revolved([(1, 0), (top, height)], n), aspects, sagitta(n), clear)


def lens(g: Generator) -> Shape:
    """Return a lens, which rests on its two sides, and on its rim if this is cylindrical."""
    n, rise, rim = int(g.integers(24, 80)), g.uniform(0.1, 0.6), g.choice([0.0, 0.3])
    radius = (1 + rise**2) / (2 * rise)
    base = rim / 2 - radius + rise
    angles = arc(np.arcsin(1 / radius), n)
    profile = [
        (radius * np.sin(t), z * (base + radius * np.cos(t))) for t in angles for z in (-1, 1)
    ]
    depth = 2 * radius * sagitta(n)
    clear = rim == 0 or np.hypot(1, rim / 2) - 1 > CERTAIN * depth
    name = f'lens {n}, {rise:.2f}, rim {rim:.1f}'
    return known_shape(name, revolved(profile, n), 2 + (rim > 0), depth, clear)


def rounded_box(g: Generator) -> Shape:
    """Return a box, perhaps with fillets, which rests on its six sides.

    This is known if the barrier over each fillet is above the depth of the mesh.
    """
    n, fillet = 4 * int(g.integers(4, 13)), g.choice([0.0, g.uniform(0.02, 0.9)])
    cube = g.random() < 0.5
    half = np.array([1.0, 1.0, 1.0] if cube else [1.0, g.uniform(1, 2), g.uniform(1, 3)])
    core = half - fillet
    t, p = (angle.ravel() for angle in np.meshgrid(*[arc(np.pi / 2, n)] * 2, indexing='ij'))
    octant = np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)], axis=1)
    signs = np.array(np.meshgrid(*[(-1, 1)] * 3)).reshape(3, -1).T
    points = np.concatenate([(core + fillet * octant) * sign for sign in signs])
    depth = 2 * fillet * sagitta(n)
    pairs = [(0, 1), (1, 0), (0, 2), (2, 0), (1, 2), (2, 1)]
    barrier = min(np.hypot(core[a], core[b]) + fillet - half[b] for a, b in pairs)
    name = f'rounded box {(2 * half).round(2).tolist()}, {n}, {fillet:.3f}'
    return known_shape(name, points, 6, depth, barrier > CERTAIN * depth + 0.01)


def needle(g: Generator) -> Shape:
    """Return a long prism, which rests on its sides: the barriers of its ends are noise.

    From 15 sides on, with steps below 25 degrees, the sides are the mesh of one round side.
    """
    n, slender = int(g.integers(3, 65)), 10 ** g.uniform(1.5, 3.3)
    points = extruded(circle(n), 2 * slender)
    name = f'needle of {n} sides, 1:{slender:.0f}'
    return Shape(name, points, 1, sagitta(n)) if n > 14 else Shape(name, points, n, 0.0)


def prism(g: Generator) -> Shape:
    """Return a prism, which rests on its ends, and on its sides or one round side: see needle."""
    n, height = int(g.integers(3, 301)), g.uniform(0.8, 6.0)
    points = extruded(circle(n), height)
    name = f'prism of {n} sides, {height:.2f}'
    return Shape(name, points, 3, sagitta(n)) if n > 14 else Shape(name, points, n + 2, 0.0)


def disc(g: Generator) -> Shape:
    """Return a disc, which rests on its faces, and on its rim if the barrier is above noise."""
    n, thickness = int(g.integers(24, 129)), 10 ** g.uniform(-3, -0.5)
    barrier = np.hypot(1, thickness / 2) - 1
    aspects = 2 + (barrier > NOISE)
    points = extruded(circle(n), thickness)
    name = f'disc {n}, {thickness:.4f} thick'
    return known_shape(name, points, aspects, sagitta(n), clear_of_noise(barrier))


def chamfered_disc(g: Generator) -> Shape:
    """Return a disc with chamfers, which rests on its rim if the barrier is above noise.

    A chamfer of up to 24 degrees is not an aspect: the part tips over it onto the face.
    """
    n, thickness = int(g.integers(32, 129)), g.uniform(0.3, 0.8)
    angle, width = np.radians(g.uniform(10, 24)), g.uniform(0.1, 0.4)
    rise = min(width * np.tan(angle), 0.4 * thickness)
    points = chamfered(n, thickness, width, rise)
    barrier = np.hypot(1, thickness / 2 - rise) - 1
    aspects = 2 + (barrier > NOISE)
    name = f'chamfered disc {n}, rim {thickness - 2 * rise:.3f}'
    return known_shape(name, points, aspects, sagitta(n), clear_of_noise(barrier))


def chamfered(n: int, thickness: float, width: float, rise: float) -> Array:
    """Return the corners of a disc of radius 1 with chamfers, ``width`` along its faces."""
    outer, inner = thickness / 2, thickness / 2 - rise
    return revolved([(1 - width, -outer), (1 - width, outer), (1, -inner), (1, inner)], n)


def wedge(g: Generator) -> Shape:
    """Return a box whose upper side is two facets with a small angle between them.

    It has seven sides, but if the barrier between these two is noise, they are one aspect.
    """
    angle, width, height = g.uniform(0.1, 10), g.uniform(1.5, 3), g.uniform(1.0, 1.6)
    ridge = height + width / 2 * np.tan(np.radians(angle) / 2)
    base, sides = [(-width / 2, 0), (width / 2, 0)], [(width / 2, height), (-width / 2, height)]
    points = extruded([*base, sides[0], (0, ridge), sides[1]], 1.4)
    hull = Landscape(points)
    low = [(k, barrier) for k, barrier in hull.minima() if barrier < 0.02 * hull.radius]
    roof = max((barrier / hull.heights[k] for k, barrier in low), default=0)
    aspects = 6 + (roof > NOISE)
    clear = abs(roof / NOISE - 1) > 0.1
    return known_shape(f'wedge {angle:.2f} degrees', points, aspects, 0.0, clear)


def polyhedron(g: Generator) -> Shape:
    """Return a hull of random points, whose number of aspects only the landscape tells."""
    n = int(g.integers(5, 17))
    points = g.standard_normal((n, 3)) * g.uniform(0.3, 1, 3)
    return Shape(f'polyhedron {n}', points, None, 0.0)


FAMILIES: tuple[Callable[[Generator], Shape], ...] = (
    whole_ball, ball_with_flats, ellipsoid, shaft, capsule, cone, lens, rounded_box, needle, prism,
    disc, chamfered_disc, wedge, polyhedron,
)  # fmt: skip
