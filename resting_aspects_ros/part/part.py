"""A part: a mesh with a unit, mass properties, a convex hull and an intrinsic frame."""

import hashlib
import re
import struct
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.arrays import Array
from resting_aspects_ros.errors import PartError
from resting_aspects_ros.part.hull import outward_hull
from resting_aspects_ros.part.mass import (
    higher_moments,
    intrinsic_signs,
    principal_frame,
    symmetric_top_axes,
)

# -- Units ----------------------------------------------------------------------------------------


# Metres in one unit of a mesh's coordinates.
UNITS: dict[str, float] = {
    'um': 1e-6,
    'mm': 1e-3,
    'cm': 1e-2,
    'm': 1.0,
    'in': 0.0254,
    'ft': 0.3048,
}
if TYPE_CHECKING:
    Unit: TypeAlias = str
else:
    Unit = Literal[tuple(UNITS)]  # of a field in a file
UNIT_NAMES = {
    'um': 'micrometres',
    'mm': 'millimetres',
    'cm': 'centimetres',
    'm': 'metres',
    'in': 'inches',
    'ft': 'feet',
}
DEFAULT_UNIT = 'mm'  # of STL, OBJ, PLY and OFF files; most parts are designed in mm

# Ranges of the longest side, m. Outside POSSIBLE_SIZE the unit is probably wrong, even if it was
# given; outside USUAL_SIZE it may be wrong if it is only the default. LIKELY_SIZE is the range of
# parts in feeders; only units that bring a part into it are suggested.
POSSIBLE_SIZE = (1e-4, 2.0)
USUAL_SIZE = (3e-3, 2.0)
LIKELY_SIZE = (5e-3, 0.3)
# Change of the volume by rounding in the file, as a share, up to which there is no warning.
MAX_VOLUME_CHANGE = 1e-4
# Change from which the aspects cannot be right: the steps are as large as the part is thick.
REFUSED_VOLUME_CHANGE = 0.5
MAX_SIZE = 1e6  # m, any coordinate: far above any part, far below overflow in the integrals
MIN_SIZE = 1e-9  # m
MAX_LISTED = 5  # bodies in a sentence


def check_size(vertices: Array, unit: str, label: str) -> None:
    """Raise PartError if the coordinates (n, 3), in the unit, are too large or too small."""
    with np.errstate(over='ignore'):
        reach = float(np.abs(vertices).max()) * UNITS[unit]
        size = float(np.ptp(vertices, axis=0).max()) * UNITS[unit]
    if reach > MAX_SIZE:
        raise PartError(
            f'{label} has a coordinate of {reach:.3g} m: expected at most {MAX_SIZE:.0e} m'
        )
    if size < MIN_SIZE:
        raise PartError(
            f'{label} has no volume: its longest side is {size:.3g} m, expected at least '
            f'{MIN_SIZE:.0e} m'
        )


def box_text(sides: Array, unit: str) -> str:
    """Return the sides of a box (3,), given in the unit, as text in mm: '40 x 30 x 20 mm'."""
    lengths = 1e3 * UNITS[unit] * sides
    return ' x '.join(f'{x:.4g}' if x < 1e4 else f'{x:.0f}' for x in lengths.tolist()) + ' mm'


def listed(texts: Sequence[str]) -> str:
    """Return the first texts of a list with commas."""
    return ', '.join(texts[:MAX_LISTED]) + (', ...' if len(texts) > MAX_LISTED else '')


def size_warnings(vertices: Array, unit: str, *, given: bool) -> list[str]:
    """Return a warning if the size suggests another unit, with the size in each likely unit.

    given : whether the unit was given, or is the default.
    """
    sides = np.ptp(vertices, axis=0)
    size = float(sides.max())
    low, high = POSSIBLE_SIZE if given else USUAL_SIZE
    if low <= size * UNITS[unit] <= high:
        return []
    likely = [
        f'in {text} it would be {box_text(sides, other)}'
        for other, text in UNIT_NAMES.items()
        if other != unit and LIKELY_SIZE[0] <= size * UNITS[other] <= LIKELY_SIZE[1]
    ]
    sizes = '; '.join([f'the part is {box_text(sides, unit)} with the unit {unit}', *likely])
    return [f'{sizes}. Is the unit correct?']


def coarseness(
    vertices: Array, faces: npt.NDArray[np.int64], unit: str, steps: Array
) -> tuple[float, str]:
    """Return the relative error of the volume by coarse coordinates, and a warning; 0, '' if fine.

    The effect of the steps on the volume is estimated by moving each side of the part by half a
    step.

    Parameters
    ----------
    vertices : (n, 3) float64
        In the unit.
    faces : (m, 3) int64
    steps : (3,) float64
        Steps in which the file stores the coordinates of each axis, in the unit. STL and many
        other files store float32, whose steps grow with the distance from the origin.
    """
    sides = np.ptp(vertices, axis=0)
    middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    a, b, c = np.moveaxis((vertices - middle)[faces], 1, 0)
    areas = np.cross(b - a, c - a) / 2
    volume = abs(float(np.einsum('ij,ij->', a, areas))) / 3
    change = float(np.abs(areas).sum(axis=0) @ steps) / 2
    # A surface without volume is not coarse, unless its sides are.
    fine = change <= MAX_VOLUME_CHANGE * volume
    if fine or (volume <= change and steps.max() < MAX_VOLUME_CHANGE * sides.max()):
        return 0.0, ''
    millimetres = 1e3 * UNITS[unit]
    share = f'{100 * change / volume:.2g} %' if change < volume else '100 % or more'
    text = (
        f'its coordinates of up to {np.abs(vertices).max() * millimetres:.4g} mm are stored in '
        f'steps of {steps.max() * millimetres:.2g} mm, which is coarse for a part of '
        f'{box_text(sides, unit)}: its volume may be wrong by {share}, and it may have aspects '
        'that it should not have. Move the part to the origin before it is exported, or export '
        'it with more digits'
    )
    return change / max(volume, change), text


# -- Parts ----------------------------------------------------------------------------------------


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
    bodies : tuple of str
        Number, name if there is one, and size of each body of the file, the largest first; empty
        if there is only one.
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
    bodies: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        names = 'centre_of_mass', 'inertia', 'vertices', 'faces', 'hull_vertices'
        for name in names:
            getattr(self, name).setflags(write=False)

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
