"""Mesh files of every kind are read; the error for a broken file names the defect."""

import struct

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from resting_aspects_ros.errors import PartError, RestingAspectsError
from resting_aspects_ros.part.loading import part_from_bytes

CORNERS = [(0, 0, 0), (4, 0, 0), (4, 3, 0), (0, 3, 0), (0, 0, 2), (4, 0, 2), (4, 3, 2), (0, 3, 2)]
QUADS = [(0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)]
TRIANGLES = [t for a, b, c, d in QUADS for t in ((a, b, c), (a, c, d))]
BOX = trimesh.Trimesh(CORNERS, TRIANGLES, process=False)

STL = BOX.export(file_type='stl')
TEXT_STL = trimesh.exchange.stl.export_stl_ascii(BOX).replace('solid ', 'solid box', 1).encode()
LINE = TEXT_STL[: TEXT_STL.find(b'vertex 4.0 0.0')].count(b'\n') + 1
V_LINES = ''.join(f'v {x} {y} {z}\n' for x, y, z in CORNERS)


def f_lines(faces, shift=1, after=''):
    return ''.join('f ' + ' '.join(f'{i + shift}{after}' for i in f) + '\n' for f in faces)


def obj(text: str) -> tuple[bytes, str]:
    return text.encode('latin-1'), 'obj'


def ply(encoding: str, faces, comment: bytes = b'', more: str = '') -> tuple[bytes, str]:
    extra = 'property uchar red\n' if more else ''
    header = (
        f'element vertex 8\nproperty float x\nproperty float y\nproperty float z\n{extra}'
        f'element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n'
    )
    data = b'ply\nformat ' + encoding.encode() + b' 1.0\n' + comment + header.encode()
    if encoding == 'ascii':
        rows = [f'{x} {y} {z}{more}' for x, y, z in CORNERS]
        rows += [' '.join(map(str, (len(face), *face))) for face in faces]
        return data + ('\n'.join(rows) + '\n').encode(), 'ply'
    end = '<' if encoding == 'binary_little_endian' else '>'
    data += b''.join(struct.pack(f'{end}3f', *v) + (b'\7' if more else b'') for v in CORNERS)
    return data + b''.join(
        struct.pack(f'{end}B{len(face)}i', len(face), *face) for face in faces
    ), 'ply'


def off(faces, kind='OFF', more='', colour='') -> tuple[bytes, str]:
    lines = [kind, f'8 {len(faces)} 12']
    lines += [f'{x} {y} {z}{more}' for x, y, z in CORNERS]
    lines += [' '.join(map(str, (len(face), *face))) + colour for face in faces]
    return ('\n'.join(lines) + '\n').encode(), 'off'


