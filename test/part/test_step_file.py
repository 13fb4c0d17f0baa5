"""STEP files: their bodies are their solids, with their names, in the unit that they state."""

import re
import sys

import numpy as np
import pytest
from fuzz.step_text import StepFile, box_faces, step_text

from resting_aspects_ros.errors import InvalidValueError, PartError
from resting_aspects_ros.part import scene_files
from resting_aspects_ros.part.library import PartLibrary
from resting_aspects_ros.part.loading import load_part, part_from_bytes
from resting_aspects_ros.part.scene_files import DEVIATIONS, glb_from_step, read_scene

FLOAT32 = 3e-7
BOX = box_faces((10, 20, 30))


@pytest.fixture
def save(tmp_path):
    """Write a STEP file, or its text; returns its path."""

    def write(file, name='file.step'):
        path = tmp_path / name
        path.write_text(file if isinstance(file, str) else file.text())
        return path

    return write


def box(file, name, sides, at=(0, 0, 0)):
    return file.solid(name, file.polygons(*box_faces(sides, at)))


def sheet(file, name, at):
    """A square of 60 mm."""
    corners, faces = box_faces((60, 60, 1), at)
    return file.sheet(name, file.polygons(corners, faces[4:5]))


def in_glb(file):
    """Return a function that gives a body of a STEP file, which is converted only once."""
    data, _ = glb_from_step(file.text().encode(), 'file')
    return lambda body=None: part_from_bytes(data, 'glb', 'p', body=body)


def check_box(part, sides, centre, **tolerance):
    volume = np.prod(sides) * 1e-9
    assert part.volume == pytest.approx(volume, rel=4 * FLOAT32)
    np.testing.assert_allclose(part.centre_of_mass * 1e3, centre, **tolerance or {'rtol': FLOAT32})


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize(('unit', 'scale'), [('.MILLI.', 1), ('$', 1000)])
def test_unit_is_that_of_the_file(save, unit, scale):
    file = save(step_text(BOX[0] / scale, BOX[1], unit), 'Box 1.stp')
    part = load_part(file, unit='mm')
    check_box(part, (10, 20, 30), (5, 10, 15), rtol=1e-5)
    assert (part.name, part.warnings) == ('box_1', ())
    with pytest.raises(InvalidValueError, match='expected none, because the file has its own'):
        load_part(file, unit='cm')


@pytest.mark.slow
def test_cylinder_is_within_the_deviation_of_its_formula(save):
    """Its polygon of n corners is within the deviation of the circle, and so is its area."""
    file = StepFile()
    file.product('pin', [file.solid('', file.tube(10, 20))])
    part = load_part(save(file))
    volume = np.pi * 0.01**2 * 0.02
    assert volume * (1 - 2 * DEVIATIONS[0][0] / 10) < part.volume < volume
    np.testing.assert_allclose(part.centre_of_mass, (0, 0, 0.01), atol=1e-8)


def test_cavity_belongs_to_its_solid():
    file = StepFile()
    inner = file.polygons(*box_faces((5, 5, 5), (2, 2, 2)))
    hollow = file.solid('hollow', file.polygons(*BOX), inner)
    file.product('part', [hollow, box(file, 'beside', (5, 5, 5), (50, 0, 0))])
    assert in_glb(file)('hollow').volume == pytest.approx((6000 - 125) * 1e-9, rel=4 * FLOAT32)


def test_sheets_and_wires_are_left_out_and_named(save):
    """One sheet lies above the box, one begins at an edge of it."""
    file = StepFile()
    datum, ledge = (sheet(file, name, (0, 0, z)) for name, z in (('datum', 50), ('ledge', 30)))
    block = box(file, 'block', (10, 20, 30))
    axis = file.wire('axis', (0, 0, -50), (0, 0, 50))
    file.product('part', [datum, block, ledge, axis])
    part = load_part(save(file))
    check_box(part, (10, 20, 30), (5, 10, 15))
    (warning,) = part.warnings
    for name in ('left out', 'datum', 'ledge', 'axis'):
        assert name in warning
    assert 'block' not in warning


@pytest.mark.slow
def test_file_without_a_solid_is_refused(save):
    file = StepFile()
    surface = 'MANIFOLD_SURFACE_SHAPE_REPRESENTATION'
    file.product('plane', [sheet(file, 'top plane', (0, 0, 0))], surface)
    with pytest.raises(PartError, match='has no solid'):
        load_part(save(file))


def assembly():
    """A bolt, and two nuts that touch it and each other, with a common side."""
    file = StepFile()
    bolt = file.product('bolt', [box(file, 'x', (10, 10, 30))])
    nut = file.product('nut', [box(file, 'y', (10, 10, 5))])
    parts = [('bolt:1', bolt, (0, 0, 0)), ('nut:1', nut, (0, 0, 30)), ('nut:2', nut, (0, 0, 35))]
    file.assembly('whole', parts)
    return file


