"""Reading the bytes of a mesh file (STL, OBJ, PLY) into triangles, with errors that help.

trimesh parses OBJ and PLY; what is done here is what it does not do: say how a file is broken.
Text is checked before, because trimesh stops at the first word that is not a number, without an
error. STL is parsed here: the binary form is one array, and of ASCII trimesh drops a solid without
``endsolid``, and stumbles over names of solids in which its keywords occur. No expression here
looks at a character more than a few times, whatever the input.
"""

import io
import itertools
import logging
import re
import struct

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.errors import PartError, one_line, shown

FORMATS = ('stl', 'obj', 'ply')
# More take minutes and gigabytes, and change no aspect.
MAX_TRIANGLES = 1_000_000

Vertices = npt.NDArray[np.float64]
Faces = npt.NDArray[np.int64]

# Without a handler, Python prints the warnings of trimesh's logger on standard error.
logging.getLogger('trimesh').addHandler(logging.NullHandler())

_STL_HEADER = 84  # 80 bytes of anything, then the number of triangles
# Normal and three corners in float32, two bytes of attributes.
_STL_ROW = np.dtype([('normal', '<f4', 3), ('corners', '<f4', (3, 3)), ('attributes', '<u2')])
_STL_TRIANGLE = _STL_ROW.itemsize
_STL_VERTEX = re.compile(
    rb'^[ \t]*vertex[ \t]+(\S+)[ \t]+(\S+)[ \t]+(\S+)[ \t]*$', re.IGNORECASE | re.MULTILINE
)

_NUMBER = rb'[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?'
_CORNER = rb'-?[1-9]\d*(?:/-?\d*){0,2}'
_NO_OBJ_LINE = re.compile(
    rb'^(?:v[ \t]+(?!' + _NUMBER + rb'(?:[ \t]+' + _NUMBER + rb'){2,}[ \t]*$)'
    rb'|f[ \t]+(?!' + _CORNER + rb'(?:[ \t]+' + _CORNER + rb'){2,}[ \t]*$))[^\n]*',
    re.MULTILINE,
)
_NO_NUMBER = re.compile(rb'(?<!\S)(?!' + _NUMBER + rb'(?!\S))\S+')


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
        checked = _checked_obj if mesh_format == 'obj' else _checked_ply
        vertices, faces = _read_with_trimesh(checked(data, label), mesh_format, label)
    else:
        raise PartError(f'{label} has the format {shown(mesh_format)}: allowed are {_or(FORMATS)}')
    if not len(faces):
        raise PartError(f'{label} has no triangles: at least 4 are needed to enclose a volume')
    _check_count(len(faces), label)
    stray = faces[(faces < 0) | (faces >= len(vertices))]
    if len(stray):
        raise PartError(
            f'{label} has a triangle whose corner is vertex number {stray[0]}: '
            f'allowed are 0 to {len(vertices) - 1}'
        )
    used, corners = np.unique(faces, return_inverse=True)
    return _finite(vertices[used], label), corners.reshape(-1, 3)


def _check_count(triangles: int, label: str) -> None:
    if triangles > MAX_TRIANGLES:
        raise PartError(
            f'{label} has {triangles} triangles: expected at most {MAX_TRIANGLES}; simplify the '
            'mesh, or export it with a coarser tolerance (100000 triangles are plenty)'
        )


def _read_stl(data: bytes, label: str) -> tuple[Vertices, Faces]:
    """Tell binary from ASCII by the length first: binary headers may begin with 'solid' too."""
    promised = struct.unpack_from('<I', data, 80)[0] if len(data) >= _STL_HEADER else -1
    held = (len(data) - _STL_HEADER) // _STL_TRIANGLE
    if promised > 0 and len(data) == _STL_HEADER + promised * _STL_TRIANGLE:
        return _read_binary_stl(data, promised, label)
    text = data.removeprefix(b'\xef\xbb\xbf').lstrip()
    if b'\0' not in data:
        if text[:5].lower() == b'solid':
            return _read_ascii_stl(text, label)
        raise PartError(
            f'{label} is not an STL: it is neither binary nor text that begins with '
            f"'solid', but begins with {shown(data[:20])}"
        )
    if promised < 0:
        raise PartError(
            f'{label} is not an STL: it has {len(data)} bytes, and a binary STL '
            f'has at least {_STL_HEADER}'
        )
    if promised > held:
        raise PartError(
            f'{label} is shorter than its header says: it promises {promised} '
            f'triangles and there are {held}; the file is cut off, or not an STL'
        )
    # Some programs write padding behind the last triangle.
    return _read_binary_stl(data, promised, label)


def _read_binary_stl(data: bytes, count: int, label: str) -> tuple[Vertices, Faces]:
    _check_count(count, label)
    rows = np.frombuffer(data, dtype=_STL_ROW, count=count, offset=_STL_HEADER)
    with np.errstate(invalid='ignore'):  # a nan that signals becomes a quiet one
        vertices = rows['corners'].reshape(-1, 3).astype(np.float64)
    return vertices, np.arange(3 * count, dtype=np.int64).reshape(-1, 3)


