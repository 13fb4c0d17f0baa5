"""A part: a mesh with a unit, mass properties, a convex hull and a frame of its own."""

import hashlib
import re
import struct
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.closed_surface import closed_surface
from resting_aspects_ros.core.errors import InvalidValueError, PartError
from resting_aspects_ros.core.hull import convex_hull, outward_hull
from resting_aspects_ros.core.intrinsic_frame import (
    intrinsic_signs,
    principal_frame,
    third_moments,
)
from resting_aspects_ros.core.mass_properties import Given, mass_properties
from resting_aspects_ros.core.mesh_file import FORMATS, read_triangles
from resting_aspects_ros.core.simplified_hull import simplified
from resting_aspects_ros.core.units import DEFAULT_UNIT, UNITS, check_size, size_warnings

Array = npt.NDArray[np.float64]

__all__ = [
    'DEFAULT_UNIT',
    'MAX_NAME',
    'UNITS',
    'Part',
    'is_valid_name',
    'load_part',
    'part_from_bytes',
    'valid_name',
]

MAX_NAME = 64


@dataclass(frozen=True, eq=False)
class Part:
    """A part as it is dropped: made by load_part or part_from_bytes.

    All in SI units and in the part frame, which is the mesh file's own, not the centre of mass.
    The arrays are read-only.

    Attributes
    ----------
    name : str
    mesh_bytes : bytes
        The mesh file as it is.
    mesh_format : str
        'stl', 'obj' or 'ply'.
    unit : str
        Of the coordinates in ``mesh_bytes``; a key of UNITS.
    mass : float
        kg.
    centre_of_mass : (3,) float64
        m.
    inertia : (3, 3) float64
        kg m^2, about the centre of mass, along the axes of the part frame.
    vertices : (n, 3) float64
        m, welded, in lexicographic order.
    faces : (m, 3) int64
        Outward.
    hull_vertices : (k, 3) float64
        m, in lexicographic order; does not depend on the order in the file. Of more than
        MOST_CORNERS some are left out.
    hull_error : float
        m; corners that were left out are outside the hull by this at most; 0 if none were.
    volume : float
        m^3; nan if the mesh is not a closed solid.
    warnings : tuple of str
        What was mended or is suspicious, one sentence each.
    """

    name: str
    mesh_bytes: bytes = field(repr=False)
    mesh_format: str
    unit: str
    mass: float
    centre_of_mass: Array
    inertia: Array
    vertices: Array = field(repr=False)
    faces: npt.NDArray[np.int64] = field(repr=False)
    hull_vertices: Array = field(repr=False)
    hull_error: float
    volume: float
    warnings: tuple[str, ...]

    def __post_init__(self) -> None:
        for array in (
            self.centre_of_mass,
            self.inertia,
            self.vertices,
            self.faces,
            self.hull_vertices,
        ):
            array.setflags(write=False)

    @cached_property
    def hull_radius(self) -> float:
        """R: the largest distance of a hull vertex from the centre of mass, m."""
        return float(np.linalg.norm(self.hull_vertices - self.centre_of_mass, axis=1).max())

    @cached_property
    def principal_moments(self) -> Array:
        """(3,) float64: the principal moments of inertia, ascending, kg m^2."""
        return principal_frame(self.inertia)[0]

    @cached_property
    def principal_axes(self) -> Array:
        """(3, 3) float64: the intrinsic frame; columns are the principal axes in the part frame.

        In the order of principal_moments, right handed, with the signs that make the third
        moments of the solid (of its hull, if the mesh is not closed) about the centre of mass
        greatest, so that the frame turns with the part. Where two moments are equal, the axes
        between them are arbitrary, but the same for the same bytes.
        """
        axes = principal_frame(self.inertia)[1]
        vertices, faces, volume = self.vertices, self.faces, self.volume
        if np.isnan(volume):
            vertices, faces, volume = outward_hull(self.hull_vertices)
        moments = third_moments((vertices - self.centre_of_mass) / self.hull_radius, faces, axes)
        return axes * intrinsic_signs(moments / (volume / self.hull_radius**3)) + 0.0

    @cached_property
    def mesh_sha256(self) -> str:
        """Hash of the mesh file's bytes, hexadecimal."""
        return hashlib.sha256(self.mesh_bytes).hexdigest()

    @cached_property
    def part_sha256(self) -> str:
        """Hash of what a distribution belongs to, hexadecimal.

        Over the ASCII text ``<mesh_sha256> <unit> `` and ten little-endian doubles: mass, centre
        of mass x y z, inertia xx xy xz yy yz zz.
        """
        numbers = [self.mass, *self.centre_of_mass, *self.inertia[np.triu_indices(3)]]
        text = f'{self.mesh_sha256} {self.unit} '.encode('ascii')
        return hashlib.sha256(text + struct.pack('<10d', *numbers)).hexdigest()


