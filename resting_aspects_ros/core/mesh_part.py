"""Make a part from triangles: weld them, unite their bodies, compute hull and mass."""

from dataclasses import replace

import numpy as np

from resting_aspects_ros.core.errors import PartError
from resting_aspects_ros.core.geometry.bodies import unite_bodies
from resting_aspects_ros.core.geometry.closed_surface import Surface, closed_surface
from resting_aspects_ros.core.geometry.hull import convex_hull
from resting_aspects_ros.core.geometry.mass_properties import GivenMassValues, mass_properties
from resting_aspects_ros.core.geometry.mesh_file import Triangles
from resting_aspects_ros.core.geometry.simplified_hull import simplify_hull
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.units import (
    DEFAULT_UNIT,
    REFUSED_VOLUME_CHANGE,
    UNITS,
    check_size,
    coarseness,
    size_warnings,
)


def mesh_part(
    label: str,
    mesh: Triangles,
    unit: str | None,
    chosen: int | str | None,
    given: GivenMassValues,
    file: tuple[str, bytes, str],
) -> Part:
    """Return the part that is a body of a mesh; raises PartError or InvalidValueError.

    Parameters
    ----------
    label : str
        Name of the file in errors.
    mesh : Triangles
    unit : str, optional
        Unit of the mesh; None if it was not given.
    chosen : int, optional
        See unite_bodies.
    given : GivenMassValues
    file : tuple
        Name of the part, bytes of the file and its format.
    """
    vertices, faces, steps = mesh
    in_unit = unit or DEFAULT_UNIT
    check_size(vertices, in_unit, label)
    try:
        surface, body = unite_bodies(closed_surface(vertices, faces), chosen, in_unit, label)
        part = _solid_part(label, surface, unit, body, given, file)
    except PartError as error:
        _, coarse = coarseness(vertices, faces, in_unit, steps)
        raise type(error)(f'{error}; {coarse}' if coarse else str(error)) from None
    change, coarse = coarseness(surface.vertices, surface.faces, in_unit, steps)
    if change >= REFUSED_VOLUME_CHANGE:
        raise PartError(f'{label} cannot be used: {coarse}')
    if coarse:
        part = replace(part, warnings=(*part.warnings, f'{label}: {coarse}'))
    return part


def _solid_part(
    label: str,
    surface: Surface,
    unit: str | None,
    body: int,
    given: GivenMassValues,
    file: tuple[str, bytes, str],
) -> Part:
    if not len(surface.faces):
        raise PartError(f'{label} has no volume: all its triangles have zero area')
    warnings = [
        *surface.warnings,
        *size_warnings(surface.vertices, unit or DEFAULT_UNIT, given=unit is not None),
    ]
    vertices = surface.vertices * UNITS[unit or DEFAULT_UNIT]
    corners, triangles, normals = convex_hull(vertices, label)
    hull_vertices, hull_error = simplify_hull(corners, triangles, normals)
    found, defect = mass_properties(
        label, vertices, surface.faces, hull_vertices, surface.defect, given
    )
    if defect:
        warnings.append(f'the mesh {defect}; the given mass properties are used')
    if len(hull_vertices) < len(corners):
        radius = np.linalg.norm(hull_vertices - found.centre_of_mass, axis=1).max()
        warnings.append(
            f'its convex hull was simplified from {len(corners)} to {len(hull_vertices)} corners; '
            f'the omitted corners are outside the hull by at most {1e3 * hull_error:.2g} mm '
            f'({hull_error / radius:.1g} R)'
        )
    return Part(
        *file,
        unit or DEFAULT_UNIT,
        found.mass,
        found.centre_of_mass,
        found.inertia,
        vertices,
        surface.faces,
        hull_vertices,
        hull_error,
        found.volume,
        tuple(f'{label}: {warning}' for warning in warnings),
        body,
    )
