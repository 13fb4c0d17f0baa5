"""Reading the bytes of a mesh file (STL, OBJ, PLY) into triangles, with errors that help.

trimesh parses; what is done here is what it does not do: say how a file is broken. ASCII STL is
parsed here, because trimesh drops a solid without ``endsolid`` and stops at the first word that
is not a number, both without an error.
"""

import io
import logging
import re
import struct

import numpy as np
import numpy.typing as npt
import trimesh

from resting_aspects_ros.core.errors import PartError

FORMATS = ('stl', 'obj', 'ply')

Vertices = npt.NDArray[np.float64]
Faces = npt.NDArray[np.int64]

# Without a handler, Python prints the warnings of trimesh's logger on standard error.
logging.getLogger('trimesh').addHandler(logging.NullHandler())

_STL_HEADER = 84  # 80 bytes of anything, then the number of triangles
_STL_TRIANGLE = 50  # normal and three corners in float32, two bytes of attributes
_NUMBERS = rb'[ \t]+(\S+)[ \t]+(\S+)[ \t]+(\S+)[ \t]*$'
_STL_VERTEX = re.compile(rb'^[ \t]*vertex' + _NUMBERS, re.IGNORECASE | re.MULTILINE)


def read_triangles(data: bytes, mesh_format: str, label: str) -> tuple[Vertices, Faces]:
    """Return the triangles in the bytes of a mesh file, as they are in the file.

    Parameters
    ----------
    data : bytes
        All bytes of the file.
    mesh_format : str
        One of FORMATS.
    label : str
        What the file is called in errors.

    Returns
    -------
    vertices : (n, 3) float64
        In the file's unit; finite; each one is a corner of a triangle.
    faces : (m, 3) int64
        Rows of ``vertices``; at least one.

    Raises
    ------
    PartError
        The bytes are not a whole mesh of that format with finite vertices.
    """
    if not data:
        raise PartError(f'{label} is empty (0 bytes): a mesh as {_or(FORMATS)} is needed')
    if mesh_format == 'stl':
        vertices, faces = _read_stl(data, label)
    elif mesh_format in FORMATS:
        if mesh_format == 'obj':
            _check_obj(data, label)
        elif mesh_format == 'ply':
            _check_ply(data, label)
        vertices, faces = _read_with_trimesh(data, mesh_format, label)
    else:
        raise PartError(f'{label} has the format {mesh_format!r}: allowed are {_or(FORMATS)}')
    if not len(faces):
        raise PartError(f'{label} has no triangles: at least 4 are needed to enclose a volume')
    stray = faces[(faces < 0) | (faces >= len(vertices))]
    if len(stray):
        raise PartError(f'{label} has a triangle whose corner is vertex number {stray[0]}: '
                        f'allowed are 0 to {len(vertices) - 1}')
    used, corners = np.unique(faces, return_inverse=True)
    return _finite(vertices[used], label), corners.reshape(-1, 3)


def _read_stl(data: bytes, label: str) -> tuple[Vertices, Faces]:
    """Tell binary from ASCII by the length first: binary headers may begin with 'solid' too."""
    promised = struct.unpack_from('<I', data, 80)[0] if len(data) >= _STL_HEADER else -1
    held = (len(data) - _STL_HEADER) // _STL_TRIANGLE
    if promised > 0 and len(data) == _STL_HEADER + promised * _STL_TRIANGLE:
        return _read_with_trimesh(data, 'stl', label)
    text = data.removeprefix(b'\xef\xbb\xbf').lstrip()
    if b'\0' not in data:
        if text[:5].lower() == b'solid':
            return _read_ascii_stl(text, label)
        raise PartError(f'{label} is not an STL: it is neither binary nor text that begins with '
                        f"'solid', but begins with {data[:20]!r}")
    if promised < 0:
        raise PartError(f'{label} is not an STL: it has {len(data)} bytes, and a binary STL '
                        f'has at least {_STL_HEADER}')
    if promised > held:
        raise PartError(f'{label} is shorter than its header says: it promises {promised} '
                        f'triangles and there are {held}; the file is cut off, or not an STL')
    # Some programs write padding behind the last triangle.
    return _read_with_trimesh(data[:_STL_HEADER + promised * _STL_TRIANGLE], 'stl', label)


