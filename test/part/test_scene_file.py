"""GLB, 3MF and OFF files are the same parts as STL files; bodies have names and places."""

import io
import json
import re
import struct
import zipfile

import numpy as np
import pytest
import shapely
import trimesh

from resting_aspects_ros.errors import InvalidValueError, PartError
from resting_aspects_ros.part import scene_files
from resting_aspects_ros.part.library import PartLibrary
from resting_aspects_ros.part.loading import load_part, part_from_bytes

METRES = {'micron': 1e-6, 'millimeter': 1e-3, 'centimeter': 1e-2, 'inch': 0.0254, 'foot': 0.3048}


def bracket():
    """An L of 40 x 30 x 20 mm, in mm, away from the origin."""
    outline = [(100, 0), (140, 0), (140, 5), (105, 5), (105, 30), (100, 30)]
    return trimesh.creation.extrude_polygon(shapely.Polygon(outline), 20)


def in_metres(mesh):
    mesh = mesh.copy()
    mesh.apply_scale(1e-3)
    return mesh


GLB = in_metres(bracket()).export(file_type='glb')
FILES = {
    'glb': lambda: GLB,
    '3mf': lambda: bracket().export(file_type='3mf'),
    'off': lambda: bracket().export(file_type='off').encode(),
}


@pytest.mark.parametrize('mesh_format', FILES)
def test_part_is_that_of_an_stl_file(mesh_format, tmp_path):
    file = tmp_path / f'bracket.{mesh_format}'
    file.write_bytes(FILES[mesh_format]())
    part = PartLibrary(tmp_path).load('bracket')
    assert (part.mesh_format, part.warnings) == (mesh_format, ())
    assert load_part(file).part_sha256 == part.part_sha256
    expected = part_from_bytes(bracket().export(file_type='stl'), 'stl', 'bracket', unit='mm')
    np.testing.assert_allclose(part.centre_of_mass, expected.centre_of_mass, rtol=1e-5)
    np.testing.assert_allclose(part.inertia, expected.inertia, atol=1e-5 * expected.inertia.max())


def changed(data, change):
    """Return a 3MF with another text of its model."""
    packed = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as old, zipfile.ZipFile(packed, 'w') as new:
        for name in old.namelist():
            text = old.read(name)
            new.writestr(name, change(text) if name.endswith('.model') else text)
    return packed.getvalue()


THREE = trimesh.creation.box((10, 20, 30)).export(file_type='3mf')


def three(pattern, new):
    return changed(THREE, lambda text: re.sub(pattern, new, text, flags=re.DOTALL)), '3mf'


@pytest.mark.parametrize('unit', METRES)
def test_unit_of_a_3mf_is_the_one_it_states(unit):
    size = 0.03 / METRES[unit]
    data = trimesh.creation.box((size, size, size)).export(file_type='3mf')
    data = changed(
        data, lambda text: text.replace(b'unit="millimeter"', f'unit="{unit}"'.encode())
    )
    part = part_from_bytes(data, '3mf', 'cube')
    assert part.volume == pytest.approx(27e-6, rel=1e-6)
    other = 'mm' if part.unit != 'mm' else 'in'
    with pytest.raises(InvalidValueError, match=f'invalid unit {other!r}.* which is {part.unit}'):
        part_from_bytes(data, '3mf', 'cube', unit=other)


def test_3mf_without_a_unit_is_in_mm():
    without = three(b'unit="millimeter"', b'')
    assert part_from_bytes(*without, 'box').volume == pytest.approx(6e-6)


PLACES = {'block': (0, 0, 0), 'rod': (0, 0, 25), 'rod on its side': (60, 0, 0)}


def scene(mesh_format):
    """A block, a rod that stands on it, and the same rod on its side, away from them."""
    scale = 1e-3 if mesh_format == 'glb' else 1.0
    block, rod = trimesh.creation.box((40, 30, 20)), trimesh.creation.cylinder(5, 30, sections=32)
    found = trimesh.Scene()
    for name, place in PLACES.items():
        angle = np.pi / 2 if name == 'rod on its side' else 0.0
        matrix = trimesh.transformations.rotation_matrix(angle, (1, 0, 0))
        matrix[:3, 3] = np.array(place) * scale
        geometry, mesh = ('block', block) if name == 'block' else ('rod', rod)
        mesh = mesh.copy().apply_scale(scale)
        found.add_geometry(mesh, node_name=name, geom_name=geometry, transform=matrix)
    return found


@pytest.mark.parametrize('mesh_format', ['glb', '3mf'])
def test_bodies_are_chosen_by_name_or_number_where_they_are(mesh_format):
    data = scene(mesh_format).export(file_type=mesh_format)
    with pytest.raises(PartError, match=r"has 3 bodies.*\(1: 'block' .*, 3: 'rod"):
        part_from_bytes(data, mesh_format, 'p')
    found = {}
    for name, place in PLACES.items():
        part = found[name] = part_from_bytes(data, mesh_format, 'p', body=name)
        np.testing.assert_allclose(part.centre_of_mass * 1e3, place, atol=1e-5)
        again = part_from_bytes(data, mesh_format, 'p', body=part.body)
        assert again.part_sha256 == part.part_sha256
    assert found['block'].volume == pytest.approx(24e-6, rel=1e-6)
    heights = [np.ptp(found[name].vertices, axis=0)[2] for name in ('rod', 'rod on its side')]
    assert heights == pytest.approx([0.03, 0.01], rel=1e-6)


