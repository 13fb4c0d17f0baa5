"""Random solids of six kinds, from which the learned estimator is fitted.

Solid i of a data set is of the kind i modulo 6, and depends only on the seed of the data set and
on i. Sizes are in mm; only proportions matter. About every second part rests on a curved side
if its kind has any.
"""

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import trimesh
from make_parts import Point, prism, tube
from scipy.spatial import ConvexHull

from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.part_loading import part_from_bytes

Array = npt.NDArray[np.float64]

# Sides of a full circle.
SIDES = 48
SIZE = 20.0


def solid(seed: int, index: int) -> Part:
    """Return a solid of the data set."""
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(index,)))
    kind = kind_of(index)
    data = KINDS[kind](rng).export(file_type='stl')
    assert isinstance(data, bytes)
    return part_from_bytes(data, 'stl', f'{kind}_{index}')


def kind_of(index: int) -> str:
    """Return the kind of a solid."""
    return tuple(KINDS)[index % len(KINDS)]


def polyhedron(rng: np.random.Generator) -> trimesh.Trimesh:
    """Return the hull of 4 to 20 random points on an ellipsoid, or of points in a ball.

    As in the study of Varkonyi (2014), except for the ellipsoid.
    """
    points = rng.standard_normal((int(rng.integers(4, 21)), 3))
    radii = np.linalg.norm(points, axis=1, keepdims=True)
    points /= radii
    if rng.random() < 0.5:
        points *= rng.random((len(points), 1)) ** (1 / 3)
    stretch = np.exp(rng.uniform(0, np.log(2.5), 3)) if rng.random() < 0.6 else np.ones(3)
    return trimesh.convex.convex_hull(points * stretch * SIZE)


def box(rng: np.random.Generator) -> trimesh.Trimesh:
    """Return a box with sides up to 1 : 5, and in every fourth case with a square side."""
    sides = np.exp(rng.uniform(0, np.log(5), 3))
    if rng.random() < 0.25:
        sides[1] = sides[0]
    return trimesh.creation.box(SIZE * sides / sides.max())


def prism_of(rng: np.random.Generator) -> trimesh.Trimesh:
    """Return a prism on a regular or random convex polygon, a half disc, or a slot shape."""
    form = rng.integers(5)
    if form == 0:
        outline = _regular(int(rng.integers(3, 9)))
    elif form < 3:
        points = rng.standard_normal((int(rng.integers(4, 10)), 2))
        points *= [1.0, rng.uniform(0.4, 1.0)]
        outline = points[ConvexHull(points).vertices]
    elif form == 3:
        outline = _arc(0.0, rng.uniform(0.4, 1.6) * np.pi)
    else:
        gap = rng.uniform(0.2, 2.0)
        right, left = _arc(-np.pi / 2, np.pi), _arc(np.pi / 2, np.pi)
        outline = np.vstack([right + np.array([gap, 0]), left - np.array([gap, 0])])
    height = np.ptp(outline, axis=0).max() * np.exp(rng.uniform(np.log(0.2), np.log(2.5)))
    return prism(_points(outline), float(height * SIZE))


def round_of(rng: np.random.Generator) -> trimesh.Trimesh:
    """Return a cylinder, a tube, a truncated cone, or a stepped shaft."""
    form = rng.integers(4)
    height = float(2 * np.exp(rng.uniform(np.log(0.1), np.log(3.0))))
    circle = _regular(SIDES)
    if form == 0:
        return prism(_points(circle), height * SIZE)
    if form == 1:
        inner = circle * rng.uniform(0.3, 0.9)
        return tube(_points(circle), _points(inner), height * SIZE)
    if form == 2:
        top = circle * rng.uniform(0.3, 0.95)
        points = np.vstack([_level(circle, 0.0), _level(top, height)])
        return trimesh.convex.convex_hull(points * SIZE)
    second = circle * rng.uniform(0.35, 0.8)
    base = np.vstack([_level(circle, 0.0), _level(circle, height)])
    shaft = np.vstack([_level(second, height / 2), _level(second, height * rng.uniform(1.2, 3))])
    return _union([trimesh.convex.convex_hull(each * SIZE) for each in (base, shaft)])


