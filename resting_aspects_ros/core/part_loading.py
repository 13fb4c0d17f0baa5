"""Make a part from a mesh file: read, weld, unite its bodies, compute hull and mass."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from resting_aspects_ros.core.errors import InvalidValueError, PartError, shown
from resting_aspects_ros.core.geometry.bodies import unite_bodies
from resting_aspects_ros.core.geometry.closed_surface import Surface, closed_surface
from resting_aspects_ros.core.geometry.hull import convex_hull
from resting_aspects_ros.core.geometry.mass_properties import GivenMassValues, mass_properties
from resting_aspects_ros.core.geometry.mesh_file import FORMATS, read_triangles
from resting_aspects_ros.core.geometry.simplified_hull import simplify_hull
from resting_aspects_ros.core.geometry.step_file import STEP_FORMATS, stl_from_step
from resting_aspects_ros.core.input_file import named, read_input
from resting_aspects_ros.core.part import MAX_NAME, Part, is_valid_name, valid_name
from resting_aspects_ros.core.units import (
    DEFAULT_UNIT,
    UNITS,
    check_size,
    coarse_text,
    size_warnings,
)

MAX_BYTES = 256 << 20  # maximum mesh file size; MAX_TRIANGLES need less in any format
# File formats of CAD programs. They contain curved surfaces, which must be exported as triangles.
CAD_FORMATS = (
    *('stpz', 'iges', 'igs', 'sldprt', 'sldasm', 'ipt', 'iam', 'prt', 'asm'),
    *('catpart', 'catproduct', 'cgr', 'x_t', 'x_b', 'xmt_txt', 'sat', 'sab', 'jt', 'par', 'psm'),
    *('3dm', 'fcstd', 'f3d', 'brep', 'brp', 'dwg', 'dxf', 'skp', 'neu', 'model', 'session'),
)


def load_part(
    path: str | Path,
    name: str | None = None,
    *,
    unit: str | None = None,
    density: float | None = None,
    mass: float | None = None,
    centre_of_mass: Any = None,
    inertia: Any = None,
    body: int | None = None,
) -> Part:
    """Read a part from an STL, OBJ, PLY or STEP file; a STEP file is converted to an STL in mm.

    The default name is the stem of the file, converted to a valid name. For the other parameters
    see part_from_bytes. PartError is also raised if the file is missing, is not a regular file, is
    larger than MAX_BYTES, or cannot be read.
    """
    path = Path(path)
    label = named('mesh', path)
    mesh_format = path.suffix.lower().removeprefix('.')
    if mesh_format not in (*FORMATS, *STEP_FORMATS) and not path.is_dir():
        raise PartError(f'{label} has {_wrong_format(path.suffix)}')
    data = read_input(path, MAX_BYTES, 'mesh', PartError)
    if mesh_format in STEP_FORMATS:
        if unit not in (None, 'mm'):
            raise InvalidValueError(
                f'invalid unit {shown(unit)} of {label}: expected none, because a STEP file has '
                'its own, which is converted to mm'
            )
        data, mesh_format, unit = stl_from_step(data, label), 'stl', 'mm'
    return _part(
        label,
        data,
        mesh_format,
        valid_name(path.stem) if name is None else name,
        unit,
        body,
        GivenMassValues(density, mass, centre_of_mass, inertia),
    )


def part_from_bytes(
    data: bytes,
    mesh_format: str,
    name: str,
    *,
    unit: str | None = None,
    density: float | None = None,
    mass: float | None = None,
    centre_of_mass: Any = None,
    inertia: Any = None,
    body: int | None = None,
) -> Part:
    """Make a part from the bytes of a mesh file.

    By default the mass properties are those of the solid inside the mesh, with a uniform density.
    They influence the aspects only through the centre of mass and the ratios of the principal
    moments, so the density and the mass only change the values that are reported.

    Parameters
    ----------
    data : bytes
    mesh_format : str
        'stl', 'obj' or 'ply'.
    name : str
        [a-z][a-z0-9_]*, at most 64 characters.
    unit : str, optional
        Unit of the coordinates in the file, a key of UNITS; the default is mm.
    density : float, optional
        kg/m^3; the default is 1000 if neither density nor mass is given.
    mass : float, optional
        kg; the inertia of the solid is scaled to it.
    centre_of_mass : (3,) array_like, optional
        m, part frame; inside the convex hull. Without a given inertia, the inertia about the
        centroid of the solid is used as the inertia about this point.
    inertia : (6,) or (3, 3) array_like, optional
        kg m^2 about the centre of mass, part axes; six numbers are ixx ixy ixz iyy iyz izz.
    body : int, optional
        Number of the body of the mesh, from 1, largest first; required if the mesh has several
        bodies that do not touch each other.

    Raises
    ------
    PartError
        If the bytes are not a mesh, or the mesh does not enclose a solid. An open mesh can be used
        if mass, centre_of_mass and inertia are all given.
    InvalidValueError
        If an argument is invalid.
    """
    return _part(
        f'part {shown(name)}',
        data,
        mesh_format,
        name,
        unit,
        body,
        GivenMassValues(density, mass, centre_of_mass, inertia),
    )


def _wrong_format(suffix: str) -> str:
    expected = ', '.join(f'.{ending}' for ending in (*FORMATS, *STEP_FORMATS))
    text = f'the extension {shown(suffix)}: expected one of {expected}'
    if suffix.lower().removeprefix('.') in CAD_FORMATS:
        return f'{text}. It is a CAD file: export an STL from your CAD program'
    return text


def _part(
    label: str,
    data: bytes,
    mesh_format: str,
    name: str,
    unit: str | None,
    chosen_body: int | None,
    given: GivenMassValues,
) -> Part:
    if not isinstance(name, str) or not is_valid_name(name):
        raise InvalidValueError(
            f'invalid name {shown(name)} of {label}: expected lower case letters, digits and _, '
            f'a letter first, at most {MAX_NAME} characters'
        )
    if unit is not None and (not isinstance(unit, str) or unit not in UNITS):
        raise InvalidValueError(
            f'invalid unit {shown(unit)} of {label}: expected one of {", ".join(UNITS)}'
        )
    vertices, faces = read_triangles(data, mesh_format, label)
    check_size(vertices, unit or DEFAULT_UNIT, label)
    try:
        surface, body = unite_bodies(
            closed_surface(vertices, faces), chosen_body, unit or DEFAULT_UNIT, label
        )
        part = _solid_part(label, surface, unit, body, given, (name, data, mesh_format))
    except PartError as error:
        coarse = coarse_text(vertices, faces, unit or DEFAULT_UNIT)
        raise PartError(f'{error}; {coarse}' if coarse else str(error)) from None
    if coarse := coarse_text(surface.vertices, surface.faces, unit or DEFAULT_UNIT):
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