def _read_ascii_stl(text: bytes, label: str) -> tuple[Vertices, Faces]:
    text = text.replace(b'\r\n', b'\n').replace(b'\r', b'\n')
    lines = {
        word: _count_lines(word, text)
        for word in (b'solid', b'endsolid', b'facet', b'endfacet', b'vertex')
    }
    _check_count(lines[b'facet'], label)
    corners = _STL_VERTEX.findall(text)
    if lines[b'solid'] != lines[b'endsolid']:
        raise PartError(
            f"{label} is cut off: it has {lines[b'solid']} 'solid' and "
            f"{lines[b'endsolid']} 'endsolid', which must be as many"
        )
    if not lines[b'facet'] == lines[b'endfacet'] == lines[b'vertex'] / 3 == len(corners) / 3:
        raise PartError(
            f"{label} is a broken ASCII STL: {lines[b'facet']} 'facet', "
            f"{lines[b'endfacet']} 'endfacet' and {len(corners)} corners with three "
            'numbers, where each facet needs one end and three corners'
        )
    try:
        words = map(float, itertools.chain.from_iterable(corners))
        vertices = np.fromiter(words, dtype=np.float64, count=3 * len(corners)).reshape(-1, 3)
    except ValueError as error:
        word = str(error).rpartition(': b')[2]
        raise PartError(
            f'{label} is a broken ASCII STL: it has {one_line(word, 80)} as a coordinate, where '
            'only numbers are allowed'
        ) from None
    return vertices, np.arange(len(vertices), dtype=np.int64).reshape(-1, 3)


def _count_lines(word: bytes, text: bytes) -> int:
    return len(re.findall(rb'^[ \t]*' + word + rb'\b', text, re.IGNORECASE | re.MULTILINE))


def _checked_obj(data: bytes, label: str) -> bytes:
    """Refuse what trimesh reads as far as it goes, and relative indices between the vertices.

    It takes those from the end of all vertices; they count from the end of those so far.
    """
    if b'\0' in data:
        raise PartError(f'{label} is not an OBJ: it is binary, and an OBJ is text')
    data = data.decode('utf-8', errors='replace').encode().replace(b'\r\n', b'\n')
    data = re.sub(rb'#[^\n]*', b'', data.replace(b'\\\n', b''))
    data = re.sub(rb'^ ', b'', re.sub(rb'[ \t]+', b' ', data), flags=re.MULTILINE)
    broken = _NO_OBJ_LINE.search(data)
    if broken:
        raise PartError(
            f'{label} is a broken OBJ: a line is {_shown(broken)}, where a vertex (v) '
            'has three finite numbers and a face (f) at least three vertex numbers, '
            'from 1 on'
        )
    relative = re.search(rb'^f[^\n]*[ \t]-\d', data, re.MULTILINE)
    if relative and data.rfind(b'\nv ') > relative.start():
        raise PartError(
            f'{label} has relative vertex numbers between its vertices, as in '
            f'{_shown(relative)}: only absolute ones are allowed there'
        )
    # trimesh makes a mesh of each material, which takes long, and needs pillow for textures.
    data = b'\n'.join(re.findall(rb'^[vf] [^\n]*', data, re.MULTILINE))
    return re.sub(rb'(?<=\d)/[-/\d]*', b'', data)


def _checked_ply(data: bytes, label: str) -> bytes:
    """Refuse a broken ASCII PLY, which trimesh reads as far as it goes."""
    end = re.search(rb'^end_header', data, re.MULTILINE)
    if not data.startswith(b'ply') or not end:
        raise PartError(f"{label} is not a PLY: it has no header from 'ply' to 'end_header'")
    header, body = data[: end.start()], data[end.end() :]
    # trimesh takes any line with these words for the end.
    header = re.sub(rb'^(comment|obj_info)[^\n]*\n', b'', header, flags=re.MULTILINE)
    header = header.decode('ascii', errors='replace').encode('ascii', errors='replace')
    # trimesh would make a path of edges, for minutes if they are long. It ignores unknown names.
    header = re.sub(rb'^element[ \t]+edge', b'element unused', header, flags=re.MULTILINE)
    if re.search(rb'^format[ \t]+ascii', header, re.MULTILINE):
        counts = re.findall(rb'^element[ \t]+\S+[ \t]+(\d{1,18})\b', header, re.MULTILINE)
        promised, rows = sum(map(int, counts)), len(body.strip().splitlines())
        if rows < promised:
            raise PartError(
                f'{label} is shorter than its header says: it promises {promised} '
                f'rows (vertices and faces) and there are {rows}'
            )
        broken = _NO_NUMBER.search(body)
        if broken:
            raise PartError(
                f'{label} is a broken PLY: it has {_shown(broken)} among its rows, '
                'where only finite numbers are allowed'
            )
    return header + end[0] + body


def _shown(match: re.Match[bytes]) -> str:
    return shown(match[0][:200].decode(errors='replace'))


def _read_with_trimesh(data: bytes, mesh_format: str, label: str) -> tuple[Vertices, Faces]:
    import trimesh  # half of the time that a command takes to start; most parts are STL

    try:
        with np.errstate(all='ignore'):
            mesh = trimesh.load_mesh(
                io.BytesIO(data), file_type=mesh_format, process=False, skip_materials=True
            )
            vertices = np.asarray(mesh.vertices, dtype=np.float64).reshape(-1, 3)
            faces = np.asarray(mesh.faces, dtype=np.int64).reshape(-1, 3)
    except Exception as error:  # noqa: BLE001 its parsers raise whatever they stumble over
        hint = (
            '; it is cut off, or has faces with different numbers of corners, which are '
            'allowed in an ASCII PLY only'
            if 'unexpected length' in str(error)
            else ''
        )
        raise PartError(
            f'{label} is not a readable {mesh_format.upper()} '
            f'({type(error).__name__}: {one_line(str(error), 200)}){hint}'
        ) from None
    return vertices, faces


def _finite(vertices: Vertices, label: str) -> Vertices:
    bad = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
    if len(bad):
        raise PartError(
            f'{label} has {len(bad)} vertices that are not finite, the first one '
            f'number {bad[0]}: {vertices[bad[0]].tolist()}; all must be finite'
        )
    return vertices


def _or(words: tuple[str, ...]) -> str:
    return ' or '.join((', '.join(words[:-1]), words[-1]))
