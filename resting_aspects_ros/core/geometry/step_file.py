"""Triangles of a STEP file: the only module that imports cascadio, an optional dependency."""

import io

import trimesh

from resting_aspects_ros.core.errors import PartError

STEP_FORMATS = ('step', 'stp')
# Maximum distance between a curved surface and its triangles, in the unit of the file, and maximum
# angle between neighbouring triangles on it, rad.
MAX_DISTANCE, MAX_ANGLE = 0.01, 0.1
# The reader converts the unit of the file to metres.
PER_METRE = 1000.0


def stl_from_step(data: bytes, label: str) -> bytes:
    """Return the solids of a STEP file as a binary STL in mm; raises PartError."""
    try:
        import cascadio
    except ImportError:
        raise PartError(
            f'{label} is a STEP file, which needs cascadio: pip install cascadio, or export an '
            'STL from your CAD program'
        ) from None
    if b'ISO-10303-21' not in data[:1000]:
        raise PartError(f'{label} is not a STEP file: expected ISO-10303-21 at its beginning')
    # Parallel meshing could change the order of the triangles, and with it the bytes.
    found = cascadio.load(
        data, 'step', tol_linear=MAX_DISTANCE, tol_angular=MAX_ANGLE, use_parallel=False
    )
    scene = trimesh.load_scene(io.BytesIO(found), file_type='glb') if found else None
    if scene is None or not scene.geometry:
        raise PartError(f'{label} cannot be read: expected a STEP file with a solid')
    mesh = scene.to_mesh()
    mesh.apply_scale(PER_METRE)
    exported = mesh.export(file_type='stl')
    assert isinstance(exported, bytes)
    return exported
