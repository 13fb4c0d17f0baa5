"""Read the triangles of a mesh file (STL, OBJ, PLY, OFF); errors state how the file is broken.

STL is parsed here, not by trimesh: the binary form is a single array, and in ASCII files trimesh
drops a solid without ``endsolid`` and fails if a solid's name contains one of its keywords. The
regular expressions read each character only a few times for any input.
"""

import itertools
import re
import struct
from typing import NamedTuple

import numpy as np

from resting_aspects_ros.core.errors import PartError, shown
from resting_aspects_ros.core.geometry.coordinate_steps import (
    Array,
    Words,
    coordinate_steps,
)
from resting_aspects_ros.core.geometry.polygon_file import (
    Faces,
    Vertices,
    check_encoding,
    read_obj,
    read_off,
    read_ply,
)

# Formats of a single mesh without a unit.
MESH_FORMATS = ('stl', 'obj', 'ply', 'off')
# More triangles take minutes and gigabytes and do not change the aspects.
MAX_TRIANGLES = 1_000_000

_STL_HEADER = 84  # 80 arbitrary bytes, then the number of triangles
# Normal and three corners in float32, then two bytes of attributes.
_STL_ROW = np.dtype([('normal', '<f4', 3), ('corners', '<f4', (3, 3)), ('attributes', '<u2')])
_STL_TRIANGLE = _STL_ROW.itemsize
_STL_VERTEX = re.compile(
    rb'^[ \t]*vertex[ \t]+(\S+)[ \t]+(\S+)[ \t]+(\S+)[ \t]*$', re.IGNORECASE | re.MULTILINE
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

    vertices: Vertices
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
        raise PartError(
            f'invalid format {shown(mesh_format)} of {label}: expected {_or(MESH_FORMATS)}'
        )
    if not data:
        raise PartError(
            f'{label} is empty (0 bytes): expected a mesh in {_or(MESH_FORMATS)} format'
        )
    vertices, faces, words = _READERS[mesh_format](data, label)
    vertices, faces = checked_triangles(vertices, faces, label)
    return Triangles(vertices, faces, coordinate_steps(vertices, words))


def checked_triangles(vertices: Vertices, faces: Faces, label: str) -> tuple[Vertices, Faces]:
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
    return _finite(vertices, label), faces


def without_unused(vertices: Vertices, faces: Faces) -> tuple[Vertices, Faces]:
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


def _read_stl(data: bytes, label: str) -> tuple[Vertices, Faces, Words]:
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


def _read_binary_stl(data: bytes, count: int, label: str) -> tuple[Vertices, Faces, Words]:
    check_count(count, label)
    rows = np.frombuffer(data, dtype=_STL_ROW, count=count, offset=_STL_HEADER)
    with np.errstate(invalid='ignore'):  # a signalling NaN becomes a quiet NaN
        vertices = rows['corners'].reshape(-1, 3).astype(np.float64)
    return vertices, np.arange(3 * count, dtype=np.int64).reshape(-1, 3), []


def _read_ascii_stl(text: bytes, label: str) -> tuple[Vertices, Faces, Words]:
    text = text.replace(b'\r\n', b'\n').replace(b'\r', b'\n')
    lines = {
        word: _count_lines(word, text)
        for word in (b'solid', b'endsolid', b'facet', b'endfacet', b'vertex')
    }
    check_count(lines[b'facet'], label)
    corners = _STL_VERTEX.findall(text)
    if lines[b'solid'] != lines[b'endsolid']:
        raise PartError(
            f"{label} is truncated: it has {lines[b'solid']} 'solid' and "
            f"{lines[b'endsolid']} 'endsolid', expected the same number of both"
        )
    if not lines[b'facet'] == lines[b'endfacet'] == lines[b'vertex'] / 3 == len(corners) / 3:
        raise PartError(
            f"{label} is a broken ASCII STL: {lines[b'facet']} 'facet', "
            f"{lines[b'endfacet']} 'endfacet' and {len(corners)} corners with three "
            "numbers, expected one 'endfacet' and three corners for each facet"
        )
    try:
        if b'_' in b''.join(itertools.chain.from_iterable(corners)):
            raise ValueError  # Python reads 1_0 as 10
        words = map(float, itertools.chain.from_iterable(corners))
        vertices = np.fromiter(words, dtype=np.float64, count=3 * len(corners)).reshape(-1, 3)
    except ValueError:
        number, word = _not_a_number(text)
        raise PartError(
            f'{label} is a broken ASCII STL: it has the coordinate {shown(word)} in line {number},'
            ' expected a number'
        ) from None
    faces = np.arange(len(vertices), dtype=np.int64).reshape(-1, 3)
    return vertices, faces, corners


def _not_a_number(text: bytes) -> tuple[int, str]:
    """Return the first coordinate that is not a number, and the number of its line."""
    for match in _STL_VERTEX.finditer(text):
        for word in match.groups():
            try:
                valid = b'_' not in word and float(word) is not None
            except ValueError:
                valid = False
            if not valid:
                return text.count(b'\n', 0, match.start()) + 1, word.decode(errors='replace')
    raise AssertionError


def _count_lines(word: bytes, text: bytes) -> int:
    return len(re.findall(rb'^[ \t]*' + word + rb'\b', text, re.IGNORECASE | re.MULTILINE))


def _finite(vertices: Vertices, label: str) -> Vertices:
    bad = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
    if len(bad):
        raise PartError(
            f'{label} has {len(bad)} vertices that are not finite, the first one '
            f'number {bad[0]}: {vertices[bad[0]].tolist()}; all must be finite'
        )
    return vertices


_READERS = {'stl': _read_stl, 'obj': read_obj, 'ply': read_ply, 'off': read_off}


def _or(words: tuple[str, ...]) -> str:
    return ' or '.join((', '.join(words[:-1]), words[-1]))
