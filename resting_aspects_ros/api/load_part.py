"""Load a part, from a mesh file or by its name."""

import os
from contextlib import suppress
from pathlib import Path
from typing import Any

from resting_aspects_ros.errors import InvalidValueError, UnknownPartError, shown, warn
from resting_aspects_ros.part.library import PartLibrary, read_part_yaml
from resting_aspects_ros.part.loading import FILE_FORMATS, body_number
from resting_aspects_ros.part.loading import load_part as load_mesh
from resting_aspects_ros.part.part import DEFAULT_UNIT, UNITS, Part
from resting_aspects_ros.simulation.conditions import parts_folder


def load_part(
    part: str | Path,
    unit: str | None = None,
    folder: str | Path | None = None,
    body: int | str | None = None,
) -> Part:
    """Load a part from a mesh file, with the YAML file beside it, or by name from a folder.

    Parameters
    ----------
    part : str or Path
        A path with a directory or an ending is a mesh file; anything else is the name of a part.
    unit : str, optional
        Unit of the mesh file: 'um', 'mm', 'cm', 'm', 'in' or 'ft'; by default that of the YAML
        file, else mm. STEP, GLB and 3MF files have their own unit.
    folder : str or Path, optional
        Folder of named parts; by default the example parts.
    body : int or str, optional
        Body of a mesh file to use, if it has several: its number, 1 is the largest, or its name
        in a STEP, GLB or 3MF file.

    Raises
    ------
    PartError
        The mesh is not a solid, or cannot be read.
    UnknownPartError
        The folder has no part of that name.
    InvalidValueError
        The unit or the body contradicts the YAML file.

    Examples
    --------
    >>> import resting_aspects_ros as ra
    >>> part = ra.load_part('l_bracket')
    >>> f'{1000 * part.mass:.1f} g'
    '94.2 g'
    """
    text = str(part)
    mesh = part if isinstance(part, Path) else mesh_file(text)
    if mesh:
        return load_mesh(mesh, **_yaml_values(mesh, unit, body))
    if unit is not None:
        raise InvalidValueError(
            f'invalid unit {shown(unit)}: expected only with a mesh file; {shown(text)} is '
            f'the name of a part, whose unit is that of its YAML file, else {DEFAULT_UNIT}'
        )
    if body is not None:
        raise InvalidValueError(
            f'invalid body {shown(body_number(body))}: expected only with a mesh file; '
            f'{shown(text)} is the name of a part, whose body is that of its YAML file'
        )
    if folder is not None and not Path(folder).is_dir():
        raise InvalidValueError(
            f'invalid folder of parts {shown(str(folder))}: expected a folder of meshes'
        )
    try:
        return PartLibrary(parts_folder() if folder is None else Path(folder)).load(text)
    except UnknownPartError:
        if folder is None and (here := _mesh_here(text)):
            raise UnknownPartError(
                f'part {shown(text)} is not known; for the mesh file in this folder, write '
                f'{here!r}'
            ) from None
        raise


def given_part(part: Part | str | Path) -> Part:
    """Return a part, or load it as load_part does, and warn of what is unusual about it."""
    loaded = part if isinstance(part, Part) else load_part(part)
    for warning in loaded.warnings:
        warn(warning)
    return loaded


def mesh_file(text: str | Path | None) -> Path | None:
    """Return the path if a part is given as a file, None if it is a name."""
    if isinstance(text, Path):
        return text
    seps = [sep for sep in (os.sep, os.altsep) if sep]
    if text and (any(sep in text for sep in seps) or Path(text).suffix or text in ('.', '..')):
        return Path(text)
    return None


def _mesh_here(stem: str) -> str:
    """Return the name of a mesh file in the working folder; empty if there is none."""
    with suppress(OSError):
        for file in sorted(Path().iterdir()):
            ending = file.suffix.lower().removeprefix('.')
            if file.stem == stem and ending in FILE_FORMATS and file.is_file():
                return file.name
    return ''


def _yaml_values(mesh: Path, unit: str | None, body: int | str | None) -> dict[str, Any]:
    """Return the values of the YAML file of a mesh, with the requested unit and body."""
    yaml_file = mesh.parent / f'{mesh.stem}.yaml'
    values = read_part_yaml(yaml_file, mesh) if yaml_file.exists() else {}
    if body is not None:
        if body_number(values.get('body', body)) != body_number(body):
            raise InvalidValueError(
                f'invalid body {shown(body_number(body))}: expected {values["body"]}, the body in '
                f'{shown(str(yaml_file))}'
            )
        values.setdefault('body', body)
    if unit is None:
        return values
    if unit not in UNITS:
        raise InvalidValueError(f'invalid unit {shown(unit)}: expected one of {", ".join(UNITS)}')
    written = values.get('unit')
    if written not in (None, unit):
        raise InvalidValueError(
            f'invalid unit {unit!r}: expected {written!r}, the unit in {str(yaml_file)!r}'
        )
    # The centre of mass would be read in the default unit.
    if written is None and 'centre_of_mass' in values and unit != DEFAULT_UNIT:
        raise InvalidValueError(
            f'invalid unit {unit!r}: {str(yaml_file)!r} gives a centre_of_mass without a unit; '
            f'write "unit: {unit}" into it'
        )
    return {**values, 'unit': unit}
