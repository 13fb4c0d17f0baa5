"""Mass properties of a part, given or of its solid, and the frame that they determine."""

import math
import reprlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial import ConvexHull

from resting_aspects_ros.arrays import Array, Faces
from resting_aspects_ros.errors import InvalidValueError, PartError

# -- Given values ---------------------------------------------------------------------------------


# Given inertias are often rounded to three digits; deviations that rounding explains are accepted.
ROUNDING = 1e-3
# No physical value is larger, and products of such numbers do not overflow.
LARGEST = 1e30


def positive_number(value: Any, name: str, unit: str, label: str) -> float:
    """Return the value as a number above 0, or raise InvalidValueError."""
    found = _floats(value)
    if found is None or found.shape != () or not 1 / LARGEST <= found <= LARGEST:
        raise InvalidValueError(
            f'invalid {name} {reprlib.repr(value)} of {label}: expected a finite number above 0 '
            f'({1 / LARGEST:.0e} to {LARGEST:.0e} {unit})'
        )
    return float(found)


def point(value: Any, name: str, label: str) -> Array:
    """Return the value as a (3,) array of finite numbers, or raise InvalidValueError."""
    found = _floats(value)
    if found is None or found.shape != (3,) or not (np.abs(found) <= LARGEST).all():
        raise InvalidValueError(
            f'invalid {name} {reprlib.repr(value)} of {label}: expected three finite numbers, m'
        )
    return found


def inertia_matrix(value: Any, label: str) -> Array:
    """Return the value as an inertia matrix, (3, 3), after checking that a solid can have it.

    Parameters
    ----------
    value : (6,) or (3, 3) array_like
        kg m^2; six numbers are ixx ixy ixz iyy iyz izz, with products of inertia as in the matrix
        (negative integrals of x y, as in URDF and ROS).

    Raises
    ------
    InvalidValueError
        If the value has another shape or is not finite, not symmetric or not positive definite,
        or if one principal moment is larger than the sum of the other two.
    """
    found = _floats(value)
    if found is not None and found.shape == (6,):
        found = found[[[0, 1, 2], [1, 3, 4], [2, 4, 5]]]
    if found is None or found.shape != (3, 3) or not (np.abs(found) <= LARGEST).all():
        raise InvalidValueError(
            f'invalid inertia {reprlib.repr(value)} of {label}: expected six finite numbers '
            '(ixx ixy ixz iyy iyz izz, kg m^2) or a 3 x 3 matrix'
        )
    if np.abs(found - found.T).max() > ROUNDING * np.abs(found).max():
        raise InvalidValueError(
            f'invalid inertia {found.tolist()} of {label}: expected a symmetric matrix'
        )
    found = np.asarray((found + found.T) / 2)
    moments = np.linalg.eigvalsh(found / (np.abs(found).max() or 1.0))
    if not moments[0] > 1e-14 * moments[2]:
        raise InvalidValueError(
            f'invalid inertia {found.tolist()} of {label}: expected principal moments above 0, '
            f'their ratios are {_ratios(moments)}'
        )
    if moments[2] > (moments[0] + moments[1]) * (1 + ROUNDING):
        raise InvalidValueError(
            f'invalid inertia {found.tolist()} of {label}: expected no principal moment above the '
            f'sum of the other two, their ratios are {_ratios(moments)}'
        )
    return found


def _ratios(moments: Array) -> str:
    largest = np.abs(moments).max() or 1.0
    return ' : '.join(f'{moment / largest:.4g}' for moment in moments)


def _floats(value: Any) -> Array | None:
    """Return the numbers in a value; None if it is anything else (text, bool, None)."""
    try:
        found = np.asarray(value)
    except ValueError:  # rows of different lengths
        return None
    return found.astype(np.float64) if found.dtype.kind in 'iuf' else None


# -- Mass properties ------------------------------------------------------------------------------


DEFAULT_DENSITY = 1000.0  # kg/m^3; the mass has no influence on aspects