WHOLE = {
    'binary STL': (STL, 'stl'),
    'binary STL with padding': (STL + bytes(7), 'stl'),
    'binary STL whose header begins with solid': (b'solid box' + STL[9:], 'stl'),
    'ASCII STL': (TEXT_STL, 'stl'),
    'ASCII STL in capitals': (TEXT_STL.upper(), 'stl'),
    'ASCII STL of an old Mac': (TEXT_STL.replace(b'\n', b'\r'), 'stl'),
    'ASCII STL with a mark of UTF-8': (b'\xef\xbb\xbf' + TEXT_STL, 'stl'),
    'ASCII STL named with keywords': (
        TEXT_STL.replace(b'box', b'vertex facet normal endsolid', 1),
        'stl',
    ),
    'ASCII STL with two solids': (
        TEXT_STL.replace(b'endfacet\n', b'endfacet\nendsolid a\nsolid b\n', 1),
        'stl',
    ),
    'OBJ of quads': obj(V_LINES + f_lines(QUADS)),
    'OBJ of both': obj(V_LINES + f_lines(QUADS[:3]) + f_lines(TRIANGLES[6:])),
    'OBJ with materials': obj(
        f'mtllib /dev/zero\n{V_LINES}usemtl a\n{f_lines(QUADS[:3])}usemtl b\ns off\n'
        + f_lines(QUADS[3:])
    ),
    'OBJ with textures and normals': obj(
        V_LINES + 'vt 0 0\nvn 0 0 1\n' + f_lines(QUADS, 1, '/1/1')
    ),
    'OBJ with colours that are no numbers': obj(
        V_LINES.replace('\n', ' nan NaN -inf\n') + f_lines(QUADS)
    ),
    'OBJ with comments': obj('# Gr\xf6\xdfe\n' + V_LINES.replace('\n', ' # a\n') + f_lines(QUADS)),
    'OBJ with tabs and indents': obj(
        (V_LINES + f_lines(QUADS)).replace(' ', '\t').replace('\n', '\n  ')
    ),
    'OBJ with exponents': obj(
        V_LINES.replace('4', '+4.0e0').replace('3', '.3E+1') + f_lines(QUADS)
    ),
    'OBJ with relative numbers': obj(V_LINES + f_lines(QUADS, shift=-8)),
    'OBJ with an unused vertex': obj('v 1e9 0 0\n' + V_LINES + f_lines(QUADS, shift=2)),
    'ASCII PLY of triangles': ply('ascii', TRIANGLES),
    'ASCII PLY of both': ply('ascii', QUADS[:3] + TRIANGLES[6:]),
    'ASCII PLY with colours that are no numbers': (
        ply('ascii', TRIANGLES, more=' nan')[0].replace(b'uchar red', b'float red'),
        'ply',
    ),
    'OFF of both': off(QUADS[:3] + TRIANGLES[6:]),
    'OFF with colours of vertices': off(QUADS, 'COFF', ' 255 0 0 nan'),
    'OFF with normals': off(QUADS, 'NOFF', ' 0 0 1'),
    'OFF with colours of faces': off(QUADS, colour=' 0.5 0.5 0.5'),
    'OFF with comments': (off(QUADS)[0].replace(b'\n', b' # 1 x\n'), 'off'),
    'OFF with counts in its first line': (off(QUADS)[0].replace(b'OFF\n', b'OFF '), 'off'),
    'OFF in one line': (b' '.join(off(QUADS)[0].split()), 'off'),
    'OFF of CR lines': (off(QUADS)[0].replace(b'\n', b'\r'), 'off'),
    'binary PLY of quads': ply('binary_little_endian', QUADS),
    'binary PLY, big end first': ply('binary_big_endian', TRIANGLES),
    'binary PLY with colours': ply('binary_little_endian', TRIANGLES, more=' 7'),
    'binary PLY with a comment': ply(
        'binary_little_endian', TRIANGLES, 'comment Größe\n'.encode('latin-1')
    ),
    'PLY with texture coordinates': (
        ply('ascii', TRIANGLES, more=' 0 1')[0].replace(
            b'uchar red', b'float s\nproperty float t'
        ),
        'ply',
    ),
    'PLY with a comment on its end': ply('ascii', TRIANGLES, b'comment no end_header yet\n'),
    'PLY with a texture': ply('ascii', TRIANGLES, b'comment TextureFile /dev/zero\n'),
}


@pytest.mark.filterwarnings('error')
@pytest.mark.parametrize('kind', WHOLE)
def test_whole_file_is_read(kind):
    part = part_from_bytes(*WHOLE[kind], 'box', unit='mm')
    assert part.volume == pytest.approx(24e-9)
    np.testing.assert_allclose(part.centre_of_mass, [2e-3, 1.5e-3, 1e-3])
    np.testing.assert_allclose(part.vertices, np.array(sorted(CORNERS)) * 1e-3)
    assert part.faces.shape == (12, 3)
    assert part.warnings == ()


def test_polygons_with_different_numbers_of_corners_are_read():
    """A prism with an edge of 1 and a height of 2, with polygons of 6 and of 4 corners."""
    angles = np.arange(6) * np.pi / 3
    rows = [f'{np.cos(a)} {np.sin(a)} {z}' for z in (0, 2) for a in angles]
    faces = [range(5, -1, -1), range(6, 12)]
    faces += [(k, (k + 1) % 6, (k + 1) % 6 + 6, k + 6) for k in range(6)]
    rows += [' '.join(map(str, (len(face), *face))) for face in faces]
    data = '\n'.join(['OFF', f'12 {len(faces)} 18', *rows]).encode()
    part = part_from_bytes(data, 'off', 'prism', unit='cm')
    assert part.warnings == ()
    assert part.volume == pytest.approx(3e-6 * np.sqrt(3), rel=1e-6)
    assert part.faces.shape == (2 * 4 + 6 * 2, 3)


