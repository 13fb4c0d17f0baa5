"""A part: a mesh with a unit, mass properties, a convex hull and an intrinsic frame."""

import hashlib
import re
import struct
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.geometry.hull import outward_hull
from resting_aspects_ros.core.geometry.intrinsic_frame import (
    higher_moments,
    intrinsic_signs,
    principal_frame,
)
from resting_aspects_ros.core.geometry.symmetric_top import symmetric_top_axes

Array = npt.NDArray[np.float64]

MAX_NAME = 64


@dataclass(frozen=True, eq=False)
class Part:
    """A part that can be dropped, made by part_loading.load_part or part_from_bytes.

    All values are in SI units and in the part frame, which is the frame of the mesh file; its
    origin is not the centre of mass. The arrays are read-only.

    Attributes
    ----------
    name : str
    mesh_bytes : bytes
        The unchanged content of the mesh file.
    mesh_format : str
        'stl', 'obj', 'ply', 'off', 'glb' or '3mf'.
    unit : str
        Unit of the coordinates in ``mesh_bytes``; a key of UNITS.
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
        m, in lexicographic order, independent of the order in the file. Some are left out if there
        are more than MAX_CORNERS.
    hull_error : float
        m; maximum distance from the hull of the corners that were left out; 0 if none were.
    volume : float
        m^3; nan if the mesh is not a closed solid.
    warnings : tuple of str
        Repairs and suspicious properties of the mesh, one sentence each.
    body : int
        Number of the body of the mesh that the part is, from 1, largest first; 0 if the mesh is
        a single body.
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
    body: int = 0

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
        """R, the maximum distance of a hull vertex from the centre of mass, m."""
        return float(np.linalg.norm(self.hull_vertices - self.centre_of_mass, axis=1).max())

    @cached_property
    def principal_moments(self) -> Array:
        """(3,) float64: the principal moments of inertia, ascending, kg m^2."""
        return principal_frame(self.inertia)[0]

    @cached_property
    def principal_axes(self) -> Array:
        """(3, 3) float64: the intrinsic frame; columns are the principal axes in the part frame.

        The axes are in the order of principal_moments and right-handed. Their signs maximize the
        third moments of the solid about the centre of mass (of its hull, if the mesh is not
        closed), and then its fourth moments, so that the frame rotates with the part. If two
        moments are equal, the axes in their plane follow from higher moments too; see
        `symmetric_top`. If all three are equal, the axes are arbitrary, but identical for
        identical bytes.
        """
        principal, axes = principal_frame(self.inertia)
        vertices, faces, volume = self.vertices, self.faces, self.volume
        if np.isnan(volume):
            vertices, faces, volume = outward_hull(self.hull_vertices)
        radius = self.hull_radius
        vertices, volume = (vertices - self.centre_of_mass) / radius, volume / radius**3
        found = symmetric_top_axes(vertices, faces, volume, principal, axes)
        if found is None:
            moments = higher_moments(vertices, faces, axes)
            found = axes * intrinsic_signs(moments / volume)
        return found + 0.0

    @cached_property
    def mesh_sha256(self) -> str:
        """Hash of the mesh file's bytes, hexadecimal."""
        return hashlib.sha256(self.mesh_bytes).hexdigest()

    @cached_property
    def part_sha256(self) -> str:
        """Hash of everything that determines a distribution, hexadecimal.

        It is the hash of the ASCII text ``<mesh_sha256> <unit> `` and ten little-endian doubles:
        mass, centre of mass x y z, inertia xx xy xz yy yz zz. If one of several bodies was chosen,
        the text continues with ``body <number> ``.
        """
        numbers = [self.mass, *self.centre_of_mass, *self.inertia[np.triu_indices(3)]]
        body = f'body {self.body} ' if self.body else ''
        text = f'{self.mesh_sha256} {self.unit} {body}'.encode('ascii')
        return hashlib.sha256(text + struct.pack('<10d', *numbers)).hexdigest()


def valid_name(text: str) -> str:
    """Return the text converted to a valid name of a part."""
    name = re.sub('[^a-z0-9_]+', '_', text.lower())
    return (name if re.match('[a-z]', name) else f'part_{name.lstrip("_")}')[:MAX_NAME]


def is_valid_name(text: str) -> bool:
    """Return whether the text is a valid name of a part."""
    return len(text) <= MAX_NAME and re.fullmatch('[a-z][a-z0-9_]*', text) is not None
