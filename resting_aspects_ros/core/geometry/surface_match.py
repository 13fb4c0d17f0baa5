"""Whether a rotation maps the surface of a part onto itself: by surface distance both ways."""

from itertools import pairwise

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from resting_aspects_ros.core.geometry.surface_distance import TriangleTree, cut
from resting_aspects_ros.core.geometry.tessellation import sagittas
from resting_aspects_ros.core.part import Part

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

# How far a point of the surface may be off the surface once it is rotated, R, on top of what the
# tessellation explains: the play of a part that somebody drew as symmetric.
SYMMETRY_TOLERANCE = 2e-3
# Triangles are cut into pieces with edges below this, R, so that samples are spread well and
# boxes are small, up to so many pieces.
PIECE, PIECES = 0.15, 60_000
# Samples: of the corners of the mesh, and of the middles of pieces and the other vertices.
MAX_CORNERS, MAX_OTHERS = 1500, 2500
# Samples that are put first, each as far as can be from those before it.
SPREAD = 200
# Samples looked at before a rotation is rejected: most are after the first few.
STAGES = (5, 25, 125, 625)
# Points at once, to bound the memory.
POINTS = 200_000
# Makes one number of a cell's place, below 2000 either way, and of a normal's direction, 0 to 4.
_CELL_CODE = np.array([4000**2 * 125, 4000 * 125, 125, 25, 5, 1])
# Sides of cells, R: the finest, and how much coarser each step is; the largest step is 3 R.
FINEST, COARSER, LARGEST = 1e-3, 1.4, 24
# How often each sample is turned by some angle to find out whether any will do.
TURNS = 3


