"""Read the bodies of a GLB or 3MF file, which have names and places, with trimesh."""

import io
import warnings
import zipfile
from dataclasses import dataclass
from typing import Any

import numpy as np

from resting_aspects_ros.core.errors import InvalidValueError, PartError, one_line, shown
from resting_aspects_ros.core.geometry.closed_surface import closed_surface
from resting_aspects_ros.core.geometry.coordinate_steps import (
    MAX_ROWS,
    Array,
    coordinate_steps,
)
from resting_aspects_ros.core.geometry.mesh_file import Triangles, check_count, checked_triangles
from resting_aspects_ros.core.units import UNITS, box_text

SCENE_FORMATS = ('glb', '3mf')
UNPACKED = 256 << 20  # maximum size of the files in a 3MF, bytes
MAX_LISTED = 5
# The words of the unit in a 3MF, as trimesh returns them. Lengths in a GLB are in metres.
_UNITS = {
    'micron': 'um',
    'millimeter': 'mm',
    'millimeters': 'mm',
    'centimeter': 'cm',
    'meter': 'm',
    'inch': 'in',
    'foot': 'ft',
}


@dataclass(frozen=True, eq=False)
class SceneBody:
    """A body with its name, which is unique in its file, and its triangles."""

    name: str
    triangles: Triangles


@dataclass(frozen=True, eq=False)
class Scene:
    """The bodies of a file, the largest first, and the names of what is left out."""

    bodies: list[SceneBody]
    unit: str
    left_out: list[str]

    def number(self, chosen: int | str, label: str) -> int:
        """Return the number of a body, from 1, that is given as its number or its name."""
        names = [body.name for body in self.bodies]
        if type(chosen) is int and 1 <= chosen <= len(names):
            return chosen
        if type(chosen) in (int, str) and str(chosen) in names:
            return names.index(str(chosen)) + 1
        expected = ', '.join(map(shown, names[:MAX_LISTED]))
        more = ', ...' if len(names) > MAX_LISTED else ''
        raise InvalidValueError(
            f'invalid body {shown(chosen)} of {label}: expected 1 to {len(names)}, or one of '
            f'{expected}{more}'
        )

    def triangles(self, number: int) -> Triangles:
        """Return the triangles of a body, or of all bodies for 0."""
        if number:
            return self.bodies[number - 1].triangles
        return _joined([body.triangles for body in self.bodies])

    def listed(self) -> str:
        """Return the numbers, names and sizes of the bodies."""
        texts = [
            f'{k}: {shown(body.name)} '
            f'{box_text(np.ptp(body.triangles.vertices, axis=0), self.unit)}'
            for k, body in enumerate(self.bodies[:MAX_LISTED], 1)
        ]
        return ', '.join(texts) + (', ...' if len(self.bodies) > MAX_LISTED else '')


def read_scene(data: bytes, mesh_format: str, label: str) -> Scene:
    """Return the bodies in the bytes of a GLB or 3MF file, in the unit and frame of the file.

    A mesh of the file that is not closed is left out if another one is closed.

    Raises
    ------
    PartError
        If the bytes are not a complete file in that format with a mesh.
    """
    try:
        with np.errstate(all='ignore'):
            loaded = _load(data, mesh_format, label)
            found, left_out = _bodies(loaded, label, text=mesh_format == '3mf')
    except PartError:
        raise
    except Exception as error:  # noqa: BLE001 its parsers raise exceptions of any type
        # trimesh would guess the encoding of text that is not UTF-8, with a further package.
        why = f'{type(error).__name__}: {one_line(str(error), 200)}'
        why = 'its text is not UTF-8' if isinstance(error, ImportError) else why
        # The root of the graph has no children.
        why = 'it has no build item' if error.args == ('world',) else why
        raise PartError(f'{label} is not a readable {mesh_format.upper()} ({why})') from None
    bodies = [SceneBody(name, _joined(meshes)) for name, meshes in sorted(found.items())]
    if not bodies:
        raise PartError(f'{label} has no triangles: expected at least 4, to enclose a volume')
    check_count(sum(len(body.triangles.faces) for body in bodies), label)
    unit = 'm' if mesh_format == 'glb' else _UNITS.get(str(loaded.metadata.get('units')), '')
    if unit not in UNITS:
        raise PartError(
            f'invalid unit {shown(loaded.metadata.get("units"))} in {label}: expected micron, '
            'millimeter, centimeter, inch, foot or meter'
        )
    if len(bodies) > 1:
        volumes = {body.name: _volume(body.triangles) for body in bodies}
        if any(volumes.values()):
            left_out += [shown(body.name) for body in bodies if not volumes[body.name]]
            bodies = [body for body in bodies if volumes[body.name]]
        largest = max(volumes.values()) or 1.0
        bodies.sort(key=lambda body: (-round(volumes[body.name] / largest, 6), body.name))
    return Scene(bodies, unit, left_out)