@pytest.mark.timeout(600)
def test_edges_of_a_ply_are_ignored():
    """Trimesh would make a path of them, which took a minute and gigabytes for this one."""
    data, mesh_format = ply('ascii', TRIANGLES)
    edges = b'element edge 1\nproperty int vertex1\nproperty int vertex2\nend_header'
    data = data.replace(b'end_header', edges) + b'0 1000000000\n'
    assert part_from_bytes(data, mesh_format, 'box').volume == pytest.approx(24e-9)


def text_stl(old, new, count=-1):
    return TEXT_STL.replace(old, new, count), 'stl'


def binary_stl(number):
    """An STL with this number as the first coordinate."""
    return STL[:96] + struct.pack('<f', number) + STL[100:], 'stl'


def text_off(old, new):
    return off(QUADS)[0].replace(old, new), 'off'


def text_ply(old, new):
    return ply('ascii', QUADS)[0].replace(old, new), 'ply'


BINARY = 'binary_little_endian'
ENCODED = TEXT_STL.decode().encode
# The file, its format, and what the error says.
BROKEN = {
    'nothing': (b'', 'stl', 'empty (0 bytes)'),
    'a picture': (b'\x89PNG\r\n\x1a\n' + bytes(range(200)), 'stl', 'header declares'),
    'unknown format': (STL, 'step', "'step'"),
    'binary STL cut': (STL[:-1], 'stl', 'declares 12 triangles, and there are 11'),
    'binary STL cut, begins with solid': (b'solid ' + STL[6:-120], 'stl', 'there are 9'),
    'binary STL that would fill the memory': (
        STL[:80] + b'\xff\xff\xff\xff' + STL[84:],
        'stl',
        '4294967295 triangles',
    ),
    'binary STL of nothing': (bytes(84), 'stl', 'no triangles'),
    'ASCII STL cut': (TEXT_STL[:700], 'stl', "0 'endsolid'"),
    'ASCII STL, corner lost': (*text_stl(b'vertex', b'', 1), "35 'vertex'"),
    'ASCII STL, coordinate lost': (*text_stl(b'vertex 4.0', b'vertex', 1), 'three numbers'),
    'ASCII STL, comma': (*text_stl(b'4.0', b'4,0'), '4,0'),
    'ASCII STL, underscore': (*text_stl(b'vertex 4.0 0.0', b'vertex 1_0 0.0', 1), f'line {LINE}'),
    'ASCII STL, nan': (*text_stl(b'vertex 4.0', b'vertex nan'), 'nan'),
    'ASCII STL, 1e300': (*text_stl(b'vertex 4.0', b'vertex 1e300'), '1e+297 m'),
    'ASCII STL of nothing': (b'solid a\nendsolid a\n', 'stl', 'no triangles'),
    'binary STL, nan': (*binary_stl(np.nan), 'nan'),
    'STL called OBJ': (STL, 'obj', 'binary'),
    'OBJ, words': (*obj('v a b c\nf x y z\n'), "'v a b c'"),
    'OBJ, two corners': (*obj(V_LINES + 'f 1 2\n'), "'f 1 2'"),
    'OBJ, corner 0': (*obj(V_LINES + 'f 0 1 2\n'), "'f 0 1 2'"),
    'OBJ, corner 9': (*obj(V_LINES + 'f 1 2 9\n'), 'index 8'),
    'OBJ, corner 1e20': (*obj(V_LINES + f'f 1 2 {10**20}\n'), 'not a readable OBJ'),
    'OBJ, relative and absolute': (*obj(V_LINES + 'f -1 -2 -3\nv 9 9 9\n'), "'f -1 -2"),
    'STL in UTF-16 without a mark': (ENCODED('utf-16-be'), 'stl', 'UTF-16'),
    'STL in UTF-32': (ENCODED('utf-32'), 'stl', 'UTF-32'),
    'PLY in UTF-16': (ply('ascii', QUADS)[0].decode().encode('utf-16-le'), 'ply', 'UTF-16'),
    'OFF, other header': (off(QUADS, '4OFF')[0], 'off', 'not an OFF'),
    'OFF cut': (off(QUADS)[0][:-20], 'off', '8 vertices and 6 faces, and has 12 rows'),
    'OFF that would fill the memory': (*text_off(b'8 6 12', b'8 4294967295 12'), '4294967295'),
    'OFF, no counts': (*text_off(b'8 6 12', b'8'), 'numbers of vertices'),
    'OFF, nan': (*text_off(b'4 0 0', b'nan 0 0'), 'nan'),
    'OFF, corner lost': (*text_off(b'4 0 3 2 1', b'4 0 3 2'), 'number of its corners'),
    'OFF, corner 8': (*off([*TRIANGLES, (0, 1, 8)]), 'vertex number 8'),
    'OFF, corner 0.5': (*off([*TRIANGLES, (0, 1, 0.5)]), 'vertex numbers'),
    'OFF in one line, corners': (
        b' '.join(off(QUADS)[0].split()).replace(b'4 0 3 2 1', b'9 0 3 2 1'),
        'off',
        'truncated',
    ),
    'STL called PLY': (STL, 'ply', 'not a PLY'),
    'ASCII PLY cut': (ply('ascii', QUADS)[0][:-20], 'ply', 'declares 14 rows'),
    'ASCII PLY that would fill the memory': (
        *text_ply(b'vertex 8', b'vertex 4294967295'),
        'declares 4294967301 rows',
    ),
    'ASCII PLY, word': (*text_ply(b'4 3 2', b'4 x 2'), "'x'"),
    'binary PLY cut': (ply(BINARY, QUADS)[0][:-1], 'ply', 'truncated'),
    'binary PLY of both': (
        *ply(BINARY, QUADS[:3] + TRIANGLES[6:]),
        'different numbers of corners',
    ),
    'binary PLY that would fill the memory': (
        ply(BINARY, QUADS)[0].replace(b'vertex 8', b'vertex 4294967295'),
        'ply',
        'truncated',
    ),
    'PLY, corner 2e9': (*ply(BINARY, [*TRIANGLES, (0, 1, 2 * 10**9)]), 'vertex number 2000000000'),
}


