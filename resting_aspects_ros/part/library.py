"""The parts of a folder of mesh files by their names, and a part by a name or a file."""

import os
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any

from resting_aspects_ros.errors import (
    InvalidValueError,
    PartError,
    RestingAspectsError,
    UnknownPartError,
    did_you_mean,
    shown,
    warn,
)
from resting_aspects_ros.input_files import (
    FileModel,
    FromOne,
    Named,
    Number,
    Positive,
    is_file,
    named,
    printable,
    read_yaml,
    validated,
)
from resting_aspects_ros.part.loading import FILE_FORMATS, body_number
from resting_aspects_ros.part.loading import load_part as load_mesh
from resting_aspects_ros.part.mesh_files import SCENE_FORMATS
from resting_aspects_ros.part.part import DEFAULT_UNIT, MAX_NAME, UNITS, Part, Unit, is_valid_name
from resting_aspects_ros.system import parts_folder

# -- The folder of parts --------------------------------------------------------------------------


class PartFile(FileModel):
    """A part's YAML file; see PartLibrary."""

    unit: Unit = DEFAULT_UNIT
    density: Positive = 0
    mass: Positive = 0
    centre_of_mass: tuple[Number, Number, Number] = (0, 0, 0)
    inertia: tuple[Number, Number, Number, Number, Number, Number] = (0, 0, 0, 0, 0, 0)
    body: FromOne | Named = 0


EXPECTED = {
    'unit': f'one of {", ".join(UNITS)}',
    'density': 'a finite number above 0',
    'mass': 'a finite number above 0',
    'centre_of_mass': '3 finite numbers',
    'inertia': '6 finite numbers',
    'body': 'an integer of at least 1, or the name of a body',
}

Stamp = tuple[tuple[int, int] | None, ...]


class PartLibrary:
    """Parts by name, read from a folder on request, and read again when a file changes.

    Parameters
    ----------
    folder : Path
        Contains <name>.<format>, with one of FILE_FORMATS, and an optional <name>.yaml with unit,
        density (kg/m^3) or mass (kg), centre_of_mass (three numbers in the mesh's unit), inertia
        (six numbers, kg m^2, ixx ixy ixz iyy iyz izz about the centre of mass), and body (number,
        from 1, or name of the body in a mesh with several).
    """

    def __init__(self, folder: Path) -> None:
        self.folder = Path(folder)
        self._loaded: dict[str, tuple[Stamp, Part | RestingAspectsError]] = {}

    def names(self) -> list[str]:
        """Return the names of the registered parts, sorted."""
        return sorted(self._meshes())

    def stamps(self) -> dict[str, Stamp]:
        """Return a stamp for each registered part, which changes when one of its files changes."""
        return {
            name: (_stamp(mesh), _stamp(mesh.with_suffix('.yaml')))
            for name, mesh in self._meshes().items()
        }

    def problems(self) -> list[str]:
        """Return a message for each file that looks like a part but is not registered."""
        where = f'in {str(self.folder)!r}'
        by_stem = self._by_stem()
        found = (
            []
            if os.access(self.folder, os.R_OK | os.X_OK) and self.folder.is_dir()
            else [f'the folder of parts {str(self.folder)!r} does not exist or cannot be read']
        )
        found += [
            f'{printable(file.name)} {where} is not used: expected the name <part>.yaml, with a '
            'mesh of the same name'
            for file in self._files()
            if file.suffix.lower() in ('.yaml', '.yml')
            and not (file.suffix == '.yaml' and file.stem in by_stem)
        ]
        return found + list(dict.fromkeys(self.not_registered().values()))

    def not_registered(self) -> dict[str, str]:
        """Return the reason for each mesh file that is not registered as a part."""
        where = f'in {str(self.folder)!r}'
        found: dict[str, str] = {}
        for stem, files in self._by_stem().items():
            names = ', '.join(printable(file.name) for file in files)
            if not is_valid_name(stem):
                why = (
                    f'{names} {where} is not registered: expected a name of lower case letters, '
                    f'digits and _, a letter first, at most {MAX_NAME} characters'
                )
            elif len(files) > 1:
                why = f'{names} {where} are not registered: expected one mesh for part {stem!r}'
            else:
                continue
            found |= {printable(file.name): why for file in files}
        return found

    def load(self, name: str) -> Part:
        """Return the part with this name.

        Raises
        ------
        UnknownPartError
            If no part has this name; the message lists the registered parts.
        PartError, InvalidValueError
            If the mesh or the YAML file cannot be used.
        """
        mesh = self._meshes().get(name)
        if mesh is None:
            raise UnknownPartError(self._unknown(name))
        yaml_file = mesh.with_suffix('.yaml')
        stamp = (_stamp(mesh), _stamp(yaml_file))
        loaded = self._loaded.get(name)
        if loaded is None or loaded[0] != stamp:
            loaded = self._loaded[name] = stamp, _read(mesh, yaml_file if stamp[1] else None)
        result = loaded[1]
        if isinstance(result, RestingAspectsError):
            raise type(result)(str(result))
        return result

    def _meshes(self) -> dict[str, Path]:
        return {
            stem: files[0]
            for stem, files in self._by_stem().items()
            if len(files) == 1 and is_valid_name(stem)
        }

    def _by_stem(self) -> dict[str, list[Path]]:
        found: dict[str, list[Path]] = {}
        for file in self._files():
            if file.suffix.lower().removeprefix('.') in FILE_FORMATS:
                found.setdefault(file.stem, []).append(file)
        return found

    def _files(self) -> list[Path]:
        try:
            return sorted(filter(is_file, self.folder.iterdir()))
        except OSError:  # problems() reports it
            return []

    def _unknown(self, name: str) -> str:
        names = self.names()
        hint = did_you_mean(name, names)
        related = [problem for problem in self.problems() if printable(str(name)) in problem]
        hint += ''.join(f'; {problem}' for problem in related)
        return unknown_part_text(name, names, f'none in {str(self.folder)!r}') + hint


