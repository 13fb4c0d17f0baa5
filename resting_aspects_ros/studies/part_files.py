"""Parts of a study: where they come from, and copies of them with which it can be repeated."""

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import yaml

from resting_aspects_ros.api.load_part import load_part, mesh_file
from resting_aspects_ros.api.output_files import whole_file
from resting_aspects_ros.core.errors import InvalidValueError, RestingAspectsError, shown, warn
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.part_loading import FILE_FORMATS
from resting_aspects_ros.core.units import UNITS
from resting_aspects_ros.simulation.config_files import parts_folder
from resting_aspects_ros.simulation.part_library import PartLibrary

PARTS = 'parts'


def mesh_files(folder: Path) -> list[Path]:
    """Return the mesh files of a folder, sorted; raises InvalidValueError if it has none."""
    endings = {f'.{ending}' for ending in FILE_FORMATS}
    found = sorted(p for p in folder.iterdir() if p.suffix.lower() in endings and p.is_file())
    if not found:
        raise InvalidValueError(
            f'invalid part {shown(str(folder))}: it is a folder, expected mesh files '
            f'({", ".join(sorted(endings))}) in it'
        )
    return found


def part_sources(given: Sequence[str | Path]) -> Iterator[str | Path]:
    """Yield names of parts and mesh files; a folder stands for the mesh files in it."""
    for each in given:
        folder = part_folder(each)
        if folder is None:
            yield each
        else:
            yield from mesh_files(folder)


def part_folder(given: str | Path) -> Path | None:
    """Return a folder of mesh files; None for a file or the name of an example part."""
    path = Path(given)
    return path if path.is_dir() and not _is_name(given) else None


def _is_name(given: str | Path) -> bool:
    return mesh_file(given) is None and str(given) in PartLibrary(parts_folder()).names()


def source_text(source: Part | str | Path) -> str:
    """Return the name or the file of a part as text."""
    return source.name if isinstance(source, Part) else str(source)


def missing_parts(
    sources: Sequence[Part | str | Path], unit: str | None
) -> dict[int, RestingAspectsError]:
    """Return the errors of unknown names and of files that cannot be opened, and warn of them.

    They are known before the first part is simulated. The meshes of files are not read.
    """
    found: dict[int, RestingAspectsError] = {}
    for k, source in enumerate(sources):
        path = None if isinstance(source, Part) else mesh_file(source)
        readable = path is not None and path.is_file() and os.access(path, os.R_OK)
        if isinstance(source, Part) or readable:
            continue
        try:
            load_part(source, unit if path is not None else None)
        except RestingAspectsError as error:
            warn(f'{source_text(source)}: {error}')
            found[k] = error
    return found


def load_parts(given: Sequence[Part | str | Path], base: Path | None = None) -> list[Part]:
    """Return parts with different names; files are relative to the folder ``base``."""
    found: list[Part] = []
    for each in given:
        if isinstance(each, Part):
            found.append(each)
            continue
        path = mesh_file(each)
        if base is not None and not _is_name(each) and (base / each).is_dir():
            path = Path(each)
        if path is not None and base is not None:
            path = base / path
        found += [load_part(source) for source in part_sources([path or each])]
    names = [part.name for part in found]
    for name in names:
        if names.count(name) > 1:
            raise InvalidValueError(
                f'invalid parts: expected different names, not {name!r} several times'
            )
    if not found:
        raise InvalidValueError('missing part: expected a name or a mesh file')
    return found


def save_part(part: Part, folder: Path) -> str:
    """Write the mesh and the YAML file of a part; returns the path of the mesh in the folder.

    The part that is read from them has the same hash. Raises OutputError.
    """
    (folder / PARTS).mkdir(parents=True, exist_ok=True)
    mesh = folder / PARTS / f'{part.name}.{part.mesh_format}'
    with whole_file(mesh) as file:
        file.write_bytes(part.mesh_bytes)
    for values in _descriptions(part):
        with whole_file(mesh.with_suffix('.yaml')) as file:
            file.write_text(yaml.safe_dump(values, sort_keys=False), encoding='utf-8')
        try:
            if load_part(mesh).part_sha256 == part.part_sha256:
                break
        except RestingAspectsError:
            continue
    return f'{PARTS}/{mesh.name}'


def _descriptions(part: Part) -> Iterator[dict[str, Any]]:
    """Yield descriptions with more and more of the values that may have been given."""
    values: dict[str, Any] = {'unit': part.unit}
    if part.body:
        values['body'] = part.body
    yield values
    values = {**values, 'mass': part.mass}
    yield values
    centre = (part.centre_of_mass / UNITS[part.unit]).tolist()
    values = {**values, 'centre_of_mass': centre}
    yield values
    i = part.inertia
    inertia = [i[0, 0], i[0, 1], i[0, 2], i[1, 1], i[1, 2], i[2, 2]]
    yield {**values, 'inertia': [float(each) for each in inertia]}