def bracket(rng: np.random.Generator) -> trimesh.Trimesh:
    """Return an extruded L, T, U or Z profile."""
    x, y = np.exp(rng.uniform(np.log(0.4), 0, 2))
    a, b = rng.uniform(0.1, 0.45, 2) * [x, y]
    form = rng.integers(4)
    if form == 0:
        outline = [(0, 0), (x, 0), (x, b), (a, b), (a, y), (0, y)]
    elif form == 1:
        left, right = np.sort(rng.uniform(0, x, 2)) if rng.random() < 0.5 else (x / 2 - a / 2,) * 2
        right = left + a if right - left < 0.1 * x else right
        outline = [(0, 0), (x, 0), (x, b), (right, b), (right, y), (left, y), (left, b), (0, b)]
        outline = [(float(min(px, x)), py) for px, py in outline]
    elif form == 2:
        c = a if rng.random() < 0.6 else rng.uniform(0.1, 0.45) * x
        second = y if rng.random() < 0.6 else rng.uniform(b, y)
        second = max(second, 1.2 * b)
        outline = [
            (0, 0),
            (x, 0),
            (x, second),
            (x - c, second),
            (x - c, b),
            (a, b),
            (a, y),
            (0, y),
        ]
    else:
        step = rng.uniform(0.3, 0.9) * x
        outline = [
            *((0, 0), (a + step, 0), (a + step, y - b), (a + x, y - b), (a + x, y)),
            *((step, y), (step, b), (0, b)),
        ]
    height = float(np.exp(rng.uniform(np.log(0.15), np.log(1.5))))
    return prism([(SIZE * float(p), SIZE * float(q)) for p, q in outline], SIZE * height)


def union(rng: np.random.Generator) -> trimesh.Trimesh:
    """Return the union of two to four boxes and cylinders along the axes, or its hull."""
    pieces: list[trimesh.Trimesh] = []
    for number in range(int(rng.integers(2, 5))):
        size = np.exp(rng.uniform(np.log(0.2), 0, 3))
        if rng.random() < 0.65:
            piece = trimesh.creation.box(SIZE * size)
        else:
            circle = _regular(SIDES) * size[0] / 2
            piece = prism(_points(circle), float(SIZE * size[2]))
            piece.apply_translation([0, 0, -SIZE * size[2] / 2])
            piece.apply_transform(_turn(int(rng.integers(3))))
        if number:
            low, high = pieces[int(rng.integers(number))].bounds
            piece.apply_translation(rng.uniform(low, high) * rng.choice([0, 1, 1], 3))
        pieces.append(piece)
    if rng.random() < 0.5:
        return trimesh.convex.convex_hull(np.vstack([piece.vertices for piece in pieces]))
    return _union(pieces)


KINDS: dict[str, Callable[[np.random.Generator], trimesh.Trimesh]] = {
    'polyhedron': polyhedron,
    'box': box,
    'prism': prism_of,
    'round': round_of,
    'bracket': bracket,
    'union': union,
}


def _union(pieces: list[trimesh.Trimesh]) -> trimesh.Trimesh:
    return trimesh.boolean.union(pieces, engine='manifold')


def _regular(sides: int) -> Array:
    turns = 2 * np.pi * np.arange(sides) / sides
    return np.column_stack([np.cos(turns), np.sin(turns)])


def _arc(start: float, angle: float) -> Array:
    turns = np.linspace(start, start + angle, max(3, round(SIDES * angle / (2 * np.pi)) + 1))
    return np.column_stack([np.cos(turns), np.sin(turns)])


def _level(outline: Array, height: float) -> Array:
    return np.column_stack([outline, np.full(len(outline), height)])


def _points(outline: Array) -> list[Point]:
    return [(float(SIZE * x), float(SIZE * y)) for x, y in outline]


def _turn(axis: int) -> Array:
    """Return the transformation that turns z to one of the axes."""
    return np.eye(4)[:, [[1, 2, 0], [2, 0, 1], [0, 1, 2]][axis] + [3]].astype(np.float64)
