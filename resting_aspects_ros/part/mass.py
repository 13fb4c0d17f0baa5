"""Mass properties of a part: given values, or those of its solid with a uniform density."""

import reprlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
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
    """Return the numbers in a value; None if it contains anything else (text, bool, None)."""
    if isinstance(value, np.ndarray):
        return value.astype(np.float64) if value.dtype.kind in 'iuf' else None
    if isinstance(value, Sequence) and not isinstance(value, str | bytes):
        parts = [_floats(part) for part in value]
        found = [part for part in parts if part is not None]
        if len(found) < len(parts) or len({part.shape for part in found}) > 1:
            return None
        return np.array(found, dtype=np.float64)
    if isinstance(value, bool) or not isinstance(value, int | float | np.number):
        return None
    try:
        return np.array(float(value))
    except OverflowError:
        return np.array(np.inf)


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


@dataclass(frozen=True, eq=False)
class SolidProperties:
    """Volume, m^3, centroid (3,), m, and inertia (3, 3) about it at density 1, m^5."""

    volume: float
    centroid: Array
    inertia: Array


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
        centre = solid.centroid if centre is None else centre
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


def solid_integrals(vertices: Array, faces: Faces) -> SolidProperties:
    """Return the volume integrals of the solid inside a closed, outward surface.

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
    return SolidProperties(float(volume * scale**3), centroid * scale + middle, inertia * scale**5)


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


def _flaw(solid: SolidProperties, vertices: Array, hull_vertices: Array) -> str | None:
    """Return why no solid can have these properties, as if the mesh intersects itself, or None."""
    if not solid.volume > MIN_VOLUME_SHARE * float(np.ptp(vertices, axis=0).max()) ** 3:
        return 'encloses no volume'
    try:
        _check_inside(solid.centroid, hull_vertices, 'the mesh')
        inertia = inertia_matrix(solid.inertia, 'the mesh at density 1')
        arms = hull_vertices - solid.centroid
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
