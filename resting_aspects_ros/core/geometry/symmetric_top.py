"""The intrinsic frame of a part with two equal principal moments: a symmetric top.

Any two perpendicular axes in the plane of the equal moments are principal axes, so the frame
follows from the complex moments of the solid, with the third axis along z:

    c(n, m, k) = integral of (x + i y)^n z^m (x^2 + y^2)^k dV

Axes that are rotated by -a about z multiply c(n, m, k) by exp(i n a). The first moment that does
not vanish is made real and positive; further ones select one of the n angles. If the z axis is
reversed, c(n, m, k) becomes (-1)^m times its conjugate. Of the two directions of the z axis, the
one with the larger moments is taken. A prism with an n-fold axis and no mirror plane through it,
such as a pinwheel, has no moments with odd m; its two faces differ in the phase between c(n, 0, 0)
and c(n, 0, 1).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.geometry.quadrature import triangle_points

Array = npt.NDArray[np.float64]
Complex = npt.NDArray[np.complex128]
Faces = npt.NDArray[np.int64]

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