def unknown_part_text(name: str, known: Iterable[str], none: str) -> str:
    """Return the error message for an unknown part name; ``none`` replaces an empty list."""
    names = ', '.join(sorted(known)) or none
    return f'part {shown(str(name))} is not known; known parts: {names}'


def _read(mesh: Path, yaml_file: Path | None) -> Part | RestingAspectsError:
    """Return the part or the error, so that an invalid file is not read again either."""
    try:
        return load_mesh(mesh, mesh.stem, **(read_part_yaml(yaml_file, mesh) if yaml_file else {}))
    except RestingAspectsError as error:
        return error


def read_part_yaml(path: Path, mesh: Path, unit: str | None = None) -> dict[str, Any]:
    """Return the values of the YAML file of a mesh as arguments of load_part, in SI units.

    unit : str, optional
        Unit of the mesh if the file states none; by default mm.

    Raises
    ------
    PartError
        If the file cannot be read, has an unknown key, a value of the wrong kind, or a centre of
        mass without a unit beside a mesh that has its own.
    """
    label = named('part file', path)
    content = read_yaml(path, 'part file', error=PartError)
    if content is None:
        return {}
    checked = validated(PartFile, content, label, EXPECTED, PartError)
    given: dict[str, Any] = {key: getattr(checked, key) for key in content}
    for key in given.keys() & {'density', 'mass'}:
        given[key] = float(given[key])
    if 'centre_of_mass' in given:
        unit = given.get('unit', unit)
        if unit is None and mesh.suffix.lower().removeprefix('.') in SCENE_FORMATS:
            raise PartError(
                f'missing unit in {label}: expected the unit of {named("mesh", mesh)}, in which '
                'the centre_of_mass is given'
            )
        metres = UNITS[unit or DEFAULT_UNIT]
        given['centre_of_mass'] = [x * metres for x in given['centre_of_mass']]
    return given


def _stamp(path: Path) -> tuple[int, int] | None:
    """Return the modification time and the size of a file; None if it does not exist."""
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_mtime_ns, status.st_size


# -- A part by a name or a file -------------------------------------------------------------------


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
    if unit is not None and unit not in UNITS:
        raise InvalidValueError(f'invalid unit {shown(unit)}: expected one of {", ".join(UNITS)}')
    yaml_file = mesh.parent / f'{mesh.stem}.yaml'
    values = read_part_yaml(yaml_file, mesh, unit) if yaml_file.exists() else {}
    if unit is not None and values.setdefault('unit', unit) != unit:
        raise InvalidValueError(
            f'invalid unit {unit!r}: expected {values["unit"]!r}, the unit in {str(yaml_file)!r}'
        )
    if body is not None:
        if body_number(values.get('body', body)) != body_number(body):
            raise InvalidValueError(
                f'invalid body {shown(body_number(body))}: expected {values["body"]}, the body in '
                f'{shown(str(yaml_file))}'
            )
        values.setdefault('body', body)
    return values