def load_part(
    path: str | Path,
    name: str | None = None,
    *,
    unit: str | None = None,
    density: float | None = None,
    mass: float | None = None,
    centre_of_mass: Any = None,
    inertia: Any = None,
) -> Part:
    """Read a part from an STL, OBJ or PLY file.

    The name defaults to the file's stem, made into a valid name. For the rest see
    part_from_bytes. Raises PartError also for a file that is missing or cannot be read.
    """
    path = Path(path)
    label = f'mesh {str(path)!r}'
    mesh_format = path.suffix.lower().removeprefix('.')
    if path.is_dir():
        raise PartError(f'{label} is a folder: a mesh file is needed')
    if mesh_format not in FORMATS:
        raise PartError(
            f'{label} has the extension {path.suffix!r}: allowed are '
            + ', '.join(f'.{ending}' for ending in FORMATS)
        )
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise PartError(f'{label} does not exist: a mesh file is needed') from None
    except (OSError, ValueError) as error:
        raise PartError(f'{label} cannot be read: {error}') from None
    return _part(
        label,
        data,
        mesh_format,
        valid_name(path.stem) if name is None else name,
        unit,
        Given(density, mass, centre_of_mass, inertia),
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
) -> Part:
    """Make a part from the bytes of a mesh file.

    Without overrides the mass properties are those of the solid inside the mesh, of one density.
    They have no influence on aspects but through the centre of mass and the ratios of the
    moments; so density and mass matter for nothing but the figures that are shown.

    Parameters
    ----------
    data : bytes
    mesh_format : str
        'stl', 'obj' or 'ply'.
    name : str
        [a-z][a-z0-9_]*, at most 64 characters.
    unit : str, optional
        Of the coordinates in the file: a key of UNITS; mm if not given.
    density : float, optional
        kg/m^3; 1000 if neither density nor mass is given.
    mass : float, optional
        kg; scales the solid's inertia.
    centre_of_mass : (3,) array_like, optional
        m, part frame; inside the convex hull. If no inertia is given with it, the inertia about
        the solid's own centroid is taken as the one about this point.
    inertia : (6,) or (3, 3) array_like, optional
        kg m^2 about the centre of mass, part axes; six are ixx ixy ixz iyy iyz izz.

    Raises
    ------
    PartError
        The bytes are no mesh, or enclose no solid. A mesh that is not closed is still usable if
        mass, centre_of_mass and inertia are all given.
    InvalidValueError
        An argument is not allowed.
    """
    return _part(
        f'part {name!r}',
        data,
        mesh_format,
        name,
        unit,
        Given(density, mass, centre_of_mass, inertia),
    )


def valid_name(text: str) -> str:
    """Return the text made into the name of a part."""
    name = re.sub('[^a-z0-9_]+', '_', text.lower())
    return (name if re.match('[a-z]', name) else f'part_{name.lstrip("_")}')[:MAX_NAME]


def is_valid_name(text: str) -> bool:
    """Tell whether the text can be the name of a part."""
    return len(text) <= MAX_NAME and re.fullmatch('[a-z][a-z0-9_]*', text) is not None


def _part(
    label: str, data: bytes, mesh_format: str, name: str, unit: str | None, given: Given
) -> Part:
    if not isinstance(name, str) or not is_valid_name(name):
        raise InvalidValueError(
            f'the name of {label} is {name!r}: allowed are lower case '
            'letters, digits and _, a letter first, at most '
            f'{MAX_NAME} characters'
        )
    unit = DEFAULT_UNIT if unit is None else unit
    if not isinstance(unit, str) or unit not in UNITS:
        raise InvalidValueError(f'the unit of {label} is {unit!r}: allowed are {", ".join(UNITS)}')
    raw_vertices, raw_faces = read_triangles(data, mesh_format, label)
    check_size(raw_vertices, unit, label)
    surface = closed_surface(raw_vertices, raw_faces)
    if not len(surface.faces):
        raise PartError(
            f'{label} has no volume: none of its {len(raw_faces)} triangles has an area'
        )
    vertices = surface.vertices * UNITS[unit]
    corners, triangles, normals = convex_hull(vertices, label)
    hull_vertices, hull_error = simplified(corners, triangles, normals)
    found, defect = mass_properties(
        label, vertices, surface.faces, hull_vertices, surface.defect, given
    )
    warnings = [*surface.warnings, *size_warnings(raw_vertices, unit)]
    if defect:
        warnings.append(f'the mesh {defect}; the given mass properties are used')
    if len(hull_vertices) < len(corners):
        radius = np.linalg.norm(hull_vertices - found.centre_of_mass, axis=1).max()
        warnings.append(
            f'its convex hull was simplified from {len(corners)} to {len(hull_vertices)} corners; '
            f'the others are outside of it by at most {1e3 * hull_error:.2g} mm '
            f'({hull_error / radius:.1g} R)'
        )
    return Part(
        name,
        data,
        mesh_format,
        unit,
        found.mass,
        found.centre_of_mass,
        found.inertia,
        vertices,
        surface.faces,
        hull_vertices,
        hull_error,
        found.volume,
        tuple(f'{label}: {warning}' for warning in warnings),
    )