class SurfaceMatch:
    """The surface of a part about its centre of mass, in units of R, and samples of it."""

    def __init__(self, part: Part) -> None:
        """Take samples: corners, vertices and points inside the triangles."""
        vertices = (part.vertices - part.centre_of_mass) / part.hull_radius
        faces = part.faces
        skins, corner = sagittas(vertices, faces)
        twice = _normals(vertices[faces])
        solid = np.linalg.norm(twice, axis=1) > 0
        pieces, whole = cut(vertices[faces][solid], PIECE, max(PIECES, 2 * len(faces)))
        whole = np.flatnonzero(solid)[whole]
        self.triangles = vertices[faces][solid]
        self._tree = TriangleTree(pieces, skins[whole])
        twice = _normals(pieces)
        self._normals = twice / np.maximum(np.linalg.norm(twice, axis=1), 1e-300)[:, None]
        at_vertex = np.zeros(len(vertices))
        np.maximum.at(at_vertex, faces.ravel(), np.repeat(skins, 3))
        sharp, other = np.flatnonzero(corner), np.flatnonzero(~corner)
        sharp = sharp[_thinned(vertices[sharp], np.zeros((len(sharp), 3)), MAX_CORNERS)]
        points = np.concatenate([vertices[other], pieces.mean(axis=1)])
        normals = np.concatenate([np.zeros((len(other), 3)), self._normals])
        few = _thinned(points, normals, MAX_OTHERS)
        points = np.concatenate([vertices[sharp], points[few]])
        skins = np.concatenate(
            [at_vertex[sharp], np.concatenate([at_vertex[other], skins[whole]])[few]]
        )
        order = _spread_first(points)
        self._points, self._skins = points[order], skins[order]
        self.order = np.arange(len(points))

    def strays(self, axis: Array | None) -> Flags:
        """Tell which samples leave the surface when it is turned about the axis, a unit vector.

        Each sample is turned by some angles of its own, so that no order of rotation hides between
        them. Without an axis: by some rotations of its own about any axis.
        """
        generator = np.random.default_rng(20)  # any angles do; these are the same every time
        strays = np.zeros(len(self._points), dtype=bool)
        for _ in range(TURNS):
            if axis is None:
                turns = Rotation.from_quat(generator.standard_normal((len(strays), 4)))
            else:
                angles = generator.uniform(0, 2 * np.pi, len(strays))
                turns = Rotation.from_rotvec(angles[:, None] * axis)
            moved = turns.apply(self._points)
            strays |= ~self._tree.near(moved, SYMMETRY_TOLERANCE, self._skins)
        return strays

    def fits(self, rotations: Array, order: Indices, play: float = 0.0) -> Flags:
        """Tell which rotations, (k, 3, 3), map the surface onto itself, both ways.

        ``order`` is that of the samples; the play, R, is on top of SYMMETRY_TOLERANCE.
        """
        left = np.arange(len(rotations))
        bounds = [0, *(s for s in STAGES if s < len(order)), len(order)]
        for start, stop in pairwise(bounds):
            some = order[start:stop]
            block = max(1, POINTS // (2 * len(some)))
            parts = [left[i : i + block] for i in range(0, len(left), block)]
            held = [part[self._hold(rotations[part], some, play)] for part in parts]
            left = np.concatenate(held) if held else left
        fits = np.zeros(len(rotations), dtype=bool)
        fits[left] = True
        return fits

    def polished(self, rotation: Array, order: Indices) -> Array:
        """Return a rotation that nearly fits, turned so that the surface lies on itself best.

        Least squares of the distances to the planes of the nearest triangles (Chen and Medioni
        1992), a few times over with the reach cut down.
        """
        points = self._points[order[: 2 * SPREAD]]
        for reach in (0.04, 0.02, 0.01, 0.01):
            moved = points @ rotation.T
            index, piece, way = self._tree.nearest(moved, reach)
            normals = self._normals[piece]
            lever = np.cross(moved[index], normals)
            off = np.einsum('ij,ij->i', way, normals)
            turn = np.linalg.lstsq(lever, off, rcond=1e-3)[0]
            rotation = Rotation.from_rotvec(turn).as_matrix() @ rotation
        return rotation

    def _hold(self, rotations: Array, some: Indices, play: float) -> Flags:
        there = np.einsum('kij,pj->kpi', rotations, self._points[some])
        back = np.einsum('kji,pj->kpi', rotations, self._points[some])
        points = np.concatenate([there, back], axis=1)
        skins = np.tile(self._skins[some], 2 * len(rotations))
        near = self._tree.near(points.reshape(-1, 3), SYMMETRY_TOLERANCE + play, skins)
        return np.asarray(near.reshape(len(rotations), -1).all(axis=1))


def _normals(triangles: Array) -> Array:
    """Return normals as long as twice the area."""
    a, b, c = np.moveaxis(triangles, 1, 0)
    return np.cross(b - a, c - a)


def _thinned(points: Array, normals: Array, most: int) -> Indices:
    """Choose at most so many points, one of each cell and, in it, of each direction of normal.

    So a pocket in a large face keeps samples of its walls however small it is.
    """

    def chosen(step: int) -> Indices:
        cells = np.floor(points / (FINEST * COARSER**step)).astype(np.int64)
        code = np.column_stack([cells, direction]) @ _CELL_CODE
        return np.sort(np.unique(code, return_index=True)[1])

    direction = (np.round(1.5 * normals) + 2).astype(np.int64)
    if len(points) <= most:
        return np.arange(len(points))
    # The finest cells that are few enough: there are fewer of them the larger they are.
    low, high = -1, LARGEST
    best = chosen(high)
    while high - low > 1:
        step = (low + high) // 2
        found = chosen(step)
        if len(found) <= most:
            high, best = step, found
        else:
            low = step
    return best


def _spread_first(points: Array) -> Indices:
    """Order points so that each of the first ones is far from those before it."""
    apart = np.linalg.norm(points, axis=1)
    first: list[int] = []
    for count in range(min(SPREAD, len(points))):
        first.append(int(apart.argmax()))
        distance = np.linalg.norm(points - points[first[-1]], axis=1)
        apart = np.minimum(apart, distance) if count else distance
    rest = np.setdiff1d(np.arange(len(points)), first)
    # Scattered, so that a stage is a fair sample of them all.
    scattered = np.random.default_rng(21).permutation(rest)
    return np.concatenate([np.array(first, dtype=np.int64), scattered])
