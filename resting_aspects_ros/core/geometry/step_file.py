"""Convert the solids of a STEP file to a GLB: the only module that uses cascadio.

cascadio is Open CASCADE. It runs in a process of its own, because it prints on standard output,
and because a damaged file can crash it or keep it busy.
"""

import io
import subprocess
import sys
from collections.abc import Iterator
from typing import Any

import numpy as np
import trimesh

from resting_aspects_ros.core.errors import PartError
from resting_aspects_ros.core.geometry.mesh_file import check_count
from resting_aspects_ros.core.geometry.step_solids import (
    Array,
    Indices,
    StepItems,
    solid_triangles,
)

STEP_FORMATS = ('step', 'stp')
# Maximum distance between a curved surface and its triangles, mm, and maximum angle between
# neighbouring triangles on it, rad. The others are tried if the triangles of a solid leave gaps.
DEVIATIONS = ((0.01, 0.1), (0.005, 0.08), (0.02, 0.15), (0.002, 0.05), (0.05, 0.25), (0.01, 0.4))
MAX_SECONDS = 300  # of processor time for a conversion

_CONVERT = """
import sys
sys.path[:] = sys.argv[4:]
sys.modules['trimesh'] = None  # cascadio imports it if it can, which takes a second
import os, resource
result = os.dup(1)
os.dup2(2, 1)
limit = int(sys.argv[3])
resource.setrlimit(resource.RLIMIT_CPU, (limit, limit))
resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
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
        for name, vertices, faces, whole in _bodies(found, items):
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


def _bodies(scene: Any, items: StepItems) -> Iterator[tuple[str, Array, Indices, bool]]:
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