# A closed surface with less volume than this share of its bounding cube is a sheet folded onto
# itself. A foil of 10 um in a box of 1 m has more.
MIN_VOLUME_SHARE = 1e-9

# Minimum trace of the inertia, as a share of its maximum. A smaller trace would concentrate the
# mass within 1e-6 R of one point, which is below the detail of a mesh.
MIN_TRACE_SHARE = 1e-13


@dataclass(frozen=True, eq=False)
class GivenMassValues:
    """Unchecked mass properties from the caller, SI units, part frame; None if not given."""

    density: Any = None
    mass: Any = None
    centre_of_mass: Any = None
    inertia: Any = None


@dataclass(frozen=True, eq=False)
class MassProperties:
    """Mass properties of a part, SI units; inertia about the centre of mass, part axes."""

    mass: float
    centre_of_mass: Array
    inertia: Array
    volume: float  # nan if the mesh encloses no solid


def mass_properties(
    label: str,
    vertices: Array,
    faces: Faces,
    hull_vertices: Array,
    defect: str | None,
    given: GivenMassValues,
) -> tuple[MassProperties, str | None]:
    """Return the mass properties of a part, and why its mesh is not a solid; None if it is one.

    Raises
    ------
    InvalidValueError
        If a given value is invalid.
    PartError
        If the mesh does not enclose a solid and mass, centre_of_mass and inertia are not all
        given.
    """
    if given.density is not None and given.mass is not None:
        raise InvalidValueError(
            f'{label} has both a density ({given.density!r}) and a mass '
            f'({given.mass!r}): expected only one of them'
        )
    density = (
        None
        if given.density is None
        else positive_number(given.density, 'density', 'kg/m^3', label)
    )
    mass = None if given.mass is None else positive_number(given.mass, 'mass', 'kg', label)
    centre = (
        None
        if given.centre_of_mass is None
        else point(given.centre_of_mass, 'centre of mass', label)
    )
    inertia = None if given.inertia is None else inertia_matrix(given.inertia, label)

    solid = None if defect else solid_integrals(vertices, faces)
    if solid:
        defect = _flaw(solid, vertices, hull_vertices)
        solid = None if defect else solid
    if solid:
        mass = (density or DEFAULT_DENSITY) * solid.volume if mass is None else mass
        centre = solid.centre_of_mass if centre is None else centre
        inertia = solid.inertia * (mass / solid.volume) if inertia is None else inertia
    if mass is None or centre is None or inertia is None:
        raise PartError(
            f'{label} {defect}; either repair the mesh, or give mass, centre_of_mass '
            'and inertia in the YAML file beside it'
        )
    if given.centre_of_mass is not None:
        _check_inside(centre, hull_vertices, label)
    if given.inertia is not None:
        _check_possible(inertia, mass, hull_vertices - centre, label)
    volume = solid.volume if solid else float('nan')
    # Adding 0 turns -0 into 0; the two would have different hashes.
    return MassProperties(float(mass), centre + 0.0, inertia + 0.0, volume), defect


def solid_integrals(vertices: Array, faces: Faces) -> MassProperties:
    """Return the mass properties of the solid inside a closed, outward surface, at density 1.

    The mesh is first moved to the middle of its box and scaled to about 1 (by a power of two,
    which is exact), so that no digits are lost for a tiny part or one far from the origin.

    Parameters
    ----------
    vertices : (n, 3) float64
        m, part frame.
    faces : (m, 3) int64
    """
    middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    scale = 2.0 ** np.ceil(np.log2(np.ptp(vertices, axis=0).max()))
    with np.errstate(all='ignore'):
        volume, x, y, z, xx, yy, zz, xy, yz, zx = _integrals(((vertices - middle) / scale)[faces])
        cx, cy, cz = centroid = np.array([x, y, z]) / volume
        inertia = np.empty((3, 3))
        inertia[0, 0] = yy + zz - volume * (cy**2 + cz**2)
        inertia[1, 1] = xx + zz - volume * (cx**2 + cz**2)
        inertia[2, 2] = xx + yy - volume * (cx**2 + cy**2)
        inertia[0, 1] = inertia[1, 0] = -(xy - volume * (cx * cy))
        inertia[1, 2] = inertia[2, 1] = -(yz - volume * (cy * cz))
        inertia[0, 2] = inertia[2, 0] = -(zx - volume * (cx * cz))
    volume = float(volume * scale**3)
    return MassProperties(volume, centroid * scale + middle, inertia * scale**5, volume)