def test_touching_bodies_of_an_assembly_are_one_part_or_chosen():
    body = in_glb(assembly())
    part = body()
    check_box(part, (10, 10, 40), (5, 5, 20))
    (warning,) = part.warnings
    for word in ('3 bodies', "1: 'bolt:1' 10 x 10 x 30 mm", 'nut:1', 'nut:2', '--body'):
        assert word in warning
    for chosen, height, middle in (('bolt:1', 30, 15), ('nut:1', 5, 32.5), (3, 5, 37.5)):
        check_box(body(chosen), (10, 10, height), (5, 5, middle))
    for unknown in (0, 'nut', True):
        with pytest.raises(InvalidValueError, match=r"invalid body .* 1 to 3, .*'bolt:1'"):
            body(unknown)


NAMES = {
    r'Geh\X2\00E4\X0\use': 'Gehäuse',
    r'Geh\X\E4use': 'Gehäuse',
    r'\X2\30DC30EB30C8\X0\ M6': 'ボルト M6',
    r'\X4\0001F5290001F527\X0\1': '\U0001f529\U0001f5271',
    r'a\\X2\\b': r'a\X2\b',
    "d''x": "d'x",
    r'\X2\00E\X0\1': r'\X2\00E\X0\1',
}


def test_names_of_solids_are_those_of_the_cad_program():
    """The first two are equal, so that they are numbered."""
    file = StepFile()
    sizes = range(20, 20 - len(NAMES), -1)
    places = [(50 * k, 0, 0) for k in range(len(NAMES))]
    given = zip(NAMES, sizes, places, strict=True)
    file.product('box', [box(file, name, (10, 10, size), at) for name, size, at in given])
    data, _ = glb_from_step(file.text().encode(), 'file')
    names = [body.name for body in read_scene(data, 'glb', 'file').bodies]
    assert [name.removesuffix(f'_{k}') for k, name in enumerate(names)] == list(NAMES.values())


def thin_tube(wall, turn=0.025):
    """A tube of 10 mm: coarse polygons of its circles, of different angles, cross each other."""
    file = StepFile()
    file.product('tube', [file.solid('', file.tube(10, 20, 10 - wall, turn))])
    return file


@pytest.mark.slow
def test_gap_of_the_triangles_is_closed_by_other_deviations(save):
    wall = 0.002
    part = load_part(save(thin_tube(wall)))
    volume = np.pi * (10**2 - (10 - wall) ** 2) * 20e-9
    assert part.volume == pytest.approx(volume, rel=2 * DEVIATIONS[0][0] / 10)


@pytest.mark.slow
def test_gap_that_cannot_be_closed_suggests_an_stl(save, monkeypatch):
    monkeypatch.setattr(scene_files, 'DEVIATIONS', DEVIATIONS[:2])
    with pytest.raises(PartError, match=r'not closed: .* export an STL'):
        load_part(save(thin_tube(1e-5, 0.0171)))


def test_reader_prints_nothing(save, capfd):
    """One file has a reference to an entity that does not exist, the others are damaged."""
    unresolved = "DATA;\n#9998=PRODUCT_RELATED_PRODUCT_CATEGORY('','',(#9999));"
    load_part(save(step_text(*BOX).replace('DATA;', unresolved)))
    for damaged in ('solid x', step_text(*BOX)[:3000]):
        with pytest.raises(PartError, match='STEP file'):
            load_part(save(damaged))
    assert capfd.readouterr() == ('', '')


def test_missing_package_is_named_with_its_installation(save, monkeypatch):
    monkeypatch.setitem(sys.modules, 'cascadio', None)
    with pytest.raises(PartError, match='needs cascadio: pip install cascadio'):
        load_part(save(step_text(*BOX)))


def test_file_that_crashes_the_reader_gives_an_error(save):
    """Open CASCADE accesses memory that it must not access."""
    text = re.sub(r"VECTOR\('',#\d+", "VECTOR('',$", step_text(*BOX), count=1)
    with pytest.raises(PartError, match=r'cannot be read .* signal 11'):
        load_part(save(text))


def test_folder_of_parts_takes_step_files(save, tmp_path):
    save(assembly(), 'nut.step')
    (tmp_path / 'nut.yaml').write_text('body: "nut:2"\ncentre_of_mass: [5, 5, 38]\n')
    part = PartLibrary(tmp_path).load('nut')
    np.testing.assert_allclose(part.centre_of_mass, (0.005, 0.005, 0.038))
    assert part.body == 3