def _read_ascii_stl(text: bytes, label: str) -> tuple[Vertices, Faces]:
    text = text.replace(b'\r\n', b'\n').replace(b'\r', b'\n')
    lines = {word: _count_lines(word, text)
             for word in (b'solid', b'endsolid', b'facet', b'endfacet', b'vertex')}
    corners = _STL_VERTEX.findall(text)
    if lines[b'solid'] != lines[b'endsolid']:
        raise PartError(f"{label} is cut off: it has {lines[b'solid']} 'solid' and "
                        f"{lines[b'endsolid']} 'endsolid', which must be as many")
    if not lines[b'facet'] == lines[b'endfacet'] == lines[b'vertex'] / 3 == len(corners) / 3:
        raise PartError(f"{label} is a broken ASCII STL: {lines[b'facet']} 'facet', "
                        f"{lines[b'endfacet']} 'endfacet' and {len(corners)} corners with three "
                        'numbers, where each facet needs one end and three corners')
    try:
        vertices = np.array(corners, dtype=np.bytes_).reshape(-1, 3).astype(np.float64)
    except ValueError as error:
        raise PartError(f'{label} is a broken ASCII STL: {error}') from None
    return vertices, np.arange(len(vertices), dtype=np.int64).reshape(-1, 3)


def _count_lines(word: bytes, text: bytes) -> int:
    return len(re.findall(rb'^[ \t]*' + word + rb'\b', text, re.IGNORECASE | re.MULTILINE))


def _check_obj(data: bytes, label: str) -> None:
    """Refuse what trimesh reads wrongly: relative indices count from the vertices so far."""
    relative = re.search(rb'^f[^\n]*[ \t]-\d', data, re.MULTILINE)
    if relative and data.rfind(b'\nv ') > relative.start():
        raise PartError(f'{label} has relative indices ({relative[0].decode(errors="replace")!r}) '
                        'between its vertices: only absolute ones are allowed there')


def _check_ply(data: bytes, label: str) -> None:
    """Refuse a short ASCII PLY, which trimesh reads as far as it goes."""
    header, end, body = data.partition(b'end_header')
    if not header.startswith(b'ply') or not end:
        raise PartError(f"{label} is not a PLY: it has no header from 'ply' to 'end_header'")
    counts = [int(count) for count in re.findall(rb'^element[ \t]+\S+[ \t]+(\d+)', header, re.M)]
    rows = len(body.split(b'\n', 1)[-1].splitlines())
    if re.search(rb'^format[ \t]+ascii', header, re.MULTILINE) and rows < sum(counts):
        raise PartError(f'{label} is shorter than its header says: it promises {sum(counts)} '
                        f'rows (vertices and faces) and there are {rows}')


def _read_with_trimesh(data: bytes, mesh_format: str, label: str) -> tuple[Vertices, Faces]:
    try:
        with np.errstate(all='ignore'):
            mesh = trimesh.load_mesh(io.BytesIO(data), file_type=mesh_format, process=False,
                                     skip_materials=True)
            vertices = np.asarray(mesh.vertices, dtype=np.float64).reshape(-1, 3)
            faces = np.asarray(mesh.faces, dtype=np.int64).reshape(-1, 3)
    except Exception as error:  # noqa: BLE001 its parsers raise whatever they stumble over
        raise PartError(f'{label} is not a readable {mesh_format.upper()} '
                        f'({type(error).__name__}: {str(error)[:200]})') from None
    return vertices, faces


def _finite(vertices: Vertices, label: str) -> Vertices:
    bad = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
    if len(bad):
        raise PartError(f'{label} has {len(bad)} vertices that are not finite, the first one '
                        f'number {bad[0]}: {vertices[bad[0]].tolist()}; all must be finite')
    return vertices


def _or(words: tuple[str, ...]) -> str:
    return ' or '.join((', '.join(words[:-1]), words[-1]))
