"""Load a part from a mesh file, or make it from the bytes of one."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

from resting_aspects_ros.core.errors import InvalidValueError, PartError, one_line, shown
from resting_aspects_ros.core.geometry.bodies import SeparateBodiesError
from resting_aspects_ros.core.geometry.mass_properties import GivenMassValues
from resting_aspects_ros.core.geometry.mesh_file import MESH_FORMATS, read_triangles
from resting_aspects_ros.core.geometry.scene_file import SCENE_FORMATS, Scene, read_scene
from resting_aspects_ros.core.geometry.step_file import STEP_FORMATS, glb_from_step
from resting_aspects_ros.core.input_file import named, read_input
from resting_aspects_ros.core.mesh_part import mesh_part
from resting_aspects_ros.core.part import MAX_NAME, Part, is_valid_name, valid_name
from resting_aspects_ros.core.units import UNITS

# Formats of a part, and those of the files from which a part can be loaded.
FORMATS = (*MESH_FORMATS, *SCENE_FORMATS)
FILE_FORMATS = (*FORMATS, *STEP_FORMATS)
MAX_BYTES = 256 << 20  # maximum mesh file size; MAX_TRIANGLES need less in any format
MAX_LISTED = 5
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
        raise PartError(f'{label} has {_wrong_format(path.suffix)}')
    data = read_input(path, MAX_BYTES, 'mesh', PartError)
    notes: tuple[str, ...] = ()
    if mesh_format in STEP_FORMATS:
        data, left_out = glb_from_step(data, label)
        mesh_format, unit = 'glb', None if unit == 'mm' else unit
        notes = _left_out(label, left_out)
    part = _part(
        label,
        data,
        mesh_format,
        valid_name(path.stem) if name is None else name,
        unit,
        body,
        GivenMassValues(density, mass, centre_of_mass, inertia),
    )
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
    expected = ', '.join(f'.{ending}' for ending in FILE_FORMATS)
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
    chosen_body: int | str | None,
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
    file = (name, data, mesh_format)
    if mesh_format not in SCENE_FORMATS:
        mesh = read_triangles(data, mesh_format, label)
        return mesh_part(label, mesh, unit, body_number(chosen_body), given, file)
    scene = read_scene(data, mesh_format, label)
    if unit not in (None, scene.unit):
        raise InvalidValueError(
            f'invalid unit {shown(unit)} of {label}: expected none, because the file has its own, '
            f'which is {scene.unit}'
        )
    part = _scene_part(label, scene, chosen_body, given, file)
    return replace(part, warnings=(*_left_out(label, scene.left_out), *part.warnings))


def _left_out(label: str, names: list[str]) -> tuple[str, ...]:
    """Return a warning that names what is not a solid, if anything."""
    if not names:
        return ()
    listed = ', '.join(names[:MAX_LISTED]) + (', ...' if len(names) > MAX_LISTED else '')
    return (f'{label}: what is not a solid is left out: {one_line(listed)}',)


def _scene_part(
    label: str,
    scene: Scene,
    chosen: int | str | None,
    given: GivenMassValues,
    file: tuple[str, bytes, str],
) -> Part:
    """Return the part that is a body of a scene, or all its bodies if none is chosen."""
    several = len(scene.bodies) > 1
    if chosen not in [body.name for body in scene.bodies]:
        chosen = body_number(chosen)
    if isinstance(chosen, str) or (several and chosen is not None):
        number = scene.number(chosen, label)
        chosen = None
    else:
        number = 0
    try:
        part = mesh_part(label, scene.triangles(number), scene.unit, chosen, given, file)
    except SeparateBodiesError as error:
        if number:
            name = shown(scene.bodies[number - 1].name)
            raise PartError(
                f'body {name} of {label} has pieces that do not touch each other: expected one'
            ) from None
        if not several:
            raise
        raise PartError(
            f'{label} has {len(scene.bodies)} bodies, which do not all touch each other '
            f'({scene.listed()}): choose one with --body NUMBER or --body NAME, or with "body" in '
            'the YAML file beside the mesh'
        ) from error
    if not several:
        return part
    if not number:
        note = (
            f'{label}: its {len(scene.bodies)} bodies ({scene.listed()}) are treated as one part; '
            'choose one with --body NUMBER or --body NAME'
        )
        part = replace(part, warnings=(note, *part.warnings))
    return replace(part, body=number)
