"""Load a part from a mesh file, or make it from the bytes of one: weld, unite bodies, compute."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.arrays import Array, Indices
from resting_aspects_ros.errors import InvalidValueError, PartError, one_line, shown
from resting_aspects_ros.input_files import named, read_input
from resting_aspects_ros.part.hull import convex_hull, simplify_hull
from resting_aspects_ros.part.mass import GivenMassValues, mass_properties, solid_integrals
from resting_aspects_ros.part.mesh_files import (
    MESH_FORMATS,
    SCENE_FORMATS,
    STEP_FORMATS,
    Triangles,
    read_triangles,
    without_unused,
)
from resting_aspects_ros.part.part import (
    DEFAULT_UNIT,
    MAX_NAME,
    REFUSED_VOLUME_CHANGE,
    UNITS,
    Part,
    box_text,
    check_size,
    coarseness,
    is_valid_name,
    listed,
    size_warnings,
    valid_name,
)
from resting_aspects_ros.part.surface import Surface, closed_surface, triangle_edges

if TYPE_CHECKING:
    from resting_aspects_ros.part.scene_files import Scene

# -- Bodies ---------------------------------------------------------------------------------------


# Bodies touch if the gap is at most this share of the size of the mesh. It is the noise of float32
# far from the origin, and less than any intended gap.
TOUCH = 1e-5
# Maximum relative change of the volume by the union of bodies that touch but do not overlap.
SAME_VOLUME = 1e-6
# A shell with less volume, as a share of the cube of its size, is a sheet folded onto itself.
MIN_VOLUME_SHARE = 1e-9
MAX_BODIES = 10_000
MAX_NEAR_PAIRS = 2_000  # bodies whose boxes touch are compared triangle by triangle
# How a user of the command line chooses a body, after 'choose one'.
CHOOSE = ' with --body, or with "body" in the YAML file beside the mesh'


class SeparateBodiesError(PartError):
    """A file has several bodies that do not all touch each other, and none is chosen.

    Parameters
    ----------
    what : str
        The file, the number of its bodies, and how they lie.
    bodies : tuple of str
        See Part.
    """

    def __init__(self, what: str, bodies: tuple[str, ...] = ()) -> None:
        # Without bodies, ``what`` is the whole text: a process passes the error on by it.
        super().__init__(f'{what} ({listed(bodies)}): choose one{CHOOSE}' if bodies else what)
        self.bodies = bodies


@dataclass(frozen=True, eq=False)
class _Body:
    """A shell that faces outward, with its cavities; lengths are relative to the mesh size."""

    number: int
    corners: Array  # (m, 3, 3) of its triangles

    @cached_property
    def volume(self) -> float:
        return float(np.linalg.det(self.corners).sum() / 6)

    @cached_property
    def low(self) -> Array:
        return np.asarray(self.corners.min(axis=(0, 1)))

    @cached_property
    def high(self) -> Array:
        return np.asarray(self.corners.max(axis=(0, 1)))

    @cached_property
    def solid(self) -> Any:
        """The body as an object of manifold3d."""
        import manifold3d

        points, faces = np.unique(self.corners.reshape(-1, 3), axis=0, return_inverse=True)
        faces = faces.reshape(-1, 3).astype(np.uint64)
        return manifold3d.Manifold(manifold3d.Mesh64(points, faces))


def unite_bodies(
    surface: Surface, chosen: int | str | None, unit: str, label: str
) -> tuple[Surface, int, tuple[str, ...]]:
    """Return the surface of one solid, the number of the chosen body or 0, and all bodies.

    Bodies that touch count as one body; they are united if they overlap. Bodies are numbered from
    1, the largest first.

    Parameters
    ----------
    surface : Surface
        Returned unchanged if it has a defect.
    chosen : int, optional
        Number of the body; required if there are bodies that do not touch each other.
    unit : str
        Unit of the coordinates, for errors.

    Raises
    ------
    SeparateBodiesError
        If there are several bodies that do not touch each other, and none is chosen.
    PartError
        If bodies cannot be united, or if there are too many.
    InvalidValueError
        If there is no body with the chosen number.
    """
    if surface.defect:
        if chosen is not None:
            raise PartError(f'{label} {surface.defect}: no body of it can be chosen')
        return surface, 0, ()
    middle = (surface.vertices.min(axis=0) + surface.vertices.max(axis=0)) / 2
    # A power of two, so that scaling is exact.
    size = 2.0 ** np.ceil(np.log2(np.ptp(surface.vertices, axis=0).max()))
    corners = ((surface.vertices - middle) / size)[surface.faces]
    bodies = _solids(corners, surface.body)
    groups = _groups(bodies, label) if len(bodies) > 1 else [bodies]
    if chosen is not None and (type(chosen) is not int or not 1 <= chosen <= len(groups)):
        raise InvalidValueError(
            f'invalid body {shown(chosen)} of {label}: expected 1 to {len(groups)}'
        )
    texts = _texts(groups, size, unit) if len(groups) > 1 else ()
    if texts and chosen is None:
        what = f'{label} has {len(groups)} bodies that do not touch each other'
        raise SeparateBodiesError(what, texts)
    group = groups[(chosen or 1) - 1]
    if group:
        surface = _cut(surface, np.isin(surface.body, [body.number for body in group]))
    if len(group) > 1:
        surface = _united(surface, group, middle, size, label)
    return surface, chosen if texts and chosen is not None else 0, texts


def _solids(corners: Array, number: Indices) -> list[_Body]:
    """Return the bodies, without sheets, which have no volume."""
    order = np.argsort(number, kind='stable')
    starts = np.r_[0, np.flatnonzero(np.diff(number[order])) + 1]
    found = [_Body(int(number[rows[0]]), corners[rows]) for rows in np.split(order, starts[1:])]
    return [
        body
        for body in found
        if body.volume > MIN_VOLUME_SHARE * (body.high - body.low).max() ** 3
    ]


def _cut(surface: Surface, kept: npt.NDArray[np.bool_]) -> Surface:
    """Return the surface of a subset of the triangles."""
    if kept.all():
        return surface
    vertices, faces = without_unused(surface.vertices, surface.faces[kept])
    return Surface(vertices, faces, None, surface.warnings, surface.body[kept])


def _texts(groups: list[list[_Body]], size: float, unit: str) -> tuple[str, ...]:
    """Return number and size of each group of bodies."""
    sides = (np.ptp([(each.low, each.high) for each in group], axis=(0, 1)) for group in groups)
    return tuple(f'{k}: {box_text(size * each, unit)}' for k, each in enumerate(sides, 1))


def _groups(bodies: list[_Body], label: str) -> list[list[_Body]]:
    """Return groups of bodies that are connected by contact, the largest group first."""
    if len(bodies) > MAX_BODIES:
        raise PartError(f'{label} has {len(bodies)} bodies: expected at most {MAX_BODIES}')
    near = list(_near(bodies))
    if len(near) > MAX_NEAR_PAIRS:
        raise PartError(
            f'{label} has {len(bodies)} bodies, of which {len(near)} pairs may touch: expected at '
            f'most {MAX_NEAR_PAIRS}; unite them in the CAD program'
        )
    if near:
        try:
            import manifold3d  # noqa: F401
        except ImportError:
            raise PartError(
                f'{label} has several bodies that may overlap: uniting them needs '
                'manifold3d, which is not installed (pip install manifold3d)'
            ) from None
    piece = np.arange(len(bodies))
    for one, other in near:
        if piece[one] != piece[other]:
            gap = bodies[one].solid.min_gap(bodies[other].solid, 2 * TOUCH)
            if gap <= TOUCH:
                piece[piece == piece[other]] = piece[one]
    groups = [[bodies[k] for k in np.flatnonzero(piece == p)] for p in np.unique(piece)]
    volumes = [sum(body.volume for body in group) for group in groups]
    largest = max(volumes)
    places = [np.min([body.low for body in group], axis=0).round(6).tolist() for group in groups]
    order = [(-round(v / largest, 6), place) for v, place in zip(volumes, places, strict=True)]
    return [groups[k] for k in sorted(range(len(groups)), key=order.__getitem__)]


def _near(bodies: list[_Body]) -> Iterator[tuple[int, int]]:
    """Yield the pairs of bodies whose bounding boxes touch."""
    low = np.array([body.low for body in bodies]) - TOUCH
    high = np.array([body.high for body in bodies]) + TOUCH
    order = np.argsort(low[:, 0], kind='stable')
    low, high = low[order], high[order]
    ends = np.searchsorted(low[:, 0], high[:, 0], side='right')
    for k, end in enumerate(ends.tolist()):
        rest = slice(k + 1, end)
        meets = ((low[rest] <= high[k]) & (high[rest] >= low[k])).all(axis=1)
        yield from ((int(order[k]), int(order[k + 1 + m])) for m in np.flatnonzero(meets))


def _united(
    surface: Surface, group: list[_Body], middle: Array, size: float, label: str
) -> Surface:
    """Return the union of bodies that touch; the unchanged surface if they do not overlap."""
    import manifold3d

    volume = sum(body.volume for body in group)
    union = manifold3d.Manifold.batch_boolean(
        [body.solid for body in group], manifold3d.OpType.Add
    )
    change = union.volume() / volume - 1
    if union.status() == manifold3d.Error.NoError and abs(change) <= SAME_VOLUME:
        if not triangle_edges(surface.faces).components().any():
            return surface
        warning = (
            f'the mesh has {len(group)} bodies that touch each other and are treated as one part'
        )
        return replace(surface, warnings=(*surface.warnings, warning))
    largest = max(body.volume for body in group)
    mesh = union.to_mesh64()
    points = np.asarray(mesh.vert_properties, dtype=np.float64)[:, :3] * size + middle
    found = None
    if largest / volume - 1 - SAME_VOLUME <= change <= 0:
        found = closed_surface(points, np.asarray(mesh.tri_verts).astype(np.int64))
        off = solid_integrals(found.vertices, found.faces).volume / (union.volume() * size**3) - 1
    if found is None or found.defect or abs(off) > SAME_VOLUME:
        raise PartError(
            f'{label} has {len(group)} bodies that overlap and cannot be united '
            f'({union.status().name}): unite them in the CAD program'
        )
    warning = (
        f'the mesh has {len(group)} bodies that overlap; they were united, which changed the '
        f'volume by {100 * change:.2g} %. A body inside another one is a cavity only if it faces '
        'inward'
    )
    return replace(found, warnings=(*surface.warnings, warning))


# -- From triangles -------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _File:
    """A mesh file with the values that the caller gave; ``label`` names it in errors."""

    label: str
    data: bytes
    mesh_format: str
    name: str
    body: int | str | None
    given: GivenMassValues


def _mesh_part(file: _File, mesh: Triangles, unit: str | None, chosen: int | str | None) -> Part:
    """Return the part that is a body of a mesh; see unite_bodies. The unit is None by default."""
    label = file.label
    vertices, faces, steps = mesh
    in_unit = unit or DEFAULT_UNIT
    check_size(vertices, in_unit, label)
    try:
        surface, body, bodies = unite_bodies(
            closed_surface(vertices, faces), chosen, in_unit, label
        )
        part = _solid_part(file, surface, unit)
    except PartError as error:
        _, coarse = coarseness(vertices, faces, in_unit, steps)
        if coarse:
            error.args = (f'{error}; {coarse}',)
        raise
    change, coarse = coarseness(surface.vertices, surface.faces, in_unit, steps)
    if change >= REFUSED_VOLUME_CHANGE:
        raise PartError(f'{label} cannot be used: {coarse}')
    if coarse:
        part = replace(part, warnings=(*part.warnings, f'{label}: {coarse}'))
    return replace(part, body=body, bodies=bodies)


def _solid_part(file: _File, surface: Surface, unit: str | None) -> Part:
    label = file.label
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
        label, vertices, surface.faces, hull_vertices, surface.defect, file.given
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
        file.name,
        file.data,
        file.mesh_format,
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
    )


# -- From files -----------------------------------------------------------------------------------


# Formats of a part, and those of the files from which a part can be loaded.
FORMATS = (*MESH_FORMATS, *SCENE_FORMATS)
FILE_FORMATS = (*FORMATS, *STEP_FORMATS)
MAX_BYTES = 256 << 20  # maximum mesh file size; MAX_TRIANGLES need less in any format


def load_part(
    path: str | Path,
    name: str | None = None,
    *,
    unit: str | None = None,
    density: float | None = None,
    mass: float | None = None,
    centre_of_mass: Any = None,
    inertia: Any = None,
    body: int | str | None = None,
) -> Part:
    """Read a part from a file in one of FILE_FORMATS; a STEP file is converted to a GLB.

    The default name is the stem of the file, converted to a valid name. For the other parameters
    see part_from_bytes. PartError is also raised if the file is missing, is not a regular file, is
    larger than MAX_BYTES, or cannot be read.
    """
    path = Path(path)
    label = named('mesh', path)
    mesh_format = path.suffix.lower().removeprefix('.')
    if mesh_format not in FILE_FORMATS and not path.is_dir():
        raise PartError(
            f'{label} has the extension {shown(path.suffix)}: expected one of '
            f'{", ".join(f".{ending}" for ending in FILE_FORMATS)}; export one of these from your '
            'CAD program'
        )
    data = read_input(path, MAX_BYTES, 'mesh', PartError)
    notes: tuple[str, ...] = ()
    if mesh_format in STEP_FORMATS:
        # Other files do not need this module.
        from resting_aspects_ros.part.scene_files import glb_from_step

        data, left_out = glb_from_step(data, label)
        mesh_format, unit = 'glb', None if unit == 'mm' else unit
        notes = _left_out(label, left_out)
    name = valid_name(path.stem) if name is None else name
    given = GivenMassValues(density, mass, centre_of_mass, inertia)
    part = _part(_File(label, data, mesh_format, name, body, given), unit)
    return replace(part, warnings=(*notes, *part.warnings))


def body_number(body: int | str | None) -> int | str | None:
    """Return the number of a body if its text is one; names of bodies take precedence."""
    return int(body) if isinstance(body, str) and re.fullmatch(r'[0-9]{1,9}', body) else body


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
    body: int | str | None = None,
) -> Part:
    """Make a part from the bytes of a mesh file.

    By default the mass properties are those of the solid inside the mesh, with a uniform density.
    They influence the aspects only through the centre of mass and the ratios of the principal
    moments, so the density and the mass only change the values that are reported.

    Parameters
    ----------
    data : bytes
    mesh_format : str
        'stl', 'obj', 'ply', 'off', 'glb' or '3mf'.
    name : str
        [a-z][a-z0-9_]*, at most 64 characters.
    unit : str, optional
        Unit of the coordinates in the file, a key of UNITS; the default is mm. A GLB is in m, and
        a 3MF states its unit.
    density : float, optional
        kg/m^3; the default is 1000 if neither density nor mass is given.
    mass : float, optional
        kg; the inertia of the solid is scaled to it.
    centre_of_mass : (3,) array_like, optional
        m, part frame; inside the convex hull. Without a given inertia, the inertia about the
        centroid of the solid is used as the inertia about this point.
    inertia : (6,) or (3, 3) array_like, optional
        kg m^2 about the centre of mass, part axes; six numbers are ixx ixy ixz iyy iyz izz.
    body : int or str, optional
        Number of the body of the mesh, from 1, largest first, or its name in a GLB or 3MF. Text
        that is not a name of a body can be a number. Required if the mesh has several bodies that
        do not touch each other.

    Raises
    ------
    PartError
        If the bytes are not a mesh, or the mesh does not enclose a solid. An open mesh can be used
        if mass, centre_of_mass and inertia are all given.
    InvalidValueError
        If an argument is invalid.
    """
    given = GivenMassValues(density, mass, centre_of_mass, inertia)
    return _part(_File(f'part {shown(name)}', data, mesh_format, name, body, given), unit)


def _part(file: _File, unit: str | None) -> Part:
    label, name = file.label, file.name
    if not isinstance(name, str) or not is_valid_name(name):
        raise InvalidValueError(
            f'invalid name {shown(name)} of {label}: expected lower case letters, digits and _, '
            f'a letter first, at most {MAX_NAME} characters'
        )
    if unit is not None and (not isinstance(unit, str) or unit not in UNITS):
        raise InvalidValueError(
            f'invalid unit {shown(unit)} of {label}: expected one of {", ".join(UNITS)}'
        )
    if file.mesh_format not in SCENE_FORMATS:
        mesh = read_triangles(file.data, file.mesh_format, label)
        return _mesh_part(file, mesh, unit, body_number(file.body))
    # Other files do not need this module.
    from resting_aspects_ros.part.scene_files import read_scene

    scene = read_scene(file.data, file.mesh_format, label)
    if unit not in (None, scene.unit):
        raise InvalidValueError(
            f'invalid unit {shown(unit)} of {label}: expected none, because the file has its own, '
            f'which is {scene.unit}'
        )
    part = _scene_part(file, scene)
    return replace(part, warnings=(*_left_out(label, scene.left_out), *part.warnings))


def _left_out(label: str, names: list[str]) -> tuple[str, ...]:
    """Return a warning that names what is not a solid, if anything."""
    if not names:
        return ()
    return (f'{label}: what is not a solid is left out: {one_line(listed(names))}',)


def _scene_part(file: _File, scene: 'Scene') -> Part:
    """Return the part that is a body of a scene, or all its bodies if none is chosen."""
    label, chosen = file.label, file.body
    several = len(scene.bodies) > 1
    if chosen not in [body.name for body in scene.bodies]:
        chosen = body_number(chosen)
    if isinstance(chosen, str) or (several and chosen is not None):
        number = scene.number(chosen, label)
        chosen = None
    else:
        number = 0
    try:
        part = _mesh_part(file, scene.triangles(number), scene.unit, chosen)
    except SeparateBodiesError as error:
        if number:
            name = shown(scene.bodies[number - 1].name)
            raise PartError(
                f'body {name} of {label} has pieces that do not touch each other: expected one'
            ) from None
        if not several:
            raise
        what = f'{label} has {len(scene.bodies)} bodies, which do not all touch each other'
        raise SeparateBodiesError(what, scene.texts) from error
    if not several:
        return part
    if not number:
        note = (
            f'{label}: its {len(scene.bodies)} bodies ({listed(scene.texts)}) are treated as one '
            f'part; choose one{CHOOSE}'
        )
        part = replace(part, warnings=(note, *part.warnings))
    return replace(part, body=number, bodies=scene.texts)
