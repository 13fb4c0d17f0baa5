"""Named surroundings: one YAML file for each; and changes of single values."""

import dataclasses
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from resting_aspects_ros.core.errors import InvalidValueError, did_you_mean, shown
from resting_aspects_ros.core.input_file import named
from resting_aspects_ros.core.quantity_text import parse_quantity
from resting_aspects_ros.core.yaml_file import read_yaml
from resting_aspects_ros.simulation.config_files import surroundings_folder
from resting_aspects_ros.simulation.quantity import (
    Quantity,
    described_kind,
    made_from,
    quantities_of,
)
from resting_aspects_ros.simulation.surroundings.description import (
    BODY_VALUES,
    KINDS,
    RELEASE_VALUES,
    Surroundings,
)
from resting_aspects_ros.simulation.surroundings.mesh_surface import (
    MeshFile,
    MeshSurface,
    read_mesh,
)

ENDINGS = ('.yaml', '.yml')


def surroundings_names() -> list[str]:
    """Return the names of the surroundings in config/surroundings, sorted."""
    return sorted(path.stem for path in surroundings_folder().glob('*.yaml'))


def named_surroundings(name: str | Path, changes: Mapping[str, Any] | None = None) -> Surroundings:
    """Return the surroundings of a name, a kind or a YAML file, with changed values.

    Parameters
    ----------
    name : str or Path
        A path with a directory or an ending is a file; otherwise a name of `surroundings_names`,
        or a kind, such as 'slope'.
    changes : mapping, optional
        Values by their names, such as ``{'roll': 0.8, 'belt.friction': '0.4', 'release.y_min':
        '10mm'}``. A number is in SI units; a text may have a unit.

    Raises
    ------
    InvalidValueError
        If the name is not known, the file cannot be read, or a value is out of bounds.
    """
    text = str(name)
    is_file = isinstance(name, Path) or '/' in text or text.endswith(ENDINGS)
    file = Path(text) if is_file else surroundings_folder() / f'{text}.yaml'
    if is_file or text in surroundings_names():
        document = read_yaml(file, 'surroundings file')
        where = named('surroundings file', file) if is_file else f'surroundings {text}'
    elif text in KINDS:
        document, where = {'kind': text}, f'surroundings {text}'
    else:
        known = sorted({*surroundings_names(), *KINDS})
        raise InvalidValueError(
            f'invalid surroundings {shown(text)}: expected a YAML file (with its folder or its '
            f'ending) or one of '
            f'{", ".join(known)}{did_you_mean(text, known)}'
        )
    try:
        described_kind('surroundings', document, KINDS)
        _resolve_mesh(document, file.parent)
        values = _plain(document)
        for key, value in (changes or {}).items():
            _change(values, key, value)
        title = file.stem if is_file or not changes else text
        return make_surroundings(values, title, _mesh_of(values))
    except InvalidValueError as error:
        raise InvalidValueError(f'{where}: {error}') from None


def changed_surroundings(base: Surroundings, changes: Mapping[str, Any]) -> Surroundings:
    """Return surroundings with changes; see named_surroundings. Raises InvalidValueError."""
    values: dict[str, Any] = json.loads(json.dumps(base.document))
    for key, value in changes.items():
        _change(values, key, value)
    mesh = base.shape.file if isinstance(base.shape, MeshSurface) else None
    if 'mesh' in changes:
        del values['mesh_sha256']
        mesh = _mesh_of(values)
    return make_surroundings(values, base.name, mesh)


def surroundings_from(text: str, mesh: MeshFile | None = None) -> Surroundings | None:
    """Return the surroundings with a key, or of a JSON document; None for an empty one.

    Reads no file: without ``mesh``, a mesh surface has only the name and the hash of its mesh.
    Raises InvalidValueError.
    """
    if not text:
        return None
    try:
        document = json.loads(text)
        if isinstance(document, dict) and document.get('kind') == MeshSurface.kind:
            sha256 = document.get('mesh_sha256')
            if not isinstance(sha256, str) or not sha256:
                raise InvalidValueError(
                    f'invalid mesh_sha256 {shown(sha256)}: expected the hash of the mesh'
                )
        return make_surroundings(document, mesh=mesh)
    except (ValueError, RecursionError) as error:
        raise InvalidValueError(f'invalid surroundings {shown(text)}: {error}') from None


def make_surroundings(document: Any, name: str = '', mesh: MeshFile | None = None) -> Surroundings:
    """Return the surroundings that a mapping describes; see Surroundings.document.

    ``mesh`` is that of a mesh surface, if it was read already. Raises InvalidValueError, with the
    name of the key.
    """
    kind, values, _ = described_kind('surroundings', document, KINDS)
    others = ('bodies', 'release', 'orientation')
    common = {key: values.pop(key) for key in others if key in values}
    if mesh is not None:
        values.setdefault('mesh_sha256', mesh.sha256)
    shape = made_from(KINDS, 'surroundings', kind, values, others)
    if mesh is not None:
        shape = dataclasses.replace(shape, file=mesh)
    return Surroundings(shape, name=name, **common)


def _mesh_of(values: Mapping[str, Any]) -> MeshFile | None:
    """Return the mesh that a description names by its path, if it is a mesh surface."""
    if values['kind'] != MeshSurface.kind or not isinstance(values.get('mesh'), str | Path):
        return None
    return read_mesh(Path(values['mesh']))


def _resolve_mesh(document: dict[str, Any], folder: Path) -> None:
    """Make the path of a mesh relative to the folder of the YAML file."""
    mesh = document.get('mesh')
    if isinstance(mesh, str) and not Path(mesh).is_absolute():
        document['mesh'] = str(folder / mesh)


def _plain(document: dict[str, Any]) -> dict[str, Any]:
    """Return a description with numbers instead of texts with units."""
    values = dict(document)
    shape = quantities_of(KINDS[values['kind']])
    for name, value in values.items():
        if name in shape:
            values[name] = _number(name, value, shape[name])
    if isinstance(values.get('release'), dict):
        values['release'] = _numbers('release', values['release'], RELEASE_VALUES)
    if isinstance(values.get('bodies'), dict):
        values['bodies'] = {
            body: _numbers(str(body), each, BODY_VALUES) if isinstance(each, dict) else each
            for body, each in values['bodies'].items()
        }
    return values


def _numbers(name: str, given: dict[str, Any], known: Mapping[str, Quantity]) -> dict[str, Any]:
    return {
        key: _number(f'{name} {key}', value, known[key]) if key in known else value
        for key, value in given.items()
    }


def _number(name: str, value: Any, quantity: Quantity) -> Any:
    return parse_quantity(name, value, quantity.unit) if isinstance(value, str) else value


def _change(values: dict[str, Any], key: str, value: Any) -> None:
    """Set a value of a description; a body or the release is named before a dot."""
    group, dot, name = key.partition('.')
    if key == 'kind':
        raise InvalidValueError(
            'invalid name kind of a value: expected another value; a kind is chosen instead of '
            'the name of the surroundings'
        )
    if not dot:
        shape = quantities_of(KINDS[values['kind']])
        values[key] = _number(key, value, shape[key]) if key in shape else value
        return
    if group == 'release':
        target, known = values.setdefault('release', {}), RELEASE_VALUES
    else:
        target, known = values.setdefault('bodies', {}).setdefault(group, {}), BODY_VALUES
    if not isinstance(target, dict):
        raise InvalidValueError(f'invalid {group} {shown(target)}: expected a mapping')
    target[name] = _number(key, value, known[name]) if name in known else value
