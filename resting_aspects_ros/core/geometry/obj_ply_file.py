"""Read the triangles of an OBJ or PLY file with trimesh, after checks that trimesh does not make.

trimesh stops reading at the first word that is not a number, without an error, so the text is
checked first.
"""

import io
import logging
import re

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.errors import PartError, one_line, shown

Vertices = npt.NDArray[np.float64]
Faces = npt.NDArray[np.int64]

# Without a handler, Python prints the warnings of trimesh on standard error.
logging.getLogger('trimesh').addHandler(logging.NullHandler())

_NUMBER = rb'[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?'
_CORNER = rb'-?[1-9]\d*(?:/-?\d*){0,2}'
_INVALID_OBJ_LINE = re.compile(
    rb'^(?:v[ \t]+(?!' + _NUMBER + rb'(?:[ \t]+' + _NUMBER + rb'){2,}[ \t]*$)'
    rb'|f[ \t]+(?!' + _CORNER + rb'(?:[ \t]+' + _CORNER + rb'){2,}[ \t]*$))[^\n]*',
    re.MULTILINE,
)
_INVALID_NUMBER = re.compile(rb'(?<!\S)(?!' + _NUMBER + rb'(?!\S))\S+')


def read_obj(data: bytes, label: str) -> tuple[Vertices, Faces]:
    """Return the vertices and faces of an OBJ file."""
    return _read_with_trimesh(_checked_obj(data, label), 'obj', label)


def read_ply(data: bytes, label: str) -> tuple[Vertices, Faces]:
    """Return the vertices and faces of a PLY file."""
    return _read_with_trimesh(_checked_ply(data, label), 'ply', label)


def _checked_obj(data: bytes, label: str) -> bytes:
    """Return the vertex and face lines of an OBJ; raise PartError for a line that is invalid.

    Also rejects relative vertex numbers before the last vertex: they count from the end of the
    vertices that precede them, but trimesh counts from the end of all vertices.
    """
    if b'\0' in data:
        raise PartError(f'{label} is not an OBJ: it is binary, and an OBJ is text')
    data = data.decode('utf-8', errors='replace').encode().replace(b'\r\n', b'\n')
    data = re.sub(rb'#[^\n]*', b'', data.replace(b'\\\n', b''))
    data = re.sub(rb'^ ', b'', re.sub(rb'[ \t]+', b' ', data), flags=re.MULTILINE)
    broken = _INVALID_OBJ_LINE.search(data)
    if broken:
        raise PartError(
            f'{label} is a broken OBJ: it has the line {_shown(broken)}, expected three finite '
            'numbers for a vertex (v) and at least three vertex numbers from 1 for a face (f)'
        )
    relative = re.search(rb'^f[^\n]*[ \t]-\d', data, re.MULTILINE)
    if relative and data.rfind(b'\nv ') > relative.start():
        raise PartError(
            f'{label} has relative vertex numbers before its last vertex, as in '
            f'{_shown(relative)}: expected absolute vertex numbers'
        )
    # trimesh makes a mesh for each material, which is slow, and needs pillow for textures.
    data = b'\n'.join(re.findall(rb'^[vf] [^\n]*', data, re.MULTILINE))
    return re.sub(rb'(?<=\d)/[-/\d]*', b'', data)


def _checked_ply(data: bytes, label: str) -> bytes:
    """Return the PLY without elements that trimesh need not read; raise PartError if broken."""
    end = re.search(rb'^end_header', data, re.MULTILINE)
    if not data.startswith(b'ply') or not end:
        raise PartError(f"{label} is not a PLY: it has no header from 'ply' to 'end_header'")
    header, body = data[: end.start()], data[end.end() :]
    # A comment with the words "end_header" would end the header for trimesh.
    header = re.sub(rb'^(comment|obj_info)[^\n]*\n', b'', header, flags=re.MULTILINE)
    header = header.decode('ascii', errors='replace').encode('ascii', errors='replace')
    # trimesh would convert edges to a path, which can take minutes. It ignores unknown elements.
    header = re.sub(rb'^element[ \t]+edge', b'element unused', header, flags=re.MULTILINE)
    if re.search(rb'^format[ \t]+ascii', header, re.MULTILINE):
        counts = re.findall(rb'^element[ \t]+\S+[ \t]+(\d{1,18})\b', header, re.MULTILINE)
        declared, rows = sum(map(int, counts)), len(body.strip().splitlines())
        if rows < declared:
            raise PartError(
                f'{label} is truncated: its header declares {declared} rows (vertices and '
                f'faces), and there are {rows}'
            )
        broken = _INVALID_NUMBER.search(body)
        if broken:
            raise PartError(
                f'{label} is a broken PLY: it has {_shown(broken)} in its rows, expected finite '
                'numbers'
            )
    return header + end[0] + body


def _shown(match: re.Match[bytes]) -> str:
    return shown(match[0][:200].decode(errors='replace'))


def _read_with_trimesh(data: bytes, mesh_format: str, label: str) -> tuple[Vertices, Faces]:
    import trimesh  # takes half of the start time of a command; most parts are STL

    try:
        with np.errstate(all='ignore'):
            mesh = trimesh.load_mesh(
                io.BytesIO(data), file_type=mesh_format, process=False, skip_materials=True
            )
            vertices = np.asarray(mesh.vertices, dtype=np.float64).reshape(-1, 3)
            faces = np.asarray(mesh.faces, dtype=np.int64).reshape(-1, 3)
    except Exception as error:  # noqa: BLE001 its parsers raise exceptions of any type
        hint = (
            '; it is truncated, or has faces with different numbers of corners, which only an '
            'ASCII PLY may have'
            if 'unexpected length' in str(error)
            else ''
        )
        raise PartError(
            f'{label} is not a readable {mesh_format.upper()} '
            f'({type(error).__name__}: {one_line(str(error), 200)}){hint}'
        ) from None
    return vertices, faces
