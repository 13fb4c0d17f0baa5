"""Read the bodies of a GLB or 3MF file, or the solids of a STEP file, with names and places."""

import io
import re
import subprocess
import sys
import warnings
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import trimesh

from resting_aspects_ros.arrays import Array, Indices
from resting_aspects_ros.errors import InvalidValueError, PartError, one_line, shown
from resting_aspects_ros.part.mesh_files import (
    MAX_ROWS,
    Triangles,
    check_count,
    checked_triangles,
    coordinate_steps,
)
from resting_aspects_ros.part.part import UNITS, box_text, listed
from resting_aspects_ros.part.surface import (
    WELD,
    TriangleEdges,
    closed_surface,
    connected,
    triangle_edges,
    weld_groups,
)

UNPACKED = 256 << 20  # maximum size of the files in a 3MF, bytes
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
        raise InvalidValueError(
            f'invalid body {shown(chosen)} of {label}: expected 1 to {len(names)}, or one of '
            f'{listed(list(map(shown, names)))}'
        )

    def triangles(self, number: int) -> Triangles:
        """Return the triangles of a body, or of all bodies for 0."""
        if number:
            return self.bodies[number - 1].triangles
        return _joined([body.triangles for body in self.bodies])

    @cached_property
    def texts(self) -> tuple[str, ...]:
        """Number, name and size of each body."""
        return tuple(
            f'{k}: {shown(body.name)} '
            f'{box_text(np.ptp(body.triangles.vertices, axis=0), self.unit)}'
            for k, body in enumerate(self.bodies, 1)
        )


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
    if mesh_format == '3mf':
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


# -- Solids of a STEP file ------------------------------------------------------------------------


SOLIDS = ('MANIFOLD_SOLID_BREP', 'BREP_WITH_VOIDS', 'FACETED_BREP')
# Edges that are followed to separate solids that touch, after which the rest is left out.
MAX_WORK = 10_000_000
# Items of a representation that have no shape of their own.
PLACES = ('AXIS2_PLACEMENT_3D', 'MAPPED_ITEM', 'CARTESIAN_POINT')

_TEXT = rb"'((?:[^']|'')*)'"
_REPRESENTATION = re.compile(
    rb'=\s*\w*SHAPE_REPRESENTATION\s*\(\s*' + _TEXT + rb'\s*,\s*\(([\s,#\d]*)\)'
)
_DIRECTIVE = re.compile(
    r'\\\\|\\X2\\((?:[0-9A-Fa-f]{4})+)\\X0\\|\\X4\\((?:[0-9A-Fa-f]{8})+)\\X0\\|\\X\\([0-9A-Fa-f]{2})'
)
_ENTITY = re.compile(rb'#(\d+)\s*=\s*(\w+)\s*\(\s*(?:' + _TEXT + rb')?')


@dataclass(frozen=True)
class StepItems:
    """The items of the shapes in the text of a STEP file.

    solids : the names of the solids of each shape, empty for a solid without a name
    left_out : kind and name of each other item
    """

    solids: list[list[str]]
    left_out: list[str]

    @classmethod
    def of(cls, data: bytes) -> 'StepItems':
        """Return the items in the bytes of a STEP file."""
        shapes = [re.findall(rb'#(\d+)', found[1]) for found in _REPRESENTATION.findall(data)]
        wanted = {number for numbers in shapes for number in numbers}
        items = {
            number: (kind.decode().upper(), _decoded(name.decode(errors='replace')))
            for number, kind, name in _ENTITY.findall(data)
            if number in wanted
        }
        solids, left_out = [], []
        for numbers in shapes:
            found = [items[number] for number in numbers if number in items]
            solids.append([name for kind, name in found if kind in SOLIDS])
            left_out += [
                kind.lower().replace('_', ' ') + (f' {name!r}' if name else '')
                for kind, name in found
                if kind not in (*SOLIDS, *PLACES)
            ]
        return cls([names for names in solids if names], left_out)

    def names(self, count: int) -> list[str]:
        """Return the names of the solids of a shape with several; empty if they are not known."""
        fitting = [names for names in self.solids if len(names) == count]
        if count == 1 or len(fitting) != 1 or not all(fitting[0]):
            return []
        return fitting[0]

    def missing(self, found: int, others: int) -> int:
        """Return how many solids are missing among those found, with other triangles left."""
        surfaces = any('surface' in kind or 'shell' in kind for kind in self.left_out)
        expected = sum(map(len, self.solids))
        if not others or (surfaces and found >= expected):
            return 0
        return max(expected - found, 1)