def _load(data: bytes, mesh_format: str, label: str) -> Any:
    """Return the trimesh scene."""
    import trimesh

    if mesh_format == '3mf':
        try:
            import lxml  # noqa: F401 trimesh reads XML with it
        except ImportError:
            raise PartError(f'{label} is a 3MF, which needs lxml: pip install lxml') from None
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            unpacked = sum(entry.file_size for entry in archive.infolist())
        if unpacked > UNPACKED:
            raise PartError(
                f'{label} has {unpacked} bytes after unpacking: expected at most {UNPACKED}'
            )
        with warnings.catch_warnings():
            # It would ignore everything after the first word that is not a number.
            warnings.filterwarnings('error', 'string or file could not be read')
            return trimesh.load_scene(io.BytesIO(data), file_type='3mf', process=False)
    return trimesh.load_scene(
        io.BytesIO(data), file_type='glb', process=False, skip_materials=True
    )


def _bodies(
    loaded: Any, label: str, *, text: bool
) -> tuple[dict[str, list[Triangles]], list[str]]:
    """Return the meshes of each body of a trimesh scene, and the names of what has no triangles.

    A node of a GLB has a mesh for each material, which trimesh makes children of the node.
    """
    found: dict[str, list[Triangles]] = {}
    left_out = []
    graph = loaded.graph
    for node in sorted(graph.nodes_geometry, key=lambda node: str(graph[node][1])):
        matrix, geometry = graph[node]
        mesh = loaded.geometry[geometry]
        several = mesh.metadata.get('from_gltf_primitive')
        name = str(graph.transforms.parents[node] if several else node)
        if len(getattr(mesh, 'faces', ())):
            found.setdefault(name, []).append(_placed(mesh, matrix, label, text=text))
        else:
            left_out.append(shown(name))
    return found, sorted(left_out)


def _placed(mesh: Any, matrix: Array, label: str, *, text: bool) -> Triangles:
    """Return the triangles of a mesh where its node places it.

    text : whether the file has the coordinates as text, not as float32.
    """
    raw, faces = checked_triangles(
        np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, np.int64), label
    )
    linear = np.asarray(matrix, dtype=np.float64)[:3, :3]
    every = raw[:: max(len(raw) // MAX_ROWS, 1)].tolist()
    words = [[repr(x).encode() for x in row] for row in every] if text else []
    steps = np.abs(linear) @ coordinate_steps(raw, words)
    if np.linalg.det(linear) < 0:
        faces = faces[:, ::-1]
    vertices, faces = checked_triangles(raw @ linear.T + matrix[:3, 3], faces, label)
    return Triangles(vertices, faces, steps)


def _joined(meshes: list[Triangles]) -> Triangles:
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes[:-1])])
    return Triangles(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate([mesh.faces + k for mesh, k in zip(meshes, starts, strict=True)]),
        np.max([mesh.steps for mesh in meshes], axis=0),
    )


def _volume(mesh: Triangles) -> float:
    """Return the volume, or 0 if the surface is not closed."""
    surface = closed_surface(mesh.vertices, mesh.faces)
    if surface.defect:
        return 0.0
    corners = surface.vertices[surface.faces] - surface.vertices[0]
    return abs(float(np.linalg.det(corners).sum())) / 6
