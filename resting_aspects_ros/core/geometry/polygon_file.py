"""Read an OBJ or PLY file with trimesh, after checks that trimesh does not make, or an OFF file.

trimesh stops reading at the first word that is not a number, without an error, so the text is
checked first. It reads an OFF only with one row in each line and at most four corners.
"""

import io
import logging
import re

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.errors import PartError, one_line, shown
from resting_aspects_ros.core.geometry.coordinate_steps import Words

Vertices = npt.NDArray[np.float64]
Faces = npt.NDArray[np.int64]

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


def read_obj(data: bytes, label: str) -> tuple[Vertices, Faces, Words]:
    """Return the vertices and faces of an OBJ file, and the words of the coordinates."""
    data = _checked_obj(data, label)
    rows = [line.split()[1:] for line in re.findall(rb'^v [^\n]*', data, re.MULTILINE)]
    return *_read_with_trimesh(data, 'obj', label), rows


def read_ply(data: bytes, label: str) -> tuple[Vertices, Faces, Words]:
    """Return the vertices and faces of a PLY file, and the words of the coordinates."""
    data, rows = _checked_ply(data, label)
    return *_read_with_trimesh(data, 'ply', label), rows


def read_off(data: bytes, label: str) -> tuple[Vertices, Faces, Words]:
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
    if match[0].strip() == b'OFF' and (lines := _off_lines(body.split())):
        counts = lines.pop(0)
    else:
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


def _off_lines(words: list[bytes]) -> list[list[bytes]]:
    """Return the counts, vertices and faces in words with any line breaks.

    The list is empty if the words are not exactly these, because colours follow the faces.
    """
    if not all(map(_is_natural, words[:3])):
        return []
    vertices, faces, *_ = map(int, (*words[:3], b'0', b'0'))
    if len(words) < 3 + 3 * vertices + 4 * faces:
        return []
    end = 3 + 3 * vertices
    lines = [words[k : k + 3] for k in range(0, end, 3)]
    for _ in range(faces):
        corners = int(words[end]) if end < len(words) and _is_natural(words[end]) else 0
        row = words[end : end + 1 + corners]
        if not _is_polygon(row):
            return []
        lines.append(row)
        end += len(row)
    return lines if end == len(words) else []


def _is_polygon(row: list[bytes]) -> bool:
    """Return whether a row begins with the number of corners of a face and these."""
    if not row or not _is_natural(row[0]) or not 3 <= int(row[0]) < len(row):
        return False
    return all(map(_is_natural, row[: int(row[0]) + 1]))


def _is_natural(word: bytes) -> bool:
    return word.isdigit() and len(word) < 18


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
