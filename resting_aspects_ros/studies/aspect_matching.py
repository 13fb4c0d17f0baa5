"""Match the aspects of two designs of a part by their shape, not by their files."""

import itertools
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import linear_sum_assignment
from scipy.spatial import KDTree

from resting_aspects_ros.core.aspects.aspect_set import Aspect, AspectSet
from resting_aspects_ros.core.part import Part

Array = npt.NDArray[np.float64]

# Aspects whose down directions differ by more than this are not the same, rad.
MAX_ANGLE = np.radians(20.0)
# Heights of the centre of mass of the same aspect differ by at most this, R.
MAX_HEIGHT = 0.3
# Parts whose hulls are on average further apart than this, R, are different parts.
MAX_APART = 0.15
# Points of a hull that are compared.
SAMPLES = 400


@dataclass(frozen=True, eq=False)
class AspectMatch:
    """The symmetry classes that two designs share.

    pairs : tuple of (int, int)
        Numbers of the classes in the first and the second design, from 1.
    rotation : (3, 3) float
        Turns the second design as the first; identity if the meshes are in the same frame.
    apart : float
        Mean distance of the hulls after the rotation, R of the first.
    """

    pairs: tuple[tuple[int, int], ...]
    rotation: Array
    apart: float


def match_aspects(first: Part, one: AspectSet, second: Part, other: AspectSet) -> AspectMatch:
    """Return which symmetry classes of two designs are the same.

    The designs are compared in the frames of their meshes and, if another orientation fits
    clearly better, along their principal axes. A class is matched with the one whose direction of
    gravity and height of the centre of mass are nearest. Parts that are too different share none.
    """
    rotation, apart = _best_rotation(first, second)
    if apart > MAX_APART:
        return AspectMatch((), rotation, apart)
    mine, theirs = one.classes(), other.classes()
    cost = np.array(
        [[_difference(a, first, b, second, rotation) for b in theirs] for a in mine]
    ).reshape(len(mine), len(theirs))
    rows, columns = linear_sum_assignment(np.minimum(cost, 10.0))
    pairs = tuple(
        (int(r) + 1, int(c) + 1) for r, c in zip(rows, columns, strict=True) if cost[r, c] <= 1.0
    )
    return AspectMatch(pairs, rotation, apart)


def _difference(
    mine: tuple[Aspect, ...],
    first: Part,
    theirs: tuple[Aspect, ...],
    second: Part,
    rotation: Array,
) -> float:
    """Return how different two classes are; up to 1, they can be the same."""
    if mine[0].sweep.curved != theirs[0].sweep.curved:
        return np.inf
    height = abs(
        mine[0].com_height / first.hull_radius - theirs[0].com_height / second.hull_radius
    )
    down = np.concatenate([aspect.directions for aspect in mine])
    turned = np.concatenate([aspect.directions for aspect in theirs]) @ rotation.T
    cosine = float(np.clip((down @ turned.T).max(), -1, 1))
    angle = float(np.arccos(cosine))
    return max(angle / MAX_ANGLE, height / MAX_HEIGHT)


def _best_rotation(first: Part, second: Part) -> tuple[Array, float]:
    """Return the rotation of the second part that fits the first best, and the distance."""
    target, moved = _hull_points(first), _hull_points(second)
    # Designs of one part have the same scale; another part may not.
    tree, radius = KDTree(target), first.hull_radius
    signs = [np.diag([a, b, a * b]).astype(float) for a, b in itertools.product((1, -1), repeat=2)]
    along = [first.principal_axes @ s @ second.principal_axes.T for s in signs]
    rotations = [np.eye(3), *along]
    found = []
    for rotation in rotations:
        there = moved @ rotation.T
        both = np.asarray(tree.query(there)[0]), np.asarray(KDTree(there).query(target)[0])
        found.append(float(both[0].mean() + both[1].mean()) / (2 * radius))
    best = int(np.argmin(found))
    # The frames of the meshes are kept unless another orientation is clearly better.
    if found[0] <= 1.2 * found[best] + 0.02:
        best = 0
    return rotations[best], found[best]


def _hull_points(part: Part) -> Array:
    """Return points on the surface of a part, evenly distributed, about its centre of mass, m."""
    corners = part.vertices[part.faces]
    twice = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    edges = np.concatenate([[0.0], np.cumsum(twice)])
    # Equally spaced along the cumulated area, with the points of a Sobol-like lattice inside.
    place = (np.arange(SAMPLES) + 0.5) / SAMPLES * edges[-1]
    face = np.clip(np.searchsorted(edges, place, side='right') - 1, 0, len(corners) - 1)
    u, v = (np.arange(SAMPLES) * np.array([[0.7548776662], [0.5698402910]])) % 1.0
    flip = u + v > 1
    u, v = np.where(flip, 1 - u, u), np.where(flip, 1 - v, v)
    a, b, c = np.moveaxis(corners[face], 1, 0)
    points = a + u[:, None] * (b - a) + v[:, None] * (c - a)
    return np.asarray(points - part.centre_of_mass)
