"""Which way the bodies of a mesh face: outward in the open, inward where they are cavities.

A shell is a closed piece of a surface. A mesh may have many: bodies side by side, cavities, and
bodies in cavities.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

# Shells around one shell, by their boxes. No part has as many, and each costs time.
DEEPEST = 100

# How far behind a triangle is the point that stands for the inside of its shell, as a share of
# the triangle's size: more than the noise of float32, less than any wall.
BEHIND = 1e-3


@dataclass(frozen=True, eq=False)
class Facing:
    """Which triangles face the wrong way, (m,), and what there is to say about it."""

    inward: Flags
    warnings: list[str]
    defect: str | None = None


def facing(corners: Array, shell: Indices, mended: Flags) -> Facing:
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
    low = np.array([t.min(axis=(0, 1)) for t in triangles])
    high = np.array([t.max(axis=(0, 1)) for t in triangles])
    flip = np.zeros(len(volumes), dtype=bool)
    doubled = bodies = 0
    # A shell comes after all that can be around it, which are larger.
    largest_first = np.argsort(-np.abs(volumes), kind='stable')
    rank = np.argsort(largest_first)
    for s in largest_first.tolist():
        boxed = (low <= low[s]).all(axis=1) & (high >= high[s]).all(axis=1) & (rank < rank[s])
        if np.count_nonzero(boxed) > DEEPEST:
            return Facing(flip[shell], [], f'has more than {DEEPEST} bodies inside each other')
        point = _inner_point(triangles[s], volumes[s])
        turns = {o: _turns(point, triangles[o]) for o in np.flatnonzero(boxed).tolist()}
        depth = sum(-turn if flip[o] else turn for o, turn in turns.items())
        if depth <= 0:
            bodies += 1
            flip[s] = volumes[s] < 0
        elif volumes[s] > 0:
            flip[s] = doubtful[s] or any(turn and flip[o] for o, turn in turns.items())
            doubled += not flip[s]
    return Facing(flip[shell], _warnings(flip & ~doubtful, doubled, bodies))


def _warnings(flipped: Flags, doubled: int, bodies: int) -> list[str]:
    found = []
    if bodies > 1:
        found.append(f'the mesh is of {bodies} bodies, which are taken as one rigid part')
    if flipped.all():
        found.append('the mesh was inside out and was turned')
    elif flipped.any():
        found.append(
            f'{np.count_nonzero(flipped)} of {len(flipped)} bodies in the mesh were inside out '
            'and were turned'
        )
    if doubled:
        found.append(
            f'bodies that lie inside another one, both facing outward, count twice: {doubled}; a '
            'cavity must face inward'
        )
    return found


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


def _turns(point: Array, shell: Array) -> int:
    """Return how often a shell, (m, 3, 3), winds round a point: 1 or -1 inside of it, else 0.

    The sum of the solid angles of its triangles (Van Oosterom and Strackee 1983).
    """
    a, b, c = np.moveaxis(shell - point, 1, 0)
    la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
    up = np.einsum('ij,ij->i', a, np.cross(b, c))
    ab, bc, ca = (np.einsum('ij,ij->i', u, v) for u, v in ((a, b), (b, c), (c, a)))
    half_angles = np.arctan2(up, la * lb * lc + ab * lc + bc * la + ca * lb)
    return round(float(half_angles.sum() / (2 * np.pi)))
