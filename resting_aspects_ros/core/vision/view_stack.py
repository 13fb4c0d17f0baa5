"""Fits of several outlines of a part that rolls to a seen one, all at once.

A fit of a single outline spends most of its time on calls with few points. The boundaries of all
outlines are in one tree here, beside each other at a large distance, so that one query finds the
nearest points on different outlines.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from resting_aspects_ros.core.rotations import Array
from resting_aspects_ros.core.vision.alignment import normal_equations, turned
from resting_aspects_ros.core.vision.boundary import nearest_on_pieces, turn
from resting_aspects_ros.core.vision.fitting import EVERY, Fit, Shape

Indices = npt.NDArray[np.int64]


class ViewStack:
    """The boundaries and samples of several shapes.

    Parameters
    ----------
    shapes : sequence of Shape
    """

    def __init__(self, shapes: Sequence[Shape]) -> None:
        boundaries = [shape.boundary for shape in shapes]
        first = np.cumsum([0, *(len(each.points) for each in boundaries)])
        self._points = np.concatenate([each.points for each in boundaries])
        self._along = np.concatenate([each.along for each in boundaries])
        self._squares = np.concatenate([each.squares for each in boundaries])
        self._normals = np.concatenate([each.normals for each in boundaries])
        self._sides = np.concatenate(
            [each.sides + k for each, k in zip(boundaries, first[:-1], strict=True)], axis=1
        )
        self._scale = np.array([each.radius for each in boundaries])
        self._centres = np.array([each.centre for each in boundaries])
        self._samples = [shape.samples for shape in shapes]
        # Points to be aligned are closer to their shape than to the next one.
        self._step = np.array([[10 * float(self._scale.max()), 0.0]])
        owner = np.repeat(np.arange(len(shapes)), np.diff(first))
        self._tree = cKDTree(self._points + owner[:, None] * self._step)

    def refined(self, which: Indices, seen: Shape, yaws: Array, iterations: int) -> list[Fit]:
        """Return the fit of each of the shapes ``which`` (j,) near a yaw (j,), rad.

        It is that of `fitting.refined` with a single yaw.
        """
        shifts = np.zeros((len(yaws), 2))
        some, scale = seen.samples[::EVERY], self._scale[which]
        for step in range(iterations + 1):
            points = turned(some[None] - shifts[:, None], -yaws)
            way, piece = self._nearest(which, points)
            square, right = normal_equations(points, way, self._normals[piece], scale)
            if step < iterations:
                moved = np.asarray(np.linalg.solve(square, right[..., None]), np.float64)[..., 0]
                shifts = shifts - turned(moved[:, None, 1:], yaws)[:, 0]
                yaws = yaws - moved[:, 0] / scale
        stiffness = scale**2 / np.linalg.inv(square)[:, 0, 0]
        there, _ = self._nearest(which, turned(seen.samples[None] - shifts[:, None], -yaws))
        backs = self._backs(which, seen, yaws, shifts)
        found = []
        for k, back in enumerate(backs):
            one = (there[k] ** 2).sum(axis=1)
            x, y = seen.boundary.centre + shifts[k] - turn(yaws[k]) @ self._centres[which[k]]
            found.append(
                Fit(
                    float(np.angle(np.exp(1j * yaws[k]))),
                    float(x),
                    float(y),
                    float((one.mean() + back.mean()) / 2),
                    float(np.sqrt(max(one.max(), back.max()))),
                    float(stiffness[k]),
                )
            )
        return found

    def _nearest(self, which: Indices, points: Array) -> tuple[Array, Indices]:
        """Return the ways (j, m, 2) from points (j, m, 2) to shapes, and the pieces (j, m)."""
        flat = points.reshape(-1, 2)
        owner = np.repeat(which, points.shape[1])
        near = self._tree.query(flat + owner[:, None] * self._step)[1]
        way, piece = nearest_on_pieces(
            flat, self._sides[:, near], self._points, self._along, self._squares
        )
        return way.reshape(points.shape), piece.reshape(points.shape[:2])

    def _backs(self, which: Indices, seen: Shape, yaws: Array, shifts: Array) -> list[Array]:
        """Return the squared distances of the samples of each shape from the seen boundary."""
        samples = [self._samples[k] for k in which]
        ends = np.cumsum([0, *map(len, samples)])
        owner = np.repeat(np.arange(len(which)), np.diff(ends))
        x, y = np.concatenate(samples).T
        c, s = np.cos(yaws)[owner], np.sin(yaws)[owner]
        moved = np.stack([c * x - s * y, s * x + c * y], axis=1) + shifts[owner]
        square = (seen.boundary.nearest(moved)[0] ** 2).sum(axis=1)
        return [square[a:b] for a, b in pairwise(ends)]