def _decoded(text: str) -> str:
    r"""Return a text of a STEP file without the directives \X\, \X2\ and \X4\ of ISO 10303-21."""

    def character(found: re.Match[str]) -> str:
        two, four, byte = found.groups()
        if byte:
            return chr(int(byte, 16))
        if two or four:
            codec = 'utf-16-be' if two else 'utf-32-be'
            return bytes.fromhex(two or four).decode(codec, 'replace')
        return '\\'

    return _DIRECTIVE.sub(character, text.replace("''", "'"))


def solid_triangles(
    vertices: Array, triangles: Indices, face: Indices
) -> tuple[list[Indices], Indices]:
    """Return the rows of the triangles of each solid, and those of no solid.

    The faces of a solid follow each other, so a solid ends where all edges of its triangles are
    used equally often in both directions. A shell that faces inward is a cavity of the solid
    before it.

    Parameters
    ----------
    vertices : (n, 3) float64
    triangles : (m, 3) int64
    face : (m,) int64
        The number of the face of the solid that each triangle is on.
    """
    size = float(np.ptp(vertices, axis=0).max()) / 2
    a, b, c = corners = weld_groups(vertices, WELD * size)[1][triangles].T
    kept = np.flatnonzero((a != b) & (b != c) & (c != a))
    kept = kept[np.argsort(face[kept], kind='stable')]
    edges = triangle_edges(corners.T[kept])
    component = _linked_by_edges(edges, face[kept])
    shells: list[Indices] = []
    rest: list[Indices] = [kept[:0]]
    for rows in np.split(np.argsort(component, kind='stable'), _starts(np.sort(component))):
        closed, other = _closed_shells(rows, edges, face[kept])
        shells += [kept[shell] for shell in closed]
        rest.append(kept[other])
    solids: list[Indices] = []
    for shell in sorted(shells, key=lambda rows: int(face[rows].min())):
        points = vertices[triangles[shell]] - vertices[triangles[shell[0], 0]]
        if solids and np.linalg.det(points).sum() < 0:
            solids[-1] = np.concatenate([solids[-1], shell])
        else:
            solids.append(shell)
    return solids, np.concatenate(rest)


def _starts(numbers: Indices) -> Indices:
    """Return where a new number begins in sorted numbers, except at the beginning."""
    return np.flatnonzero(np.diff(numbers)) + 1


def _linked_by_edges(edges: TriangleEdges, face: Indices) -> Indices:
    """Return for each triangle the number of the component of faces that share edges."""
    pairs = np.stack([np.repeat(face, 3), face.max(initial=0) + 1 + edges.number], axis=1)
    return connected(int(pairs.max(initial=-1)) + 1, pairs)[face]


def _closed_shells(
    rows: Indices, edges: TriangleEdges, face: Indices
) -> tuple[list[Indices], Indices]:
    """Return the closed shells among triangles, sorted by their faces, and the other triangles."""
    uses = (3 * rows[:, None] + np.arange(3)).ravel()
    number, direction = edges.number[uses], edges.direction[uses]
    twice = bool((np.bincount(number)[number] == 2).all())
    if twice and not np.bincount(number, weights=direction).any():
        return [rows], rows[:0]
    faces = np.split(rows, _starts(face[rows]))
    steps = [
        list(zip(n.tolist(), d.tolist(), strict=True))
        for n, d in (
            (edges.number.reshape(-1, 3)[f].ravel(), edges.direction.reshape(-1, 3)[f].ravel())
            for f in faces
        )
    ]
    shells: list[Indices] = []
    others: list[Indices] = [rows[:0]]
    start, work = 0, 0
    while start < len(faces):
        balance: dict[int, int] = {}
        for end in range(start, len(faces) if work < MAX_WORK else start):
            for edge, way in steps[end]:
                balance[edge] = balance.get(edge, 0) + way
                if not balance[edge]:
                    del balance[edge]
            work += len(steps[end])
            if not balance:
                shells.append(np.concatenate(faces[start : end + 1]))
                start = end + 1
                break
        else:
            others.append(faces[start])
            start += 1
    return shells, np.concatenate(others)


# -- STEP files -----------------------------------------------------------------------------------


# Maximum distance between a curved surface and its triangles, mm, and maximum angle between
# neighbouring triangles on it, rad. The others are tried if the triangles of a solid leave gaps.
DEVIATIONS = ((0.01, 0.1), (0.005, 0.08), (0.02, 0.15), (0.002, 0.05), (0.05, 0.25), (0.01, 0.4))
MAX_SECONDS = 300  # of processor time for a conversion

