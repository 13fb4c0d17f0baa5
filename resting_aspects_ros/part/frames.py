"""The intrinsic frame of a part: principal axes with signs from the higher moments."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.arrays import Array, Faces


def triangle_points(number: int) -> tuple[Array, Array]:
    """Return barycentric points (p, 3) and weights (p,) for integrals over a triangle.

    They are products of ``number`` Gauss points on each side of a square that is mapped to the
    triangle, exact for polynomials of degree 2 number - 2. The weights add up to 1; with number 1
    the point is the centroid.
    """
    if number == 1:
        return np.full((1, 3), 1 / 3), np.ones(1)
    nodes, weights = np.polynomial.legendre.leggauss(number)
    nodes, weights = (nodes + 1) / 2, weights / 2
    u, v = (grid.ravel() for grid in np.meshgrid(nodes, nodes))
    across = v * (1 - u)
    share = np.outer(weights, weights).ravel() * (1 - u)
    return np.stack([1 - u - across, u, across], axis=1), share / share.sum()


# -- Two equal principal moments ------------------------------------------------------------------


Complex = npt.NDArray[np.complex128]

# Moments that differ by less than this share of the largest are equal: the noise of float32 in
# the inertia, 1e-7, would turn their axes by 1e-3.
EQUAL_MOMENTS = 1e-4
# Maximum degree n + m + 2 k of the moments, and maximum n of those that are tried if all others
# vanish, such as for a ratchet wheel.
DEGREE, MAX_ORDER = 8, 24
# Moments below this share of V R^degree define no direction, and differences below the second one
# are noise of float32.
DEFINING, NOISE = 1e-3, 3e-6
# A smaller angle, rad, is rounding: the axes stay as they are, bit for bit.
ROUNDING = 1e-9
# From this number of triangles on, they are so small that their centroids are enough.
_MANY_FACES = 50_000
# Number of points of triangles at a time, to limit the memory.
_CHUNK = 20_000

Powers = tuple[int, int, int]


def symmetric_top_axes(
    vertices: Array, faces: Faces, volume: float, moments: Array, axes: Array
) -> Array | None:
    """Return the intrinsic frame of a symmetric top, or None if the part is none.

    Of frames that a symmetry of the part maps onto each other, the nearest to ``axes`` is
    returned.

    Parameters
    ----------
    vertices : (n, 3) float
        Relative to the centre of mass, in units of R.
    faces : (m, 3) int
        Outward.
    volume : float
        In units of R^3.
    moments : (3,) float
        Principal moments, ascending.
    axes : (3, 3) float
        Columns: principal axes, right-handed.

    Returns
    -------
    axes : (3, 3) float or None
        Columns: in the order of the moments, right-handed.
    """
    equal = np.diff(moments) < EQUAL_MOMENTS * moments[2]
    if equal.sum() != 1:
        return None
    order = [0, 1, 2] if equal[0] else [1, 2, 0]  # the two equal ones first
    along = vertices @ axes[:, order]
    powers = _low_powers()
    values = _moments(along, faces, powers) / volume
    if not any(n and abs(c) > DEFINING for (n, _, _), c in zip(powers, values, strict=True)):
        more = _high_powers()
        values = np.concatenate([values, _moments(along, faces, more) / volume])
        powers = [*powers, *more]
    up, down = (_turned(_Values(powers, each)) for each in (values, _reversed(powers, values)))
    chosen, turn = up, np.eye(3)
    if down.exceeds(up):
        chosen, turn = down, np.diag([1.0, -1.0, -1.0])
    angle = chosen.angle if abs(chosen.angle) > ROUNDING else 0.0
    c, s = math.cos(angle), math.sin(angle)
    frame = axes[:, order] @ turn @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    found = np.empty((3, 3))
    found[:, order] = frame
    return found


@dataclass(frozen=True, eq=False)
class _Values:
    """Complex moments in a frame, after its rotation by minus an angle about z.

    defining : (n, c)
        Order and absolute value of the moment that defines the angle; (0, 0.0) if there is none.
    """

    powers: Sequence[Powers]
    values: Complex
    angle: float = 0.0
    defining: tuple[int, float] = (0, 0.0)

    def noise(self, k: int) -> float:
        """Return the error of a moment; that of the angle contributes to it."""
        n, size = self.defining
        turned = self.powers[k][0] * abs(self.values[k]) / (n * size) if n else 0.0
        return NOISE * (1 + turned)

    def exceeds(self, other: '_Values') -> bool:
        """Return whether the first moment that differs is larger than that of the other."""
        for k, (one, another) in enumerate(zip(self.values, other.values, strict=True)):
            off = one - another
            limit = 2 * max(self.noise(k), other.noise(k))
            for part in (off.real, off.imag):
                if abs(part) > limit:
                    return bool(part > 0)
        return False


def _turned(given: _Values) -> _Values:
    """Return the values after the rotation that makes the defining one real and positive."""
    orders = np.array([n for n, _, _ in given.powers])
    sizes = np.where(orders > 0, np.abs(given.values), 0.0)
    large = np.flatnonzero(sizes > DEFINING)
    first = int(large[0]) if len(large) else int(sizes.argmax())
    if sizes[first] < 10 * NOISE:
        return given
    n = int(orders[first])
    angles = (2 * math.pi * np.arange(n) - np.angle(given.values[first])) / n
    for k, order in enumerate(orders):
        if len(angles) == 1:
            break
        ends = given.values[k] * np.exp(1j * order * angles)
        limit = 2 * _Values(given.powers, given.values, 0.0, (n, float(sizes[first]))).noise(k)
        angles = angles[ends.real > ends.real.max() - limit]
        ends = given.values[k] * np.exp(1j * order * angles)
        angles = angles[ends.imag > ends.imag.max() - limit]
    # The others are equivalent.
    near = np.angle(np.exp(1j * angles))
    angle = float(near[np.abs(near).argmin()])
    values = given.values * np.exp(1j * orders * angle)
    return _Values(given.powers, values, angle, (n, float(sizes[first])))


def _reversed(powers: Sequence[Powers], values: Complex) -> Complex:
    """Return the moments after a half turn about the x axis."""
    signs = np.array([(-1.0) ** m for _, m, _ in powers])
    return np.asarray(values.conj() * signs)


def _low_powers() -> list[Powers]:
    """Return the powers of all moments that a direction or the reversal can depend on."""
    found = [
        (n, m, k)
        for n in range(DEGREE + 1)
        for m in range(DEGREE + 1 - n)
        for k in range((DEGREE - n - m) // 2 + 1)
        if n or m % 2
    ]
    return sorted(found, key=lambda row: (sum(row) + row[2], row))


def _high_powers() -> list[Powers]:
    return [
        (n, m, k) for n in range(DEGREE - 1, MAX_ORDER + 1) for m, k in ((0, 0), (0, 1), (1, 0))
    ]


def _moments(along: Array, faces: Faces, powers: Sequence[Powers]) -> Complex:
    """Return moments of a solid; see `intrinsic_frame.higher_moments` for the surface integral."""
    degrees = np.array([n + m + 2 * k for n, m, k in powers])
    number = int(degrees.max()) // 2 + 1 if len(faces) < _MANY_FACES else 1
    barycentric, weights = triangle_points(number)
    orders, row = np.unique([n for n, _, _ in powers], return_inverse=True)
    others = sorted({(m, k) for _, m, k in powers})
    column = [others.index((m, k)) for _, m, k in powers]
    total = np.zeros((len(orders), len(others)), dtype=np.complex128)
    step = max(1, _CHUNK // len(weights))
    for first in range(0, len(faces), step):
        corners = along[faces[first : first + step]]
        # The area of each triangle, multiplied by the distance of its plane from the origin.
        cone = np.einsum('ij,ij->i', corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 2
        x, y, z = np.einsum('pc,fcd->dfp', barycentric, corners).reshape(3, -1)
        share = np.outer(cone, weights).ravel()
        heights = _powers(z, max(m for m, _ in others))
        squares = _powers(x**2 + y**2, max(k for _, k in others)) * share
        factors = np.array([heights[m] * squares[k] for m, k in others])
        plane = np.empty((len(orders), len(x)), dtype=np.complex128)
        plane[0] = (x + 1j * y) ** orders[0]
        for k, rise in enumerate(np.diff(orders), start=1):
            plane[k] = plane[k - 1] * (x + 1j * y) ** rise
        total += plane @ factors.T
    return np.asarray(total[row, column] / (degrees + 3))


def _powers(values: Array, most: int) -> Array:
    """Return the powers 0 to ``most`` of values (n,), (most + 1, n)."""
    found = np.ones((most + 1, len(values)))
    for k in range(most):
        found[k + 1] = found[k] * values
    return found


# -- The frame ------------------------------------------------------------------------------------


# Moments below this share of V R^n count as zero: the noise of float32 is about 1e-7.
MIN_MOMENT = 1e-6

# The four choices of the signs of three axes that are right-handed.
_SIGNS = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], dtype=np.float64)
# Powers of x, y, z in the moments, in the order of precedence. Third moments are zero if the part
# has a centre of symmetry. Of the fourth moments, these depend on the signs of the axes.
POWERS = np.array(
    [
        *([3, 0, 0], [0, 3, 0], [0, 0, 3]),
        *([2, 1, 0], [2, 0, 1], [1, 2, 0], [0, 2, 1], [1, 0, 2], [0, 1, 2], [1, 1, 1]),
        *([3, 1, 0], [1, 3, 0], [3, 0, 1], [1, 0, 3], [0, 3, 1], [0, 1, 3]),
        *([2, 1, 1], [1, 2, 1], [1, 1, 2]),
    ]
)
# A rule that integrates polynomials of degree 4 over a triangle: barycentric coordinates and
# weights (Dunavant, International Journal for Numerical Methods in Engineering 21, 1985).
_NEAR, _FAR = 0.445948490915965, 0.091576213509771
_POINTS = np.array([np.roll([1 - 2 * a, a, a], k) for a in (_NEAR, _FAR) for k in range(3)])
_WEIGHTS = np.repeat([0.223381589678011, 0.109951743655322], 3)

# Number of triangles at a time, whose arrays fit into the cache of a processor.
_MOMENT_CHUNK = 4096


def higher_moments(vertices: Array, faces: Faces, axes: Array) -> Array:
    """Return the moments of a solid that can depend on the signs of the axes.

    By the divergence theorem the integral of a homogeneous polynomial f of degree n over the solid
    is that of f (x . normal) / (n + 3) over its surface.

    Parameters
    ----------
    vertices : (n, 3) float64
        m, relative to the reference point of the moments.
    faces : (m, 3) int64
        Outward.
    axes : (3, 3) float64
        Columns: unit vectors.

    Returns
    -------
    moments : (19,) float64
        Integrals of x^i y^j z^k with the rows i, j, k of POWERS, m^6 and m^7.
    """
    along = vertices @ axes
    total = np.zeros(len(POWERS))
    for first in range(0, len(faces), _MOMENT_CHUNK):
        total += _surface_integrals(along[faces[first : first + _MOMENT_CHUNK]])
    return np.asarray(total / (POWERS.sum(axis=1) + 3))


def _surface_integrals(triangles: Array) -> Array:
    """Return the integrals of x^i y^j z^k (x . normal) over triangles, (m, 3, 3)."""
    # By corner, then by axis, so that each coordinate of all triangles is contiguous in memory.
    corners = np.ascontiguousarray(np.moveaxis(triangles, 0, 2))
    # The area of each triangle, multiplied by the distance of its plane from the origin.
    cone = np.einsum('ij,ij->j', corners[0], np.cross(corners[1], corners[2], axis=0)) / 2
    total = np.zeros((4, 4, 4))
    for weights, share in zip(_POINTS, _WEIGHTS, strict=True):
        points = np.tensordot(weights, corners, axes=1)
        square = points * points
        powers = np.stack([np.ones_like(points), points, square, square * points])
        x, y, z = np.moveaxis(powers, 1, 0)
        products = (y[:, None] * z[None]).reshape(16, -1)
        total += share * ((cone * x) @ products.T).reshape(4, 4, 4)
    return np.asarray(total[tuple(POWERS.T)])


def principal_frame(inertia: Array) -> tuple[Array, Array]:
    """Return the principal moments, ascending, and a right-handed set of axes (columns).

    The signs are arbitrary but fixed: the largest component of the first two axes is positive.
    """
    moments, axes = np.linalg.eigh(inertia / np.trace(inertia))
    largest = np.abs(axes).argmax(axis=0)
    axes = axes * np.sign(axes[largest, np.arange(3)])
    axes[:, 2] = np.cross(axes[:, 0], axes[:, 1])
    return moments * np.trace(inertia), axes


def intrinsic_signs(moments: Array) -> Array:
    """Return the signs of the three axes that maximize the moments.

    Of the four right-handed choices it is the one with the lexicographically largest moments.
    Equal choices are related by a symmetry of the part; the first of them is returned.

    Parameters
    ----------
    moments : (19,) float64
        Moments along the axes, with the powers of POWERS, as shares of V R^n.
    """
    solid = np.where(np.abs(moments) < MIN_MOMENT, 0.0, moments)
    signed = np.prod(_SIGNS[:, None, :] ** POWERS, axis=2) * solid
    return np.asarray(_SIGNS[max(range(4), key=lambda choice: tuple(signed[choice]))])
