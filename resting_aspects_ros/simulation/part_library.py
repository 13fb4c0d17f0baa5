"""The registered parts: a folder of meshes, each with an optional YAML beside it."""

import difflib
import math
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from resting_aspects_ros.core.errors import PartError, RestingAspectsError, UnknownPartError, shown
from resting_aspects_ros.core.geometry.mesh_file import FORMATS
from resting_aspects_ros.core.input_file import is_file, named, printable
from resting_aspects_ros.core.part import MAX_NAME, Part, is_valid_name
from resting_aspects_ros.core.part_loading import load_part
from resting_aspects_ros.core.units import DEFAULT_UNIT, UNITS
from resting_aspects_ros.core.yaml_file import read_yaml

# The keys of a part's YAML, and what each takes; the numbers are how many.
KEYS: dict[str, int | str] = {
    'unit': 'unit',
    'density': 1,
    'mass': 1,
    'centre_of_mass': 3,
    'inertia': 6,
    'body': 'body',
}

Stamp = tuple[tuple[int, int] | None, ...]


class PartLibrary:
    """Parts by name, read from a folder when they are asked for, and again when a file changes.

    Parameters
    ----------
    folder : Path
        Holds <name>.stl, .obj or .ply, and <name>.yaml where the mesh does not say enough: unit,
        density (kg/m^3) or mass (kg), centre_of_mass (three numbers in the mesh's unit), inertia
        (six numbers, kg m^2, ixx ixy ixz iyy iyz izz about the centre of mass), body (which of
        several bodies, from 1 on).
    """

    def __init__(self, folder: Path) -> None:
        self.folder = Path(folder)
        self._loaded: dict[str, tuple[Stamp, Part | RestingAspectsError]] = {}

    def names(self) -> list[str]:
        """Return the names of the registered parts, sorted."""
        return sorted(self._meshes())

    def stamps(self) -> dict[str, Stamp]:
        """Return, by the name of each registered part, what changes when one of its files does."""
        return {
            name: (_stamp(mesh), _stamp(mesh.with_suffix('.yaml')))
            for name, mesh in self._meshes().items()
        }

    def problems(self) -> list[str]:
        """Return a sentence for each file that looks like a part and is not registered as one."""
        where = f'in {str(self.folder)!r}'
        by_stem = self._by_stem()
        found = (
            []
            if os.access(self.folder, os.R_OK | os.X_OK) and self.folder.is_dir()
            else [f'the folder of parts {str(self.folder)!r} does not exist or cannot be read']
        )
        found += [
            f'{printable(file.name)} {where} is not used: it must be <part>.yaml, beside the mesh '
            'of that name'
            for file in self._files()
            if file.suffix.lower() in ('.yaml', '.yml')
            and not (file.suffix == '.yaml' and file.stem in by_stem)
        ]
        return found + list(dict.fromkeys(self.not_registered().values()))

    def not_registered(self) -> dict[str, str]:
        """Return why, in a sentence, by the name of each mesh that is not registered as a part."""
        where = f'in {str(self.folder)!r}'
        found: dict[str, str] = {}
        for stem, files in self._by_stem().items():
            names = ', '.join(printable(file.name) for file in files)
            if not is_valid_name(stem):
                why = (
                    f'{names} {where} is not registered: a part is named with lower case letters, '
                    f'digits and _, a letter first, at most {MAX_NAME} characters'
                )
            elif len(files) > 1:
                why = f'{names} {where} are not registered: only one mesh can be the part {stem!r}'
            else:
                continue
            found |= {printable(file.name): why for file in files}
        return found

    def load(self, name: str) -> Part:
        """Return the part of that name.

        Raises
        ------
        UnknownPartError
            No such part; the message lists those that are.
        PartError, InvalidValueError
            The mesh or the YAML cannot be used.
        """
        mesh = self._meshes().get(name)
        if mesh is None:
            raise UnknownPartError(self._unknown(name))
        sheet = mesh.with_suffix('.yaml')
        stamp = (_stamp(mesh), _stamp(sheet))
        known = self._loaded.get(name)
        if known is None or known[0] != stamp:
            known = self._loaded[name] = stamp, _read(mesh, sheet if stamp[1] else None)
        found = known[1]
        if isinstance(found, RestingAspectsError):
            raise type(found)(str(found))
        return found

    def _meshes(self) -> dict[str, Path]:
        return {
            stem: files[0]
            for stem, files in self._by_stem().items()
            if len(files) == 1 and is_valid_name(stem)
        }

    def _by_stem(self) -> dict[str, list[Path]]:
        found: dict[str, list[Path]] = {}
        for file in self._files():
            if file.suffix.lower().removeprefix('.') in FORMATS:
                found.setdefault(file.stem, []).append(file)
        return found

    def _files(self) -> list[Path]:
        try:
            return sorted(filter(is_file, self.folder.iterdir()))
        except OSError:  # problems() tells
            return []

    def _unknown(self, name: str) -> str:
        names = self.names()
        close = difflib.get_close_matches(str(name).lower(), names, n=1)
        hint = f'; did you mean {close[0]!r}?' if close else ''
        unfit = [sentence for sentence in self.problems() if printable(str(name)) in sentence]
        hint += ''.join(f'; {sentence}' for sentence in unfit)
        return unknown_part_text(name, names, f'none in {str(self.folder)!r}') + hint


