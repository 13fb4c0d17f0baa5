"""The intrinsic frame of a part: principal axes with signs from the higher moments."""

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Faces = npt.NDArray[np.int64]

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
_CHUNK = 4096


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
    for first in range(0, len(faces), _CHUNK):
        total += _surface_integrals(along[faces[first : first + _CHUNK]])
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