@pytest.mark.filterwarnings('error')
@pytest.mark.parametrize('kind', BROKEN)
def test_error_for_a_broken_file(kind, capfd):
    data, mesh_format, expected = BROKEN[kind]
    with pytest.raises(PartError) as caught:
        part_from_bytes(data, mesh_format, 'bracket')
    message = str(caught.value)
    assert "part 'bracket'" in message
    assert expected in message
    assert '\n' not in message
    assert len(message) < 500
    assert capfd.readouterr() == ('', '')


@given(data=st.data())
@pytest.mark.filterwarnings('error')
def test_damaged_file_gives_a_part_or_an_error_of_the_suite(data):
    """Bytes lost, doubled or changed anywhere: no other exception, and no part that is none."""
    whole, mesh_format = WHOLE[data.draw(st.sampled_from(sorted(WHOLE)))]
    start = data.draw(st.integers(0, len(whole)))
    end = data.draw(st.integers(start, min(start + 40, len(whole))))
    words = [b'', b'nan', b'-', b'1e9', b'\0', b'\n', b' ', b'4294967295', whole[start:end] * 2]
    new = data.draw(st.sampled_from(words) | st.binary(max_size=8))
    try:
        part = part_from_bytes(whole[:start] + new + whole[end:], mesh_format, 'box')
    except RestingAspectsError:
        return
    assert part.volume > 0
    assert part.hull_radius > 0
    np.testing.assert_allclose(part.principal_axes.T @ part.principal_axes, np.eye(3), atol=1e-12)
