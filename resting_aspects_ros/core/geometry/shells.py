"""Check of the orientation of shells: bodies must face outward, cavities inward.

A shell is a closed component of a surface. A mesh may have many: bodies side by side, cavities,
and bodies in cavities.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

# Maximum number of shells around one shell, by their boxes. No part has more, and each costs time.
MAX_DEPTH = 100

# Distance behind a triangle of the point that represents the inside of its shell, as a share of
# the size of the triangle: more than the noise of float32, less than any wall.
INNER_DISTANCE = 1e-3

# Rotates the mesh before rays are cast along the z axis, so that no ray is parallel to a likely
# side of a part.
RAY_ROTATION = Rotation.from_rotvec((0.7, 1.1, 0.3)).as_matrix()


@dataclass(frozen=True, eq=False)
class FacingCheck:
    """The triangles (m,) that face the wrong way, with warnings or a defect.

    body : (m,) int64
        The body of each triangle; a body is a shell that faces outward, with its cavities.
    """

    inward: Flags
    body: Indices
    warnings: list[str]
    defect: str | None = None


def check_facing(corners: Array, shell: Indices, mended: Flags) -> FacingCheck:
    """Return which triangles belong to shells that face the wrong way.

    A shell that is not inside another one must face outward. A shell inside another one is a
    cavity if it faces inward. It is treated as a cavity too if the shell around it was inside out,
    or if its own triangles had inconsistent orientations.

    Parameters
    ----------
    corners : (m, 3, 3) float64
        Corners of the triangles, near the origin.
    shell : (m,) int64
        Number of the shell of each triangle, from 0; each is closed and consistently oriented.
    mended : (m,) bool
        Triangles that were flipped, so that the orientation of their shell is arbitrary.
    """
    volumes = np.bincount(shell, weights=np.linalg.det(corners))
    doubtful = np.bincount(shell, weights=mended) > 0
    order = np.argsort(shell, kind='stable')
    triangles = np.split(corners[order], np.cumsum(np.bincount(shell))[:-1])
    # Each shell comes after all shells that can contain it, which are larger.
    largest_first = np.argsort(-np.abs(volumes), kind='stable')
    boxed = _boxed(triangles, largest_first)
    if boxed is None:
        none = np.zeros(len(shell), dtype=bool)
        return FacingCheck(
            none, shell * 0, [], f'has more than {MAX_DEPTH} bodies inside each other'
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
            # A cavity belongs to the smallest body around it.
            body[s] = [o for o in turns if turns[o] and body[o] == o][-1]
    return FacingCheck(flip[shell], body[shell], _warnings(flip & ~doubtful))


def _boxed(triangles: list[Array], largest_first: Indices) -> dict[int, list[int]] | None:
    """Return the smaller shells in the box of each shell; None if the nesting is too deep."""
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
        if count[inner].max(initial=0) > MAX_DEPTH:
            return None
        if len(inner):
            found[o] = inner.tolist()
    return found


def _warnings(flipped: Flags) -> list[str]:
    if flipped.all():
        return ['the mesh was inside out and was flipped']
    count, total = np.count_nonzero(flipped), len(flipped)
    return [f'{count} of {total} bodies were inside out and were flipped'] if count else []


def _inner_point(triangles: Array, volume: float) -> Array:
    """Return a point (3,) enclosed by a shell, just behind the middle of its largest triangle.

    The point is not on the triangle, because bodies often touch, and noise would decide on which
    side of the other body the point is.
    """
    a, b, c = np.moveaxis(triangles, 1, 0)
    normals = np.cross(b - a, c - a)
    largest = int((normals**2).sum(axis=1).argmax())
    normal = normals[largest] * np.sign(volume)
    size = np.sqrt(np.linalg.norm(normals[largest])) or 1.0
    return np.asarray(triangles[largest].mean(axis=0) - INNER_DISTANCE / size * normal)


def _turns(points: Array, shell: Array) -> Indices:
    """Return the winding numbers of a shell (m, 3, 3) at points (n, 3): 1 or -1 inside, else 0.

    It is the number of triangles that a ray from the point crosses from inside, minus those
    crossed from outside. Adjacent triangles agree exactly on which side of their edge the ray
    passes.
    """
    shell, points = shell @ RAY_ROTATION, points @ RAY_ROTATION
    low, high = shell.min(axis=1), shell.max(axis=1)
    turns = np.zeros(len(points), dtype=np.int64)
    for k, (x, y, _) in enumerate(points):
        ahead = np.flatnonzero((low[:, 0] <= x) & (high[:, 0] >= x))
        ahead = ahead[(low[ahead, 1] <= y) & (high[ahead, 1] >= y)]
        arms = shell[ahead] - points[k]
        u, v = arms[:, :, 0], arms[:, :, 1]
        # Twice the areas of the triangles between the ray and the three edges, seen along the ray.
        areas = np.roll(u, -1, 1) * np.roll(v, -2, 1) - np.roll(u, -2, 1) * np.roll(v, -1, 1)
        sense = np.sign(areas)
        met = (sense == sense[:, :1]).all(axis=1) & (
            (areas * arms[:, :, 2]).sum(axis=1) * sense[:, 0] > 0
        )
        turns[k] = sense[met, 0].sum()
    return turns