def _integrals(triangles: Array) -> Array:
    """Return the integrals (10,) of 1, x, y, z, xx, yy, zz, xy, yz, zx over the solid inside.

    The method is that of Eberly, Polyhedral Mass Properties (2002), in the order of operations of
    trimesh. trimesh itself is not used because its import takes longer than all other imports of
    the core.
    """
    a, b, c = np.moveaxis(triangles, 1, 0)
    normals = np.cross(b - a, c - b)
    f1 = a + b + c
    f2 = a**2 + b**2 + a * b + c * f1
    f3 = a**3 + a**2 * b + a * b**2 + b**3 + c * f2
    g = [f2 + (corner + f1) * corner for corner in (a, b, c)]
    products = np.zeros((10, len(triangles)))
    products[0] = normals[:, 0] * f1[:, 0]
    products[1:4] = (normals * f2).T
    products[4:7] = (normals * f3).T
    for i in range(3):
        k = (i + 1) % 3
        products[7 + i] = normals[:, i] * (
            a[:, k] * g[0][:, i] + b[:, k] * g[1][:, i] + c[:, k] * g[2][:, i]
        )
    return np.asarray(products.sum(axis=1) / [6, 24, 24, 24, 60, 60, 60, 120, 120, 120])


def _flaw(solid: MassProperties, vertices: Array, hull_vertices: Array) -> str | None:
    """Return why no solid can have these properties, as if the mesh intersects itself, or None."""
    if not solid.volume > MIN_VOLUME_SHARE * float(np.ptp(vertices, axis=0).max()) ** 3:
        return 'encloses no volume'
    try:
        _check_inside(solid.centre_of_mass, hull_vertices, 'the mesh')
        inertia = inertia_matrix(solid.inertia, 'the mesh at density 1')
        arms = hull_vertices - solid.centre_of_mass
        _check_possible(inertia, solid.volume, arms, 'the mesh at density 1')
    except InvalidValueError as error:
        return f'intersects itself, so that its mass properties are impossible ({error})'
    return None


def _check_inside(centre: Array, hull_vertices: Array, label: str) -> None:
    middle, size = hull_vertices.mean(axis=0), np.ptp(hull_vertices, axis=0).max()
    planes = ConvexHull((hull_vertices - middle) / size).equations
    if (planes[:, :3] @ (centre - middle) / size + planes[:, 3]).max() > 1e-9:
        low, high = hull_vertices.min(axis=0), hull_vertices.max(axis=0)
        raise InvalidValueError(
            f'invalid centre of mass {centre.tolist()} m of {label}: expected a point inside the '
            f'convex hull, whose box is {low.tolist()} to {high.tolist()} m'
        )


def _check_possible(inertia: Array, mass: float, arms: Array, label: str) -> None:
    """Raise InvalidValueError if the trace of the inertia is impossible, as with a wrong unit.

    The trace is twice the mass times the mean r^2, and no mass is further away than R.
    """
    max_trace = 2 * mass * (arms**2).sum(axis=1).max()
    min_trace = MIN_TRACE_SHARE * max_trace
    if not min_trace <= np.trace(inertia) <= max_trace * (1 + ROUNDING):
        raise InvalidValueError(
            f'invalid inertia {inertia.tolist()} kg m^2 of {label}: expected a trace of '
            f'{min_trace:.4g} to {max_trace:.4g} for {mass:.4g} kg in this hull, but it is '
            f'{np.trace(inertia):.4g}; is it in kg m^2?'
        )


# -- Higher moments -------------------------------------------------------------------------------


