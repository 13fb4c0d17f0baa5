"""Read the triangles of a mesh file (STL, OBJ, PLY, OFF); errors state how the file is broken."""

import io
import itertools
import logging
import re
import struct
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from resting_aspects_ros.arrays import Array, Faces
from resting_aspects_ros.errors import PartError, one_line, shown

# -- Steps of coordinates -------------------------------------------------------------------------


Words = Sequence[Sequence[bytes]]

# Rows of text whose digits are counted.
MAX_ROWS = 5_000
# Writers of text give at least this many digits, if they are needed.
MIN_DIGITS = 6
# Coordinates that are all multiples of this many steps were not rounded to steps: they are design
# values, as are integers with at most this many different values.
DESIGN_STEPS = 10
DESIGN_VALUES = 8
# Coordinates with a point are design values, too, if they have few different values for their
# number of corners, or if their last digits are only 0 and 5.
DESIGN_SHARE = 0.75
# Rounded coordinates of similar size end at the same decimal: nine of ten without zeros at the
# end, and fewer if all have the same number of digits.
ROUNDED_SHARE = 0.6
# More steps along a part do not change its aspects.
FINE_STEPS = 5_000


def coordinate_steps(vertices: Array, words: Words) -> Array:
    """Return the step (3,) of the coordinates of each axis, in their unit.

    Parameters
    ----------
    vertices : (n, 3) float64
        The vertices that are used.
    words : sequence of (3,) sequences
        The words of the coordinates of each vertex, which are numbers; empty for a binary file.
    """
    rows = words[:: max(len(words) // MAX_ROWS, 1)]
    columns = zip(*rows, strict=True) if words else ((),) * 3
    few = min(DESIGN_SHARE * len(set(map(tuple, rows))), DESIGN_VALUES)
    return np.array([_step(x, column, few) for x, column in zip(vertices.T, columns, strict=True)])


def _step(values: Array, column: Iterable[bytes], few: float) -> float:
    largest = float(np.abs(values).max())
    words = {word.lower() for word in column}
    written = _written_step(words, largest)
    rounded = _rounded_step(words, largest) if len(words) > few else 0.0
    if rounded * FINE_STEPS > np.ptp(values):
        written = max(written, rounded)
    exact = float(np.spacing(largest))
    step = max(exact, written)
    with np.errstate(over='ignore', invalid='ignore'):
        single = float(np.spacing(np.float32(largest)))
        rounding = np.abs(values.astype(np.float32) - values).max()
    if single > DESIGN_STEPS * step and rounding <= 0.51 * written:
        step = single
    if step > exact:
        counts = np.rint(values / step)
        whole = np.abs(counts * step - values).max() <= exact
        if whole and np.gcd.reduce(counts.astype(np.int64)) >= DESIGN_STEPS:
            return exact
    return step


def _written_step(words: Iterable[bytes], largest: float) -> float:
    """Return the step of the last written digit of the largest coordinates; 0 if unknown."""
    values = {word: abs(float(word)) for word in words}
    if not largest or not values:
        return 0.0
    decade = int(np.floor(np.log10(largest)))
    large = [word for word, x in values.items() if 10.0**decade <= x <= largest]
    design = len(values) <= DESIGN_VALUES and not any(set(word) & set(b'.e') for word in large)
    if design or not large:
        return 0.0
    last = min(_last_digit(word) for word in large)
    return float(10.0 ** min(last, decade - MIN_DIGITS + 1))


def _rounded_step(words: Iterable[bytes], largest: float) -> float:
    """Return the step of decimals to which most coordinates are rounded; 0 if there is none.

    Integers are design values.
    """
    digits = {word.partition(b'e')[0][-1:] for word in words}
    large = [word for word in words if 0.1 * largest <= abs(float(word)) > 0]
    if digits <= {b'0', b'5'} or not any(set(word) & set(b'.e') for word in large):
        return 0.0
    exponents = [_last_digit(word) for word in large]
    last = int(np.median(exponents))
    return float(10.0**last) if exponents.count(last) >= ROUNDED_SHARE * len(large) else 0.0


def _last_digit(word: bytes) -> int:
    """Return the decimal exponent of the last digit of a number: -2 for 1.25."""
    mantissa, _, exponent = word.partition(b'e')
    return int(exponent or 0) - len(mantissa.partition(b'.')[2])


# -- Files of polygons ----------------------------------------------------------------------------


# Without a handler, Python prints the warnings of trimesh on standard error.
logging.getLogger('trimesh').addHandler(logging.NullHandler())

_NUMBER = rb'[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?'
# Colours, normals and the like are not used.
_ANY_NUMBER = rb'(?:' + _NUMBER + rb'|[-+]?(?i:nan|inf|infinity))'
_CORNER = rb'-?[1-9]\d*(?:/-?\d*){0,2}'
_INVALID_OBJ_LINE = re.compile(
    rb'^(?:v[ \t]+(?!' + _NUMBER + rb'(?:[ \t]+' + _NUMBER + rb'){2}'
    rb'(?:[ \t]+' + _ANY_NUMBER + rb')*[ \t]*$)'
    rb'|f[ \t]+(?!' + _CORNER + rb'(?:[ \t]+' + _CORNER + rb'){2,}[ \t]*$))[^\n]*',
    re.MULTILINE,
)
_INVALID_WORD = re.compile(rb'(?<!\S)(?!' + _ANY_NUMBER + rb'(?!\S))\S+')


def _read_obj(data: bytes, label: str) -> tuple[Array, Faces, Words]:
    """Return the vertices and faces of an OBJ file, and the words of the coordinates."""
    data = _checked_obj(data, label)
    rows = [line.split()[1:] for line in re.findall(rb'^v [^\n]*', data, re.MULTILINE)]
    return *_read_with_trimesh(data, 'obj', label), rows


def _read_ply(data: bytes, label: str) -> tuple[Array, Faces, Words]:
    """Return the vertices and faces of a PLY file, and the words of the coordinates."""
    data, rows = _checked_ply(data, label)
    return *_read_with_trimesh(data, 'ply', label), rows


def _read_off(data: bytes, label: str) -> tuple[Array, Faces, Words]:
    """Return the vertices and faces of an OFF file, and the words of the coordinates."""
    rows, polygons = _off_rows(data, label)
    vertices = np.array(rows, dtype=np.bytes_).astype(np.float64).reshape(-1, 3)
    triangles = [(row[0], *row[k : k + 2]) for row in polygons for k in range(1, len(row) - 1)]
    faces = np.array(triangles, dtype=np.bytes_).astype(np.int64).reshape(-1, 3)
    return vertices, faces, rows


def check_encoding(data: bytes, label: str) -> None:
    """Raise PartError if the data are text in UTF-16 or UTF-32."""
    for encoding in ('utf-32', 'utf-32-le', 'utf-32-be', 'utf-16', 'utf-16-le', 'utf-16-be'):
        text = data[:40].decode(encoding, errors='replace').lstrip('\ufeff')
        if b'\0' in data[:40] and re.fullmatch(r'[\t\r\n -~]{4,}', text):
            raise PartError(
                f'{label} is text in the encoding {encoding[:6].upper()}: expected ASCII or UTF-8'
            )


def _checked_obj(data: bytes, label: str) -> bytes:
    """Return the vertex and face lines of an OBJ; raise PartError for a line that is invalid.

    Also rejects relative vertex numbers before the last vertex: they count from the end of the
    vertices that precede them, but trimesh counts from the end of all vertices.
    """
    check_encoding(data, label)
    if b'\0' in data:
        raise PartError(f'{label} is not an OBJ: it is binary, and an OBJ is text')
    data = data.decode('utf-8-sig', errors='replace').encode()
    data = data.replace(b'\r\n', b'\n').replace(b'\r', b'\n')
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
    data = b'\n'.join(re.findall(rb'^(?:v \S+ \S+ \S+|f [^\n]*)', data, re.MULTILINE))
    return re.sub(rb'(?<=\d)/[-/\d]*', b'', data)


def _checked_ply(data: bytes, label: str) -> tuple[bytes, list[list[bytes]]]:
    """Return the PLY without elements that trimesh need not read, and the words of its vertices.

    There are no words in a binary PLY. Raises PartError if the PLY is broken.
    """
    check_encoding(data, label)
    end = re.search(rb'^end_header', data, re.MULTILINE)
    if not data.startswith(b'ply') or not end:
        raise PartError(f"{label} is not a PLY: it has no header from 'ply' to 'end_header'")
    header, body = data[: end.start()], data[end.end() :]
    # A comment with the words "end_header" would end the header for trimesh.
    header = re.sub(rb'^(comment|obj_info)[^\n]*\n', b'', header, flags=re.MULTILINE)
    header = header.decode('ascii', errors='replace').encode('ascii', errors='replace')
    # trimesh would convert edges to a path, which can take minutes. It ignores unknown elements.
    header = re.sub(rb'^element[ \t]+edge', b'element unused', header, flags=re.MULTILINE)
    rows: list[list[bytes]] = []
    if re.search(rb'^format[ \t]+ascii', header, re.MULTILINE):
        rows = _checked_ply_rows(header, body.strip().splitlines(), label)
        broken = _INVALID_WORD.search(body)
        if broken:
            raise PartError(
                f'{label} is a broken PLY: it has {_shown(broken)} in its rows, expected finite '
                'numbers'
            )
    return header + end[0] + body, rows


def _checked_ply_rows(header: bytes, lines: list[bytes], label: str) -> list[list[bytes]]:
    """Return the words of x, y and z of the rows of vertices, if these are the first rows."""
    elements = re.findall(rb'^element[ \t]+(\S+)[ \t]+(\d{1,18})\b', header, re.MULTILINE)
    declared = sum(int(count) for _, count in elements)
    if len(lines) < declared:
        raise PartError(
            f'{label} is truncated: its header declares {declared} rows (vertices and '
            f'faces), and there are {len(lines)}'
        )
    names = re.findall(rb'^(element|property)[ \t][^\n]*?(\S+)[ \t]*\r?$', header, re.MULTILINE)
    kinds = [kind for kind, _ in names] + [b'element']
    properties = [name for _, name in names[1 : kinds.index(b'element', 1)]] if names else []
    if not elements or elements[0][0] != b'vertex' or not {b'x', b'y', b'z'} <= {*properties}:
        return []
    columns = [properties.index(axis) for axis in (b'x', b'y', b'z')]
    words = [line.split() for line in lines[: int(elements[0][1])]]
    return [[row[k] for k in columns] for row in words if len(row) > max(columns)]


def _off_rows(data: bytes, label: str) -> tuple[list[list[bytes]], list[list[bytes]]]:
    """Return the words of the vertices and of the faces of an OFF; raise PartError if broken."""
    check_encoding(data, label)
    data = re.sub(rb'#[^\n]*', b'', data.removeprefix(b'\xef\xbb\xbf').replace(b'\r', b'\n'))
    # Colours and normals of vertices follow their coordinates, and are ignored.
    match = re.match(rb'\s*(?:ST)?C?N?OFF\s+(?=\d)', data)
    if b'\0' in data or not match:
        raise PartError(f"{label} is not an OFF: expected text that begins with 'OFF'")
    body = data[match.end() :]
    broken = _INVALID_WORD.search(body)
    if broken:
        raise PartError(
            f'{label} is a broken OFF: it has {_shown(broken)}, expected finite numbers'
        )
    counts, *lines = [line.split() for line in body.splitlines() if line.strip()]
    if len(counts) < 2 or not all(map(_is_natural, counts[:2])):
        raise PartError(
            f"{label} is a broken OFF: expected the numbers of vertices and faces after 'OFF'"
        )
    vertices, faces = int(counts[0]), int(counts[1])
    if len(lines) < vertices + faces:
        raise PartError(
            f'{label} is truncated: it declares {vertices} vertices and {faces} faces, and has '
            f'{len(lines)} rows of them'
        )
    rows = [line[:3] for line in lines[:vertices]]
    polygons = lines[vertices : vertices + faces]
    if any(len(row) < 3 for row in rows) or not all(map(_is_polygon, polygons)):
        raise PartError(
            f'{label} is a broken OFF: expected three numbers for a vertex, and for a face the '
            'number of its corners, at least 3, and their vertex numbers'
        )
    return rows, [row[1 : int(row[0]) + 1] for row in polygons]


def _is_polygon(row: list[bytes]) -> bool:
    """Return whether a row begins with the number of corners of a face and these."""
    if not row or not _is_natural(row[0]) or not 3 <= int(row[0]) < len(row):
        return False
    return all(map(_is_natural, row[: int(row[0]) + 1]))


def _is_natural(word: bytes) -> bool:
    return word.isdigit() and len(word) < 18


def _shown(match: re.Match[bytes]) -> str:
    return shown(match[0][:200].decode(errors='replace'))


def _read_with_trimesh(data: bytes, mesh_format: str, label: str) -> tuple[Array, Faces]:
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


# -- Mesh files -----------------------------------------------------------------------------------


# Formats of a single mesh without a unit.
MESH_FORMATS = ('stl', 'obj', 'ply', 'off')
_ANY_FORMAT = ' or '.join((', '.join(MESH_FORMATS[:-1]), MESH_FORMATS[-1]))
# Files of bodies with names; see scene_files.
SCENE_FORMATS, STEP_FORMATS = ('glb', '3mf'), ('step', 'stp')
# More triangles take minutes and gigabytes and do not change the aspects.
MAX_TRIANGLES = 1_000_000

_STL_HEADER = 84  # 80 arbitrary bytes, then the number of triangles
# Normal and three corners in float32, then two bytes of attributes.
_STL_ROW = np.dtype([('normal', '<f4', 3), ('corners', '<f4', (3, 3)), ('attributes', '<u2')])
_STL_TRIANGLE = _STL_ROW.itemsize
_STL_CORNER = rb''.join([rb'[ \t]+(' + _ANY_NUMBER + rb')'] * 3) + rb'[ \t]*$'
_STL_VERTEX = re.compile(rb'^[ \t]*vertex' + _STL_CORNER, re.IGNORECASE | re.MULTILINE)
_INVALID_STL_LINE = re.compile(
    rb'^[ \t]*vertex\b(?!' + _STL_CORNER + rb')[^\n]*', re.IGNORECASE | re.MULTILINE
)


class Triangles(NamedTuple):
    """The triangles of a mesh, in the unit of the file.

    vertices : (n, 3) float64
        All finite, and each is a corner of a triangle.
    faces : (m, 3) int64
        Rows of ``vertices``; at least one triangle.
    steps : (3,) float64
        Steps in which the file stores the coordinates of each axis.
    """

    vertices: Array
    faces: Faces
    steps: Array


def read_triangles(data: bytes, mesh_format: str, label: str) -> Triangles:
    """Return the triangles in the bytes of a mesh file, as they are in the file.

    Parameters
    ----------
    data : bytes
        All bytes of the file.
    mesh_format : str
        One of MESH_FORMATS.
    label : str
        Name of the file in errors.

    Raises
    ------
    PartError
        If the bytes are not a complete mesh in that format with finite vertices.
    """
    if mesh_format not in _READERS:
        raise PartError(f'invalid format {shown(mesh_format)} of {label}: expected {_ANY_FORMAT}')
    if not data:
        raise PartError(f'{label} is empty (0 bytes): expected a mesh in {_ANY_FORMAT} format')
    vertices, faces, words = _READERS[mesh_format](data, label)
    vertices, faces = checked_triangles(vertices, faces, label)
    return Triangles(vertices, faces, coordinate_steps(vertices, words))


def checked_triangles(vertices: Array, faces: Faces, label: str) -> tuple[Array, Faces]:
    """Return the vertices that are used, all finite, and the faces; raise PartError if invalid."""
    if not len(faces):
        raise PartError(f'{label} has no triangles: expected at least 4, to enclose a volume')
    check_count(len(faces), label)
    invalid = faces[(faces < 0) | (faces >= len(vertices))]
    if len(invalid):
        raise PartError(
            f'{label} has a triangle whose corner is vertex number {invalid[0]}: '
            f'expected 0 to {len(vertices) - 1}'
        )
    vertices, faces = without_unused(vertices, faces)
    bad = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
    if len(bad):
        raise PartError(
            f'{label} has {len(bad)} vertices that are not finite, the first one '
            f'number {bad[0]}: {vertices[bad[0]].tolist()}; all must be finite'
        )
    return vertices, faces


def without_unused(vertices: Array, faces: Faces) -> tuple[Array, Faces]:
    """Return the vertices that are corners of faces, in their order, and the faces of these."""
    used = np.zeros(len(vertices), dtype=bool)
    used[faces] = True
    return vertices[used], (np.cumsum(used) - 1)[faces]


def check_count(triangles: int, label: str) -> None:
    """Raise PartError if there are too many triangles."""
    if triangles > MAX_TRIANGLES:
        raise PartError(
            f'{label} has {triangles} triangles: expected at most {MAX_TRIANGLES}; simplify the '
            'mesh, or export it with a coarser tolerance (100000 triangles are enough)'
        )


def _read_stl(data: bytes, label: str) -> tuple[Array, Faces, Words]:
    """Read an STL; a file with the length of a binary STL is one, even if it begins 'solid'."""
    declared = struct.unpack_from('<I', data, 80)[0] if len(data) >= _STL_HEADER else -1
    available = (len(data) - _STL_HEADER) // _STL_TRIANGLE
    if declared > 0 and len(data) == _STL_HEADER + declared * _STL_TRIANGLE:
        return _read_binary_stl(data, declared, label)
    check_encoding(data, label)
    text = data.removeprefix(b'\xef\xbb\xbf')
    if b'\0' not in data:
        if text.lstrip()[:5].lower() == b'solid':
            return _read_ascii_stl(text, label)
        raise PartError(
            f'{label} is not an STL: it is neither binary nor text that begins with '
            f"'solid', but begins with {shown(data[:20])}"
        )
    if declared < 0:
        raise PartError(
            f'{label} is not an STL: it has {len(data)} bytes, and a binary STL '
            f'has at least {_STL_HEADER}'
        )
    if declared > available:
        raise PartError(
            f'{label} is truncated or not an STL: its header declares {declared} triangles, and '
            f'there are {available}'
        )
    # Some programs write padding after the last triangle.
    return _read_binary_stl(data, declared, label)


def _read_binary_stl(data: bytes, count: int, label: str) -> tuple[Array, Faces, Words]:
    check_count(count, label)
    rows = np.frombuffer(data, dtype=_STL_ROW, count=count, offset=_STL_HEADER)
    with np.errstate(invalid='ignore'):  # a signalling NaN becomes a quiet NaN
        vertices = rows['corners'].reshape(-1, 3).astype(np.float64)
    return vertices, np.arange(3 * count, dtype=np.int64).reshape(-1, 3), []


def _read_ascii_stl(text: bytes, label: str) -> tuple[Array, Faces, Words]:
    text = text.replace(b'\r\n', b'\n').replace(b'\r', b'\n')
    lines = {
        word: _count_lines(word, text)
        for word in (b'solid', b'endsolid', b'facet', b'endfacet', b'vertex')
    }
    check_count(lines[b'facet'], label)
    if lines[b'solid'] != lines[b'endsolid']:
        raise PartError(
            f"{label} is truncated: it has {lines[b'solid']} 'solid' and "
            f"{lines[b'endsolid']} 'endsolid', expected the same number of both"
        )
    if not lines[b'facet'] == lines[b'endfacet'] == lines[b'vertex'] / 3:
        raise PartError(
            f"{label} is a broken ASCII STL: {lines[b'facet']} 'facet', "
            f"{lines[b'endfacet']} 'endfacet' and {lines[b'vertex']} 'vertex', expected one "
            "'endfacet' and three corners for each facet"
        )
    broken = _INVALID_STL_LINE.search(text)
    if broken:
        number = text.count(b'\n', 0, broken.start()) + 1
        raise PartError(
            f'{label} is a broken ASCII STL: it has {_shown(broken)} in line '
            f'{number}, expected three numbers'
        )
    corners = _STL_VERTEX.findall(text)
    words = map(float, itertools.chain.from_iterable(corners))
    vertices = np.fromiter(words, dtype=np.float64, count=3 * len(corners)).reshape(-1, 3)
    return vertices, np.arange(len(vertices), dtype=np.int64).reshape(-1, 3), corners


def _count_lines(word: bytes, text: bytes) -> int:
    return len(re.findall(rb'^[ \t]*' + word + rb'\b', text, re.IGNORECASE | re.MULTILINE))


_READERS = {'stl': _read_stl, 'obj': _read_obj, 'ply': _read_ply, 'off': _read_off}
