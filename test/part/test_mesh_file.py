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
V_LINES = ''.join(f'v {x} {y} {z}\n' for x, y, z in CORNERS)


def f_lines(faces, shift=1, after=''):
    return ''.join('f ' + ' '.join(f'{i + shift}{after}' for i in f) + '\n' for f in faces)


def obj(text: str) -> tuple[bytes, str]:
    return text.encode('latin-1'), 'obj'


def ply(encoding: str, faces, comment: bytes = b'', more: str = '') -> tuple[bytes, str]:
    extra = f'property {"float" if "nan" in more else "uchar"} red\n' if more else ''
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
    'binary STL with padding': (STL + bytes(7), 'stl'),
    'binary STL whose header begins with solid': (b'solid box' + STL[9:], 'stl'),
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
    'OBJ with all that is not used': obj(
        '# Gr\xf6\xdfe\nmtllib /dev/zero\no a\n'
        + V_LINES.replace('\n', ' nan NaN -inf # a\n')
        + f'vt 0 0\nvn 0 0 1\nusemtl a\n{f_lines(QUADS[:3], after="/1/1")}'
        + f'o b\nusemtl b\ns off\n{f_lines(TRIANGLES[6:], after="//1")}'
    ),
    'OBJ with tabs, indents and exponents': obj(
        (V_LINES.replace('4', '+4.0e0').replace('3', '.3E+1') + f_lines(QUADS))
        .replace(' ', '\t')
        .replace('\n', '\n  ')
    ),
    'OBJ with relative numbers': obj(V_LINES + f_lines(QUADS, shift=-8)),
    'OBJ with an unused vertex': obj('v 1e9 0 0\n' + V_LINES + f_lines(QUADS, shift=2)),
    'ASCII PLY of both with all that is not used': ply(
        'ascii',
        QUADS[:3] + TRIANGLES[6:],
        b'comment no end_header yet\ncomment TextureFile /dev/zero\n',
        ' nan',
    ),
    'binary PLY with colours and a comment': ply(
        'binary_little_endian', QUADS, 'comment Größe\n'.encode('latin-1'), ' 7'
    ),
    'binary PLY, big end first': ply('binary_big_endian', TRIANGLES),
    'OFF of both with colours': off(
        QUADS[:3] + TRIANGLES[6:], 'COFF', ' 255 0 0 nan', ' 0.5 0.5 0.5 # 1 x'
    ),
    'OFF of CR lines': (off(QUADS)[0].replace(b'\n', b'\r'), 'off'),
}


@pytest.mark.filterwarnings('error')
@pytest.mark.parametrize('kind', WHOLE)
def test_whole_file_is_read(kind):
    part = part_from_bytes(*WHOLE[kind], 'box', unit='mm')
    assert part.volume == pytest.approx(24e-9)
    np.testing.assert_allclose(part.vertices, np.array(sorted(CORNERS)) * 1e-3)
    assert part.warnings == ()


@pytest.mark.timeout(600)
def test_edges_of_a_ply_are_ignored():
    """Trimesh would make a path of them, which took a minute and gigabytes for this one."""
    data, mesh_format = ply('ascii', TRIANGLES)
    edges = b'element edge 1\nproperty int vertex1\nproperty int vertex2\nend_header'
    data = data.replace(b'end_header', edges) + b'0 1000000000\n'
    assert part_from_bytes(data, mesh_format, 'box').volume == pytest.approx(24e-9)


def text_stl(old, new, count=-1):
    return TEXT_STL.replace(old, new, count), 'stl'


def text_off(old, new):
    return off(QUADS)[0].replace(old, new), 'off'


def text_ply(old, new):
    return ply('ascii', QUADS)[0].replace(old, new), 'ply'


BINARY = 'binary_little_endian'
# The file, its format, and what the error says.
BROKEN = {
    'nothing': (b'', 'stl', 'empty (0 bytes)'),
    'a word': (b'hello', 'stl', "begins with b'hello'"),
    'a few bytes': (b'\0' * 20, 'stl', '20 bytes'),
    'unknown format': (STL, 'step', "'step'"),
    'binary STL that would fill the memory': (
        STL[:80] + b'\xff\xff\xff\xff' + STL[84:],
        'stl',
        '4294967295 triangles',
    ),
    'ASCII STL cut': (TEXT_STL[:700], 'stl', "0 'endsolid'"),
    'ASCII STL, corner lost': (*text_stl(b'vertex', b'', 1), "35 'vertex'"),
    'ASCII STL, underscore': (*text_stl(b'vertex 4.0 0.0', b'vertex 1_0 0.0', 1), '1_0'),
    'ASCII STL, nan': (*text_stl(b'vertex 4.0', b'vertex nan'), 'nan'),
    'ASCII STL, 1e300': (*text_stl(b'vertex 4.0', b'vertex 1e300'), '1e+297 m'),
    'binary STL, nan': (STL[:96] + struct.pack('<f', np.nan) + STL[100:], 'stl', 'nan'),
    'STL called OBJ': (STL, 'obj', 'binary'),
    'OBJ, words': (*obj('v a b c\nf x y z\n'), "'v a b c'"),
    'OBJ, corner 0': (*obj(V_LINES + 'f 0 1 2\n'), "'f 0 1 2'"),
    'OBJ, relative and absolute': (*obj(V_LINES + 'f -1 -2 -3\nv 9 9 9\n'), "'f -1 -2"),
    'STL in UTF-16': (TEXT_STL.decode().encode('utf-16-le'), 'stl', 'UTF-16'),
    'OFF cut': (off(QUADS)[0][:-20], 'off', '8 vertices and 6 faces, and has 12 rows'),
    'OFF, corner lost': (*text_off(b'4 0 3 2 1', b'4 0 3 2'), 'number of its corners'),
    'STL called PLY': (STL, 'ply', 'not a PLY'),
    'ASCII PLY cut': (ply('ascii', QUADS)[0][:-20], 'ply', 'declares 14 rows'),
    'ASCII PLY, word': (*text_ply(b'4 3 2', b'4 x 2'), "'x'"),
    'binary PLY that would fill the memory': (
        ply(BINARY, QUADS)[0].replace(b'vertex 8', b'vertex 4294967295'),
        'ply',
        'truncated, or has faces with different numbers of corners',
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
    assert message.isprintable()
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
    np.testing.assert_allclose(part.principal_axes.T @ part.principal_axes, np.eye(3), atol=1e-12)