def unknown_part_text(name: str, known: Iterable[str], none: str) -> str:
    """Return the error message for an unknown part name; ``none`` replaces an empty list."""
    names = ', '.join(sorted(known)) or none
    return f'part {shown(str(name))} is not known; known parts: {names}'


def _read(mesh: Path, sheet: Path | None) -> Part | RestingAspectsError:
    """Return the part, or what is wrong, so that a bad file is not read again either."""
    try:
        return load_part(mesh, mesh.stem, **(read_part_yaml(sheet) if sheet else {}))
    except RestingAspectsError as error:
        return error


def read_part_yaml(path: Path) -> dict[str, Any]:
    """Return what a part's YAML says, as arguments of load_part: SI units.

    Raises
    ------
    PartError
        It cannot be read, has an unknown key, or a value of the wrong kind.
    """
    label = named('part file', path)
    content = read_yaml(path, 'part file', error=PartError)
    if content is None:
        return {}
    if not isinstance(content, Mapping):
        raise PartError(
            f'invalid content of {label}: expected a mapping with the keys {", ".join(KEYS)}, '
            f'not a {type(content).__name__}'
        )
    for key in content:
        if key not in KEYS:
            raise PartError(
                f'invalid key {shown(key)} in {label}: expected one of {", ".join(KEYS)}'
            )
    given = {key: _checked(value, key, label) for key, value in content.items()}
    if 'centre_of_mass' in given:
        metres = UNITS[given.get('unit', DEFAULT_UNIT)]
        given['centre_of_mass'] = [x * metres for x in given['centre_of_mass']]
    return given


def _checked(value: Any, key: str, label: str) -> Any:
    takes = KEYS[key]
    if takes == 'unit':
        good, expected = isinstance(value, str) and value in UNITS, f'one of {", ".join(UNITS)}'
    elif takes == 'body':
        good, expected = type(value) is int and value > 0, 'an integer of at least 1'
    elif takes == 1:
        value, given = _number(value), value
        good, expected = value is not None and value > 0, 'a finite number above 0'
        value = value if good else given
    else:
        numbers = [_number(x) for x in value] if isinstance(value, list) else []
        good, expected = len(numbers) == takes and None not in numbers, f'{takes} finite numbers'
        value = numbers if good else value
    if not good:
        raise PartError(f'invalid {key} {shown(value)} in {label}: expected {expected}')
    return value


def _number(value: Any) -> float | None:
    """Return a finite number; also of text, because to YAML 1.1 1e-6, without a dot, is text."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return None
    try:
        found = float(value)
    except (ValueError, OverflowError):
        return None
    return found if math.isfinite(found) else None


def _stamp(path: Path) -> tuple[int, int] | None:
    """Return what changes when a file does; None if there is none."""
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_mtime_ns, status.st_size