_CONVERT = """
import sys
sys.path[:] = sys.argv[4:]
sys.modules['trimesh'] = None  # cascadio imports it if it can, which takes a second
import os
result = os.dup(1)
os.dup2(2, 1)
limit = int(sys.argv[3])
try:
    import resource
    resource.setrlimit(resource.RLIMIT_CPU, (limit, limit))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
except ImportError:
    pass  # Windows
import cascadio
# Parallel meshing could change the order of the triangles, and with it the bytes.
found = cascadio.load(
    sys.stdin.buffer.read(), 'step', tol_linear=float(sys.argv[1]), tol_angular=float(sys.argv[2]),
    use_parallel=False, include_brep=True,
)
with os.fdopen(result, 'wb') as file:
    file.write(found)
"""


def glb_from_step(data: bytes, label: str) -> tuple[bytes, list[str]]:
    """Return the solids of a STEP file as a GLB, and the names of what is left out.

    Each solid is a node with a name of its own. Raises PartError.
    """
    try:
        import cascadio  # noqa: F401 trimesh then reads which face a triangle is from
    except ImportError:
        raise PartError(
            f'{label} is a STEP file, which needs cascadio: pip install cascadio, or export an '
            'STL from your CAD program'
        ) from None
    if b'ISO-10303-21' not in data[:1000]:
        raise PartError(f'{label} is not a STEP file: expected ISO-10303-21 at its beginning')
    items = StepItems.of(data)
    for deviations in DEVIATIONS:
        found = trimesh.load_scene(
            io.BytesIO(_converted(data, deviations, label)), file_type='glb', process=False
        )
        check_count(sum(len(mesh.faces) for mesh in found.geometry.values()), label)
        scene: Any = trimesh.Scene()
        others = 0
        for name, vertices, faces, whole in _solid_bodies(found, items):
            others += not whole
            if whole:
                mesh = trimesh.Trimesh(vertices, faces, process=False)
                scene.add_geometry(mesh, node_name=name, geom_name=name)
        missing = items.missing(len(scene.geometry), others)
        if not missing:
            break
    if missing:
        raise PartError(
            f'{label} has {missing} solids that are not closed: their triangles leave gaps with '
            'every tessellation that was tried; repair the solid in the CAD program, or export an '
            'STL'
        )
    if not scene.geometry:
        raise PartError(f'{label} has no solid: expected a STEP file with a solid')
    exported = scene.export(file_type='glb')
    assert isinstance(exported, bytes)
    return exported, items.left_out


def _converted(data: bytes, deviations: tuple[float, float], label: str) -> bytes:
    """Return the faces of a STEP file as a GLB; each triangle has the number of its face."""
    arguments = [*map(str, deviations), str(MAX_SECONDS), *sys.path]
    done = subprocess.run(
        [sys.executable, '-c', _CONVERT, *arguments], input=data, capture_output=True, check=False
    )
    if not done.stdout or done.returncode:
        signal = -done.returncode
        reason = f' (Open CASCADE was ended by signal {signal})' if signal > 0 else ''
        raise PartError(
            f'{label} cannot be read{reason}: expected a complete STEP file with a solid; export '
            'it again, or export an STL from your CAD program'
        )
    return done.stdout


def _solid_bodies(scene: Any, items: StepItems) -> Iterator[tuple[str, Array, Indices, bool]]:
    """Yield name, vertices, triangles of each solid where it is, and whether it is closed."""
    used: set[str] = set()
    for node in sorted(scene.graph.nodes_geometry):
        matrix, geometry = scene.graph[node]
        mesh = scene.geometry[geometry]
        vertices = np.asarray(mesh.vertices) @ matrix[:3, :3].T + matrix[:3, 3]
        faces = np.asarray(mesh.faces, dtype=np.int64)
        if np.linalg.det(matrix[:3, :3]) < 0:
            faces = faces[:, ::-1]
        numbers = np.asarray(mesh.face_attributes['brep_index'], dtype=np.int64)
        solids, rest = solid_triangles(vertices, faces, numbers)
        names = items.names(len(solids)) or [str(node)] * len(solids)
        for name, rows in zip(names, solids, strict=True):
            unique = trimesh.util.unique_name(name, used)
            used.add(unique)
            yield unique, vertices, faces[rows], True
        if len(rest):
            yield '', vertices, faces[rest], False
