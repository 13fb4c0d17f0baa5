"""The rotation about the vertical that represents an aspect: the same for any frame of the file.

A part at rest may have any rotation about the vertical. The one that represents an aspect follows
from the moments of the part's surface about its centre of mass, with r = R = 1:

    c(n, k) = integral of (x + i y)^n z^k dA, where z is up

A rotation by the angle a multiplies c(n, k) by exp(i n a). So each moment that does not vanish
defines a up to multiples of 2 pi / n. The first one, c(2, 0) for most parts, puts the principal
axis of the surface on the x axis; further ones select one of the n angles. If all of them are
small, as for a gear or for a disc with a notch, the lowest n up to 24 of c(n, 0) that is not small
defines a, with the maximum distance from the z axis as the unit.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np

from resting_aspects_ros.core.geometry.quadrature import triangle_points
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.rotations import Array, rotate

# Orders n of the moments, in the order in which they are tried for the angle.
_ORDERS = (2, 1, 3, 4, 5, 6)
_HIGHEST = max(_ORDERS)
# Moments below this share of the area define no angle. A tessellation changes them by about 1e-3.
_VANISHING = 0.02
# The same for the orders of the second kind, and their number.
_SMALL, _FINE_ORDERS = 2e-3, 24
# Moments above this share of the area select one of several angles.
_NOISE = 1e-4
# From this number of triangles on, they are so small that their centroids are enough.
_MANY_FACES = 50_000
# With fewer triangles, which can be large, integrals of high order are exact.
_FEW_FACES = 4000


@dataclass(frozen=True, eq=False)
class SurfaceMoments:
    """The moments of the surface of a part about its centre of mass, in the axes of its frame.

    tensors : list of arrays
        Of order 0 to 6. Element (i, j, ...) is the integral of r_i r_j ... dA divided by the area,
        with r in units of R.
    corners : (f, 3, 3) float
        Corners r of the triangles.
    """

    tensors: list[Array]
    corners: Array

    @cached_property
    def fine_points(self) -> tuple[Array, Array]:
        """Points r (3, m) with weights (m,), for integrals of high order."""
        number = _FINE_ORDERS // 2 + 1 if len(self.corners) < _FEW_FACES else _number(self.corners)
        return _surface_points(self.corners, number)


def surface_moments(part: Part) -> SurfaceMoments:
    """Return the moments of the surface of a part."""
    corners = ((part.vertices - part.centre_of_mass) / part.hull_radius)[part.faces]
    points, weight = _surface_points(corners, _number(corners))
    powers = np.ones((_HIGHEST + 1, *points.shape))
    for k in range(_HIGHEST):
        powers[k + 1] = powers[k] * points
    found: dict[tuple[int, ...], float] = {}
    tensors = []
    for order in range(_HIGHEST + 1):
        tensor = np.empty((3,) * order)
        for index in product(range(3), repeat=order):
            a, b, c = (index.count(axis) for axis in range(3))
            if (a, b, c) not in found:
                found[a, b, c] = float((powers[a, 0] * powers[b, 1] * powers[c, 2]) @ weight)
            tensor[index] = found[a, b, c]
        tensors.append(tensor)
    return SurfaceMoments(tensors, corners)


def heading(moments: SurfaceMoments, orientation: Array) -> float:
    """Return by which angle about the vertical to rotate a part, rad; 0 if it looks round.

    Parameters
    ----------
    moments : SurfaceMoments
        See surface_moments.
    orientation : (4,) float
        Unit quaternion xyzw, tray from part.
    """
    axes = rotate(orientation, np.eye(3)).T  # rows: axes of the tray in the part frame
    across, up = axes[0] + 1j * axes[1], axes[2]

    def moment(n: int, k: int) -> complex:
        value = moments.tensors[n + k].astype(np.complex128)
        for axis in (*(across,) * n, *(up,) * k):
            value = value @ axis
        return complex(value)

    pairs = [(n, k) for n in _ORDERS for k in range(_HIGHEST - n + 1)]
    found = [(n, moment(n, k)) for n, k in pairs]
    first = next(((n, c) for n, c in found if abs(c) > _VANISHING), None)
    if first is None:
        points, weights = moments.fine_points
        plane = across @ points
        plane /= np.abs(moments.corners @ across).max()
        fine = ((n, complex(weights @ plane**n)) for n in range(1, _FINE_ORDERS + 1))
        first = next(((n, c) for n, c in fine if abs(c) > _SMALL), None)
    if first is None:
        return 0.0
    n, c = first
    # With n = 4 and more, flats rather than corners are on the x axis.
    target = 0.0 if n < 4 else math.pi
    angles = [(target - float(np.angle(c)) + 2 * math.pi * j) / n for j in range(n)]
    for order, value in found:
        if len(angles) > 1 and abs(value) > _NOISE:
            angles = _selected(angles, order, float(np.angle(value)))
    return angles[0]


def _selected(angles: Sequence[float], n: int, phase: float) -> list[float]:
    """Return the angles at which a moment of order n is closest to the positive real axis.

    Of two that are equally close, it is the one with a positive imaginary part.
    """
    ends = np.exp(1j * (phase + n * np.array(angles)))
    nearest = [a for a, end in zip(angles, ends, strict=True) if end.real > ends.real.max() - 1e-3]
    ends = np.exp(1j * (phase + n * np.array(nearest)))
    return [a for a, end in zip(nearest, ends, strict=True) if end.imag > ends.imag.max() - 1e-3]


def _number(corners: Array) -> int:
    """Return the number of Gauss points in each direction for moments up to order 6."""
    return 4 if len(corners) < _MANY_FACES else 1


def _surface_points(corners: Array, number: int) -> tuple[Array, Array]:
    """Return points (3, m) and weights (m,) for integrals over triangles, divided by the area."""
    sides = corners[:, 1:] - corners[:, :1]
    area = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    barycentric, weights = triangle_points(number)
    points = np.einsum('pc,fcd->dpf', barycentric, corners).reshape(3, -1)
    return points, np.outer(weights, area / area.sum()).ravel()
