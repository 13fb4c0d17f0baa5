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


@dataclass(frozen=True)
class Shape:
    """A convex part.

    name : str
        Family and parameters.
    points : (n, 3) float
        Of any unit.
    aspects : int or None
        Number of aspects, if the barriers are far from those that the mesh explains.
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
        tri = points[hull.simplices]
        inside = points[hull.vertices].mean(axis=0)
        a, b, c = np.moveaxis(tri - inside, 1, 0)
        volume = np.abs((a * np.cross(b, c)).sum(axis=1)) / 6
        centre = (volume[:, None] * (tri.sum(axis=1) + inside) / 4).sum(axis=0) / volume.sum()
        self.points = points[hull.vertices] - centre
        self.radius = np.linalg.norm(self.points, axis=1).max()
        self.normals = hull.equations[:, :3]
        self.heights = -(hull.equations[:, 3] + self.normals @ centre)
        one, k = np.divmod(np.arange(3 * len(tri)), 3)
        other = hull.neighbors.ravel()
        ends = [hull.simplices[one, (k + step) % 3] for step in (1, 2)]
        first = points[ends[0]] - centre
        along = points[ends[1]] - points[ends[0]]
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        foot = first - (first * along).sum(axis=1, keepdims=True) * along
        top = np.linalg.norm(foot, axis=1)
        turn = np.cross(self.normals[one], self.normals[other])
        between = ((np.cross(self.normals[one], foot) * turn).sum(axis=1) > 0) & (
            (np.cross(foot, self.normals[other]) * turn).sum(axis=1) > 0
        )
        level = np.maximum(self.heights[one], self.heights[other])
        height = np.where(between, np.maximum(top, level), level)
        order = np.argsort(height, kind='stable')
        order = order[one[order] < other[order]]
        self.passes = list(
            zip(height[order].tolist(), one[order].tolist(), other[order].tolist(), strict=True)
        )

    def height(self, down: Array) -> Array:
        """Return the heights (n,) of the centre of mass for directions of gravity (n, 3)."""
        return (np.asarray(down) @ self.points.T).max(axis=1)

    def minima(self) -> list[tuple[int, float]]:
        """Return triangle and barrier of each minimum: the rise to the next lower one."""
        low = list(range(len(self.heights)))

        def root(k: int) -> int:
            while low[k] != k:
                low[k] = low[low[k]]
                k = low[k]
            return k

        found = []
        for height, a, b in self.passes:
            one, other = sorted((root(a), root(b)), key=lambda k: self.heights[k])
            if one != other:
                found.append((other, height - self.heights[other]))
                low[other] = one
        return [(root(0), np.inf), *found]

    def lowest_passes(self, group: Array) -> Array:
        """Return (g,) heights of the lowest passes from triangles of each group to other groups.

        ``group`` (f,) is the number of the group of each triangle, or -1.
        """
        parent = list(range(len(self.heights)))
        owner: list[set[int]] = [{int(g)} - {-1} for g in group]
        found = np.full(int(max(group)) + 1, np.inf)

        def root(k: int) -> int:
            while parent[k] != k:
                parent[k] = parent[parent[k]]
                k = parent[k]
            return k

        for height, a, b in self.passes:
            one, other = root(a), root(b)
            if one == other:
                continue
            if owner[one] and owner[other] and owner[one] != owner[other]:
                for k in owner[one] | owner[other]:
                    if owner[one] != {k} or owner[other] != {k}:
                        found[k] = min(found[k], height)
            parent[other] = one
            owner[one] |= owner[other]
        return found


# -- The families ---------------------------------------------------------------------------------


def circle(n: int, radius: float = 1.0) -> Array:
    """Return n points on a circle (n, 2)."""
    angle = 2 * np.pi * np.arange(n) / n
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def revolved(profile: Array, n: int) -> Array:
    """Return circles of n points: radius and z each."""
    rows = [(x, y, z) for r, z in profile for x, y in (circle(n, r) if r > 1e-9 else [(0, 0)])]
    return np.array(rows)


def extruded(outline: Array, height: float) -> Array:
    """Return the corners of a prism."""
    return np.array([(x, y, end * height / 2) for x, y in outline for end in (-1, 1)])


def arc(start: float, stop: float, n: int) -> Array:
    """Return angles of a circle in steps of at most 1 / n of it."""
    return np.linspace(start, stop, max(2, int(np.ceil(abs(stop - start) * n / (2 * np.pi)))) + 1)


def ball(n: int, kind: str, g: np.random.Generator) -> Array:
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
    plane = trimesh.intersections.slice_mesh_plane(mesh, [0, 0, 1], [0, 0, level])
    return np.asarray(plane.vertices)


def ball_with_flats(g: np.random.Generator) -> Shape:
    n, kind = int(g.integers(24, 72)), str(g.choice(['ico', 'uv', 'spiral']))
    flats = int(g.integers(1, 3))
    level = g.uniform(0.75, 0.97)
    points = cut(ball(n, kind, g), -level)
    if flats == 2:
        points = cut(points * [1, 1, -1], -level)
    depth = 2 * (1 - np.cos(2 * np.pi / n))
    # One flat moves the centre of mass, and the round side ends opposite to it or all around.
    known = 1 - level > 4 * depth
    return Shape(
        f'ball {kind} {n}, {flats} flats at {level:.3f}',
        points,
        (flats + 1) * known or None,
        depth,
    )


def whole_ball(g: np.random.Generator) -> Shape:
    n, kind = int(g.integers(16, 72)), str(g.choice(['ico', 'uv', 'spiral']))
    return Shape(f'ball {kind} {n}', ball(n, kind, g), 1, 2 * (1 - np.cos(2 * np.pi / n)))


def ellipsoid(g: np.random.Generator) -> Shape:
    n = int(g.choice([20, 40]))
    a, b, c = 1.0, g.uniform(0.6, 1.0), g.uniform(0.3, 0.9)
    points = ball(n, 'ico', g) @ Rotation.random(random_state=int(g.integers(1 << 31))).as_matrix()
    b, c = max(b, c), min(b, c)
    depth = 2 * (1 - np.cos(2 * np.pi / n)) / c**2
    known = b - c > 4 * depth
    return Shape(f'ellipsoid {n}, {b:.2f} x {c:.2f}', points * [a, b, c], 2 * known or None, depth)


def shaft(g: np.random.Generator) -> Shape:
    n, level, length = int(g.integers(32, 129)), g.uniform(0.8, 0.985), g.uniform(1.0, 6.0)
    outline = circle(n)
    outline = outline[outline[:, 1] < level - 1e-3]
    half = np.sqrt(1 - level**2)
    depth = 1 - np.cos(np.pi / n)
    points = extruded([*outline, (half, level), (-half, level)], length)
    known = 1 - level > 4 * depth
    return Shape(
        f'D shaft {n}, flat {level:.3f}, {length:.2f} long', points, 4 * known or None, depth
    )


def capsule(g: np.random.Generator) -> Shape:
    n, length = 4 * int(g.integers(6, 16)), g.uniform(0.5, 6.0)
    profile = [
        (np.cos(t), end * (length / 2 + np.sin(t)))
        for t in arc(0, np.pi / 2, n)
        for end in (-1, 1)
    ]
    points = revolved(profile, n)
    depth = 2 * (1 - np.cos(np.pi / n))
    if g.random() < 0.5:
        return Shape(f'capsule {n}, {length:.2f} long', points, 1, depth)
    level = g.uniform(0.7, 0.97)
    known = 1 - level > 4 * depth
    points = cut(points[:, [1, 2, 0]], -level)
    return Shape(
        f'capsule {n}, {length:.2f} long, flat {level:.3f}', points, 2 * known or None, depth
    )


def cone(g: np.random.Generator) -> Shape:
    n, top, height = int(g.integers(20, 100)), g.uniform(0.0, 0.9), g.uniform(0.5, 4.0)
    top = 0.0 if g.random() < 0.3 else top
    depth = 1 - np.cos(np.pi / n)
    volume = 1 + top + top**2
    centre = height * (1 + 2 * top + 3 * top**2) / (4 * volume)
    # On its side it rests if its centre of mass is above the side, and on its top likewise.
    tilt = np.arctan2(1 - top, height)
    slant = np.hypot(1 - top, height)
    along = (1 - top) * np.sin(tilt) + centre * np.cos(tilt)  # from the rim of the base
    side = 0 < along < slant
    known = (
        abs(along - slant) > 0.1 * slant and abs(along) > 0.1 * slant and (top == 0 or top > 0.1)
    )
    points = revolved([(1, 0), (top, height)], n)
    return Shape(
        f'cone {n}, {top:.2f}, {height:.2f}', points, (1 + side + (top > 0)) * known or None, depth
    )


def lens(g: np.random.Generator) -> Shape:
    n, rise, rim = int(g.integers(24, 80)), g.uniform(0.1, 0.6), g.choice([0.0, 0.3])
    radius = (1 + rise**2) / (2 * rise)
    half = np.arcsin(1 / radius)
    profile = [
        (radius * np.sin(t), end * (rim / 2 + radius * np.cos(t) - radius + rise))
        for t in arc(0, half, n)
        for end in (-1, 1)
    ]
    depth = 2 * radius * (1 - np.cos(np.pi / n))
    known = np.hypot(1, rim / 2) - 1 > 4 * depth or rim == 0
    return Shape(
        f'lens {n}, {rise:.2f}, rim {rim:.1f}',
        revolved(profile, n),
        (2 + (rim > 0)) * known or None,
        depth,
    )


def rounded_box(g: np.random.Generator) -> Shape:
    n, fillet = 4 * int(g.integers(4, 13)), g.choice([0.0, g.uniform(0.02, 0.9)])
    sides = 2 * np.array(
        [1.0, 1.0, 1.0] if g.random() < 0.5 else [1.0, g.uniform(1, 2), g.uniform(1, 3)]
    )
    core = sides / 2 - fillet
    angles = arc(0, np.pi / 2, n)
    corner = [
        (np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)) for t in angles for p in angles
    ]
    corner = core + fillet * np.array(corner)
    signs = np.array(np.meshgrid(*[(-1, 1)] * 3)).reshape(3, -1).T
    depth = 2 * fillet * (1 - np.cos(np.pi / n))
    points = np.concatenate([corner * sign for sign in signs])
    lowest = min(
        np.hypot(*np.delete(core, k)) + fillet - sides[j] / 2
        for k in range(3)
        for j in range(3)
        if j != k
    )
    return Shape(
        f'rounded box {sides.round(2).tolist()}, {n}, {fillet:.3f}',
        points,
        6 if lowest > 4 * depth + 0.01 else None,
        depth,
    )


def needle(g: np.random.Generator) -> Shape:
    n, slender = int(g.integers(3, 65)), 10 ** g.uniform(1.5, 3.3)
    depth = (1 - np.cos(np.pi / n)) if n > 14 else 0.0
    return Shape(
        f'needle of {n} sides, 1:{slender:.0f}',
        extruded(circle(n), 2 * slender),
        1 if n > 14 else n,
        depth,
    )


def prism(g: np.random.Generator) -> Shape:
    n, height = int(g.integers(3, 301)), g.uniform(0.8, 6.0)
    depth = (1 - np.cos(np.pi / n)) if n > 14 else 0.0
    return Shape(
        f'prism of {n} sides, {height:.2f}',
        extruded(circle(n), height),
        3 if n > 14 else n + 2,
        depth,
    )


def disc(g: np.random.Generator) -> Shape:
    n, thickness = int(g.integers(24, 129)), 10 ** g.uniform(-3, -0.5)
    depth = 1 - np.cos(np.pi / n)
    barrier = np.hypot(1, thickness / 2) - 1
    aspects = 3 if barrier > 1.3e-3 else 2 if barrier < 0.7e-3 else None
    return Shape(
        f'disc {n}, {thickness:.4f} thick', extruded(circle(n), thickness), aspects, depth
    )


def chamfered_disc(g: np.random.Generator) -> Shape:
    n, thickness, angle = (
        int(g.integers(32, 129)),
        g.uniform(0.3, 0.8),
        np.radians(g.uniform(10, 24)),
    )
    width = g.uniform(0.1, 0.4)
    rise = min(width * np.tan(angle), 0.4 * thickness)
    rim = thickness - 2 * rise
    barrier = np.hypot(1, rim / 2) - 1
    depth = 1 - np.cos(np.pi / n)
    profile = [(1 - width, end * thickness / 2) for end in (-1, 1)] + [
        (1, end * rim / 2) for end in (-1, 1)
    ]
    aspects = 3 if barrier > 1.3e-3 else 2 if barrier < 0.7e-3 else None
    return Shape(f'chamfered disc {n}, rim {rim:.3f}', revolved(profile, n), aspects, depth)


def wedge(g: np.random.Generator) -> Shape:
    angle, width, height = g.uniform(0.1, 10), g.uniform(1.5, 3), g.uniform(1.0, 1.6)
    rise = width / 2 * np.tan(np.radians(angle) / 2)
    outline = [
        (-width / 2, 0),
        (width / 2, 0),
        (width / 2, height),
        (0, height + rise),
        (-width / 2, height),
    ]
    hull = Landscape(extruded(outline, 1.4))
    # The two upper sides are two aspects if the barrier between them is above the noise.
    roof = [
        barrier / hull.heights[k] for k, barrier in hull.minima() if barrier < 0.02 * hull.radius
    ]
    aspects = (
        5 + 2 * (max(roof, default=0) > 1.1e-3)
        if not 0.9e-3 < max(roof, default=0) < 1.1e-3
        else None
    )
    aspects = 6 if aspects == 5 else aspects
    return Shape(f'wedge {angle:.2f} degrees', extruded(outline, 1.4), aspects, 0.0)


def polyhedron(g: np.random.Generator) -> Shape:
    n = int(g.integers(5, 17))
    points = g.standard_normal((n, 3)) * g.uniform(0.3, 1, 3)
    return Shape(f'polyhedron {n}', points, None, 0.0)


FAMILIES: tuple[Callable[[np.random.Generator], Shape], ...] = (
    whole_ball, ball_with_flats, ellipsoid, shaft, capsule, cone, lens, rounded_box, needle, prism,
    disc, chamfered_disc, wedge, polyhedron,
)  # fmt: skip