# Number of points of triangles at a time, to limit the memory.
_CHUNK = 20_000
# From this number of triangles on, they are so small that their centroids are enough.
_MANY_FACES = 50_000


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


def gauss_number(faces: int, degree: int) -> int:
    """Return the ``number`` of triangle_points for polynomials over a surface of triangles.

    The centroids are enough for many triangles, which are small.
    """
    return degree // 2 + 1 if faces < _MANY_FACES else 1


def surface_points(corners: Array, number: int) -> tuple[Array, Array, Array]:
    """Return points (3, p f), weights (p,) and twice the areas (f,) of triangles (f, 3, 3).

    The weights of the points in an integral are the outer product of weights and areas. For
    ``number`` see triangle_points.
    """
    barycentric, weights = triangle_points(number)
    a, b, c = np.moveaxis(corners, 1, 0)
    points = np.einsum('pc,fcd->dpf', barycentric, corners).reshape(3, -1)
    return points, weights, np.linalg.norm(np.cross(b - a, c - a), axis=1)


def _solid_points(vertices: Array, faces: Faces, number: int) -> Iterator[tuple[Array, Array]]:
    """Yield points (3, m) of a surface with weights (m,), for moments of the solid inside.

    By the divergence theorem the integral of a homogeneous polynomial f of degree n over the solid
    is that of f (x . normal) / (n + 3) over its surface, which is the sum of the weighted values
    of f / (n + 3). For ``number`` see triangle_points.
    """
    barycentric, weights = triangle_points(number)
    step = max(1, _CHUNK // len(weights))
    for first in range(0, len(faces), step):
        corners = vertices[faces[first : first + step]]
        # The area of each triangle, multiplied by the distance of its plane from the origin.
        cone = np.einsum('ij,ij->i', corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 2
        points = np.einsum('pc,fcd->dfp', barycentric, corners).reshape(3, -1)
        yield points, np.outer(cone, weights).ravel()


def powers_up_to(values: Array, most: int) -> Array:
    """Return the powers 0 to ``most`` of values (n,), (most + 1, n)."""
    found = np.ones((most + 1, len(values)))
    for k in range(most):
        found[k + 1] = found[k] * values
    return found


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
ROUNDED_ANGLE = 1e-9

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
    angle = chosen.angle if abs(chosen.angle) > ROUNDED_ANGLE else 0.0
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
    """Return the integrals of (x + i y)^n z^m (x^2 + y^2)^k over a solid, for powers (n, m, k)."""
    degrees = np.array([n + m + 2 * k for n, m, k in powers])
    number = gauss_number(len(faces), int(degrees.max()))
    orders, row = np.unique([n for n, _, _ in powers], return_inverse=True)
    others = sorted({(m, k) for _, m, k in powers})
    column = [others.index((m, k)) for _, m, k in powers]
    total = np.zeros((len(orders), len(others)), dtype=np.complex128)
    for (x, y, z), share in _solid_points(along, faces, number):
        heights = powers_up_to(z, max(m for m, _ in others))
        squares = powers_up_to(x**2 + y**2, max(k for _, k in others)) * share
        factors = np.array([heights[m] * squares[k] for m, k in others])
        plane = np.empty((len(orders), len(x)), dtype=np.complex128)
        plane[0] = (x + 1j * y) ** orders[0]
        for k, rise in enumerate(np.diff(orders), start=1):
            plane[k] = plane[k - 1] * (x + 1j * y) ** rise
        total += plane @ factors.T
    return np.asarray(total[row, column] / (degrees + 3))


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


def higher_moments(vertices: Array, faces: Faces, axes: Array) -> Array:
    """Return the moments of a solid that can depend on the signs of the axes.

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
    total = np.zeros(len(POWERS))
    for points, share in _solid_points(vertices @ axes, faces, 3):
        x, y, z = (powers_up_to(each, 3) for each in points)
        total += np.array([x[i] * y[j] * z[k] for i, j, k in POWERS.tolist()]) @ share
    return np.asarray(total / (POWERS.sum(axis=1) + 3))


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
