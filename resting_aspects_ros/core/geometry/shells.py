"""Which way the bodies of a mesh face: outward in the open, inward where they are cavities.

A shell is a closed piece of a surface. A mesh may have many: bodies side by side, cavities, and
bodies in cavities.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

# Shells around one shell, by their boxes. No part has as many, and each costs time.
DEEPEST = 100

# How far behind a triangle is the point that stands for the inside of its shell, as a share of
# the triangle's size: more than the noise of float32, less than any wall.
BEHIND = 1e-3

# Turns the z axis, along which rays are sent, so that none passes along a side that a part is
# likely to have.
ASKEW = Rotation.from_rotvec((0.7, 1.1, 0.3)).as_matrix()


@dataclass(frozen=True, eq=False)
class FacingCheck:
    """Which triangles face the wrong way, (m,), and what there is to say about it.

    body : (m,) int64
        The body to which each triangle belongs: a shell that faces outward, with its cavities.
    """

    inward: Flags
    body: Indices
    warnings: list[str]
    defect: str | None = None


def facing(corners: Array, shell: Indices, mended: Flags) -> FacingCheck:
    """Tell which triangles belong to shells that face the wrong way.

    A shell in the open must face outward. A shell inside another one is a cavity if it faces
    inward, as it should. Where the shell around it was inside out, or its own triangles were in
    disorder, it is taken as a cavity as well.

    Parameters
    ----------
    corners : (m, 3, 3) float64
        Of the triangles, near the origin.
    shell : (m,) int64
        To which shell each triangle belongs, from 0 on; each one is closed and in order.
    mended : (m,) bool
        Triangles that were in disorder, so that the side to which their shell faces is chance.
    """
    volumes = np.bincount(shell, weights=np.linalg.det(corners))
    doubtful = np.bincount(shell, weights=mended) > 0
    order = np.argsort(shell, kind='stable')
    triangles = np.split(corners[order], np.cumsum(np.bincount(shell))[:-1])
    # A shell comes after all that can be around it, which are larger.
    largest_first = np.argsort(-np.abs(volumes), kind='stable')
    boxed = _boxed(triangles, largest_first)
    if boxed is None:
        none = np.zeros(len(shell), dtype=bool)
        return FacingCheck(
            none, shell * 0, [], f'has more than {DEEPEST} bodies inside each other'
        )
    around: dict[int, dict[int, int]] = {}
    for o, inner in boxed.items():
        points = np.array([_inner_point(triangles[s], volumes[s]) for s in inner])
        for s, turn in zip(inner, _turns(points, triangles[o]).tolist(), strict=True):
            around.setdefault(s, {})[o] = turn
    flip, body = volumes < 0, np.arange(len(volumes))
    for s in filter(around.__contains__, largest_first.tolist()):
        turns, flip[s] = around[s], False
        depth = sum(-turn if flip[o] else turn for o, turn in turns.items())
        if depth <= 0:
            flip[s] = volumes[s] < 0
        elif volumes[s] > 0:
            flip[s] = doubtful[s] or any(turn and flip[o] for o, turn in turns.items())
        if (volumes[s] < 0) != flip[s]:
            # A cavity: the smallest body around it is the one it is in.
            body[s] = [o for o in turns if turns[o] and body[o] == o][-1]
    return FacingCheck(flip[shell], body[shell], _warnings(flip & ~doubtful))


def _boxed(triangles: list[Array], largest_first: Indices) -> dict[int, list[int]] | None:
    """The shells in the box of each shell that is no smaller, if any; None if too many are."""
    low = np.array([t.min(axis=(0, 1)) for t in triangles])
    high = np.array([t.max(axis=(0, 1)) for t in triangles])
    middle, half = (low + high) / 2, (high - low).max(axis=1) / 2
    near = KDTree(middle)
    rank = np.argsort(largest_first)
    count = np.zeros(len(rank), dtype=np.int64)
    found = {}
    for o in largest_first.tolist():
        inner = np.array(near.query_ball_point(middle[o], 1.01 * half[o], p=np.inf))
        inner = inner[(low[inner] >= low[o]).all(axis=1) & (high[inner] <= high[o]).all(axis=1)]
        inner = inner[rank[inner] > rank[o]]
        count[inner] += 1
        if count[inner].max(initial=0) > DEEPEST:
            return None
        if len(inner):
            found[o] = inner.tolist()
    return found


def _warnings(flipped: Flags) -> list[str]:
    if flipped.all():
        return ['the mesh was inside out and was turned']
    count, total = np.count_nonzero(flipped), len(flipped)
    return [f'{count} of {total} bodies were inside out and were turned'] if count else []


def _inner_point(triangles: Array, volume: float) -> Array:
    """Return a point (3,) enclosed by a shell, just behind the middle of its largest triangle.

    Not on the triangle: bodies often touch, and there the side on which a point is would be noise.
    """
    a, b, c = np.moveaxis(triangles, 1, 0)
    normals = np.cross(b - a, c - a)
    largest = int((normals**2).sum(axis=1).argmax())
    normal = normals[largest] * np.sign(volume)
    size = np.sqrt(np.linalg.norm(normals[largest])) or 1.0
    return np.asarray(triangles[largest].mean(axis=0) - BEHIND / size * normal)


def _turns(points: Array, shell: Array) -> Indices:
    """Return how often a shell, (m, 3, 3), winds round points (n, 3): 1 or -1 inside, else 0.

    What a ray from the point passes through from inside, less what it does from outside. Two
    triangles agree to the last bit on which side of their common edge it passes.
    """
    shell, points = shell @ ASKEW, points @ ASKEW
    low, high = shell.min(axis=1), shell.max(axis=1)
    turns = np.zeros(len(points), dtype=np.int64)
    for k, (x, y, _) in enumerate(points):
        ahead = np.flatnonzero((low[:, 0] <= x) & (high[:, 0] >= x))
        ahead = ahead[(low[ahead, 1] <= y) & (high[ahead, 1] >= y)]
        arms = shell[ahead] - points[k]
        u, v = arms[:, :, 0], arms[:, :, 1]
        # Twice the areas that the ray makes with the three edges, seen along it.
        areas = np.roll(u, -1, 1) * np.roll(v, -2, 1) - np.roll(u, -2, 1) * np.roll(v, -1, 1)
        sense = np.sign(areas)
        met = (sense == sense[:, :1]).all(axis=1) & (
            (areas * arms[:, :, 2]).sum(axis=1) * sense[:, 0] > 0
        )
        turns[k] = sense[met, 0].sum()
    return turns