@pytest.mark.parametrize('mesh_format', ['glb', '3mf'])
def test_sheet_of_a_scene_is_left_out_and_named(mesh_format):
    data = bracket() if mesh_format == '3mf' else in_metres(bracket())
    sheet = trimesh.Trimesh([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)])
    both = trimesh.Scene({'bracket': data, 'ground': sheet})
    part = part_from_bytes(both.export(file_type=mesh_format), mesh_format, 'p')
    assert part.volume == pytest.approx(bracket().volume * 1e-9, rel=1e-6)
    (warning,) = part.warnings
    assert "is left out: 'ground'" in warning


def test_mirrored_body_faces_outward():
    mirror = np.diag((-1.0, 1.0, 1.0, 1.0))
    found = trimesh.Scene()
    found.add_geometry(in_metres(bracket()), node_name='a', transform=mirror)
    part = part_from_bytes(found.export(file_type='glb'), 'glb', 'p')
    centre = bracket().center_mass * (-1e-3, 1e-3, 1e-3)
    np.testing.assert_allclose(part.centre_of_mass, centre, rtol=1e-5)


def test_materials_do_not_split_a_body():
    """A GLB has a primitive of a mesh for each material; each is open here."""
    mesh = trimesh.creation.box((0.01, 0.02, 0.03))
    data = mesh.export(file_type='glb')
    length = struct.unpack_from('<I', data, 12)[0]
    header, rest = json.loads(data[20 : 20 + length]), data[20 + length :]
    (primitive,) = header['meshes'][0]['primitives']
    halves = []
    whole = header['accessors'][primitive['indices']]
    for k in range(2):
        offset = whole.get('byteOffset', 0) + 4 * 18 * k
        header['accessors'].append({**whole, 'count': 18, 'byteOffset': offset})
        halves.append({**primitive, 'indices': len(header['accessors']) - 1})
    header['meshes'][0]['primitives'] = halves
    text = json.dumps(header).encode()
    text += b' ' * (-len(text) % 4)
    packed = struct.pack('<I4s', len(text), b'JSON') + text + rest
    data = struct.pack('<4sII', b'glTF', 2, 12 + len(packed)) + packed
    assert part_from_bytes(data, 'glb', 'p').volume == pytest.approx(6e-6, rel=1e-6)


def test_glb_is_in_metres_and_its_centre_of_mass_needs_a_unit(tmp_path):
    (tmp_path / 'p.glb').write_bytes(GLB)
    with pytest.raises(InvalidValueError, match="invalid unit 'mm'"):
        part_from_bytes(GLB, 'glb', 'p', unit='mm')
    (tmp_path / 'p.yaml').write_text('centre_of_mass: [0.11, 0.01, 0.01]\n')
    with pytest.raises(PartError, match='missing unit'):
        PartLibrary(tmp_path).load('p')
    (tmp_path / 'p.yaml').write_text('centre_of_mass: [0.11, 0.01, 0.01]\nunit: m\n')
    np.testing.assert_allclose(PartLibrary(tmp_path).load('p').centre_of_mass, (0.11, 0.01, 0.01))


@pytest.mark.parametrize(('number', 'coarse'), [('{:.7g}', True), ('{:.9f}', False)])
def test_coarse_coordinates_of_a_3mf_give_a_warning(number, coarse):
    mesh = trimesh.creation.annulus(5, 10, 2, sections=64)
    mesh.apply_translation((1e5, 7e4, 3e4))
    words = (number.format(x).encode() for x in np.asarray(mesh.vertices).ravel())
    data = changed(
        mesh.export(file_type='3mf'),
        lambda text: re.sub(rb'(?<= [xyz]=")[^"]*', lambda _: next(words), text),
    )
    warnings = part_from_bytes(data, '3mf', 'washer').warnings
    assert len(warnings) == coarse
    assert all('are stored in steps of' in warning for warning in warnings)


BROKEN = {
    'empty GLB': (b'', 'glb', 'not a readable GLB'),
    'GLB, text not in UTF-8': (GLB.replace(b'"scenes"', b'"\xff\xfeenes"'), 'glb', 'not UTF-8'),
    '3MF that places nothing': (*three(b'<build.*/build>', b'<build/>'), 'no build item'),
    '3MF cut': (THREE[:-100], '3mf', 'not a readable 3MF'),
    '3MF, underscore': (*three(b'x="5.0"', b'x="5_0"'), 'not a readable 3MF'),
    '3MF, unit': (*three(b'unit="millimeter"', b'unit="parsec"'), "invalid unit 'parsec'"),
    '3MF, corner 8': (*three(b'v1="1"', b'v1="8"'), 'vertex number 8'),
}


@pytest.mark.filterwarnings('error')
@pytest.mark.parametrize('kind', BROKEN)
def test_error_for_a_broken_file(kind, capfd):
    data, mesh_format, expected = BROKEN[kind]
    with pytest.raises(PartError, match="part 'bracket'") as caught:
        part_from_bytes(data, mesh_format, 'bracket')
    assert expected in str(caught.value)
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 500
    assert capfd.readouterr() == ('', '')


def test_zip_that_would_fill_the_memory_is_refused(monkeypatch):
    assert scene_files.UNPACKED < 2**30
    monkeypatch.setattr(scene_files, 'UNPACKED', 1000)
    with pytest.raises(PartError, match=r'bytes after unpacking: expected at most 1000'):
        part_from_bytes(THREE, '3mf', 'p')
