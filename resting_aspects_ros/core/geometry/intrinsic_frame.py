"""The intrinsic frame of a part: principal axes with signs from the third moments."""

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Faces = npt.NDArray[np.int64]

# Third moments below this share of V R^3 count as zero: the noise of float32 is about 1e-7.
MIN_MOMENT = 1e-6

# The four choices of the signs of three axes that are right-handed.
_SIGNS = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], dtype=np.float64)
# Powers of x, y, z in the third moments, in the order of precedence:
# x3 y3 z3 x2y x2z y2x y2z z2x z2y xyz
_POWERS = np.array(
    [
        [3, 0, 0],
        [0, 3, 0],
        [0, 0, 3],
        [2, 1, 0],
        [2, 0, 1],
        [1, 2, 0],
        [0, 2, 1],
        [1, 0, 2],
        [0, 1, 2],
        [1, 1, 1],
    ]
)


def third_moments(vertices: Array, faces: Faces, axes: Array) -> Array:
    """Return the ten third moments of a solid about the origin, along given axes.

    The solid is cut into tetrahedra from the origin. Over one of volume V with corners 0, a, b, c
    the integral of (l1 a + l2 b + l3 c)^3 needs the means of the barycentric monomials,
    3! i! j! k! / 6! for l1^i l2^j l3^k (Stroud, Approximate Calculation of Multiple Integrals).

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
    moments : (10,) float64
        m^6: x3 y3 z3 x2y x2z y2x y2z z2x z2y xyz.
    """
    # By corner, then by axis, so that each coordinate of all triangles is contiguous in memory.
    corners = np.ascontiguousarray(np.moveaxis((vertices @ axes)[faces], 0, 2))
    total = corners.sum(axis=0)
    cross = np.cross(corners[1], corners[2], axis=0)
    weight = np.einsum('ij,ij->j', corners[0], cross) / 6 / 120

    def moment(i: int, j: int, k: int) -> float:
        s = total
        f = s[i] * s[j] * s[k]
        for p in corners:
            f += p[i] * p[j] * (s[k] + 2 * p[k]) + p[k] * (p[i] * s[j] + s[i] * p[j])
        return float(weight @ f)

    return np.array([moment(*np.repeat(np.arange(3), powers).tolist()) for powers in _POWERS])


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
    """Return the signs of the three axes that maximize the third moments.

    Of the four right-handed choices it is the one with the lexicographically largest moments.
    Equal choices are related by a symmetry of the part; the first of them is returned.

    Parameters
    ----------
    moments : (10,) float64
        Third moments along the axes, as shares of V R^3.
    """
    solid = np.where(np.abs(moments) < MIN_MOMENT, 0.0, moments)
    signed = np.prod(_SIGNS[:, None, :] ** _POWERS, axis=2) * solid
    return np.asarray(_SIGNS[max(range(4), key=lambda choice: tuple(signed[choice]))])
