"""The folder of parts: what is registered, what its YAML may say, and when it is read again."""

import os
from pathlib import Path

import pytest
import trimesh

from resting_aspects_ros.core.errors import InvalidValueError, PartError, UnknownPartError
from resting_aspects_ros.drops.part_library import PartLibrary, read_part_yaml

BOX = trimesh.creation.box((10, 20, 30))
KEYS = 'unit, density, mass, centre_of_mass, inertia'


@pytest.fixture
def folder(tmp_path) -> Path:
    for name in ('pin.stl', 'cover.obj', 'bush.PLY'):
        BOX.export(tmp_path / name, file_type=Path(name).suffix[1:].lower())
    return tmp_path


def test_meshes_of_all_kinds_are_registered_sorted(folder):
    library = PartLibrary(folder)
    assert library.names() == ['bush', 'cover', 'pin']
    assert library.problems() == []
    for name in library.names():
        assert library.load(name).volume == pytest.approx(6e-6)
    assert library.load('cover').name == 'cover'


def test_new_file_is_registered_at_once(folder):
    library = PartLibrary(folder)
    assert 'clip' not in library.names()
    BOX.export(folder / 'clip.stl')
    assert library.load('clip').name == 'clip'


def test_unknown_part_lists_those_that_are_registered(folder):
    with pytest.raises(UnknownPartError) as caught:
        PartLibrary(folder).load('covre')
    assert str(caught.value) == (
        "part 'covre' is not known, known are bush, cover, pin; did you mean 'cover'?"
    )
    with pytest.raises(UnknownPartError, match=r'known are bush, cover, pin$'):
        PartLibrary(folder).load('xyz')


def test_a_name_is_no_path(folder):
    BOX.export(folder.parent / 'outside.stl')
    paths = ['../outside', '../outside.stl', 'pin.stl', str(folder / 'pin')]
    for name in [*paths, '', 'PIN', 'x' * 999]:
        with pytest.raises(UnknownPartError):
            PartLibrary(folder).load(name)


@pytest.mark.parametrize('where', ['missing', 'empty'])
def test_a_folder_without_parts_has_none(tmp_path, where):
    (tmp_path / 'empty').mkdir()
    library = PartLibrary(tmp_path / where)
    assert library.names() == []
    assert len(library.problems()) == (where == 'missing')
    with pytest.raises(UnknownPartError, match='known are none'):
        library.load('pin')


def test_files_that_are_not_registered_are_told(folder):
    for name in ('Teil_1.STL', 'pin.ply', 'notes.txt'):
        BOX.export(folder / name, file_type='stl')
    (folder / 'cap.stl').mkdir()
    for name in ('clip.yaml', 'cover.yml'):
        (folder / name).write_text('unit: mm\n')
    library = PartLibrary(folder)
    problems = library.problems()
    assert library.names() == ['bush', 'cover']
    assert len(problems) == 4
    for problem, words in zip(
        problems,
        (
            ['clip.yaml', 'not used'],
            ['cover.yml', '<part>.yaml'],
            ['Teil_1.STL', 'lower case letters'],
            ['pin.ply, pin.stl', 'only one mesh'],
        ),
        strict=True,
    ):
        assert str(folder) in problem
        for word in words:
            assert word in problem


def test_yaml_gives_unit_and_mass_properties(folder):
    (folder / 'pin.yaml').write_text(
        '# a comment\nunit: cm\nmass: 2\ncentre_of_mass: [1, 2, -3.5]\n'
        'inertia: [0.02, 0, 1e-4, 1.5e-2, 0, 0.01]\n'
    )
    part = PartLibrary(folder).load('pin')
    assert (part.unit, part.mass) == ('cm', 2)
    assert part.centre_of_mass.tolist() == pytest.approx([0.01, 0.02, -0.035])
    assert part.inertia[0].tolist() == [0.02, 0, 1e-4]
    assert part.volume == pytest.approx(6e-3)


def test_yaml_gives_density(folder):
    (folder / 'pin.yaml').write_text('density: 7850')
    assert PartLibrary(folder).load('pin').mass == pytest.approx(7850 * 6e-6)


@pytest.mark.parametrize('text', ['', '# nothing yet\n', '{}'])
def test_yaml_may_say_nothing(folder, text):
    (folder / 'pin.yaml').write_text(text)
    assert PartLibrary(folder).load('pin').mass == pytest.approx(6e-3)


@pytest.mark.parametrize(
    ('text', 'words'),
    [
        ('desity: 7850', ["unknown key 'desity'", f'allowed are {KEYS}']),
        ('1: 2', ['unknown key 1', f'allowed are {KEYS}']),
        ('- unit: mm', ['is a list', 'mapping', KEYS]),
        ('mm', ['is a str', 'mapping', KEYS]),
        ('unit: [', ['is not YAML']),
        ('unit: \x00', ['is not YAML']),
        ('unit: !!python/name:os.system', ['is not YAML']),
        ('unit: furlong', ["unit: 'furlong'", 'um, mm, cm, m, in, ft']),
        ('unit: [mm]', ["unit: ['mm']", 'um, mm, cm, m, in, ft']),
        ('density: heavy', ["density: 'heavy'", 'finite number above 0']),
        ('density: .nan', ['density: nan', 'finite number above 0']),
        ('density: .inf', ['density: inf', 'finite number above 0']),
        ('density: -1', ['density: -1', 'finite number above 0']),
        ('density: yes', ['density: True', 'finite number above 0']),
        ('density:', ['density: None', 'finite number above 0']),
        ('mass: [1]', ['mass: [1]', 'finite number above 0']),
        ('mass: 0', ['mass: 0', 'finite number above 0']),
        ('centre_of_mass: 1', ['centre_of_mass: 1', 'list of 3 finite numbers']),
        ('centre_of_mass: [1, 2]', ['centre_of_mass: [1, 2]', 'list of 3 finite numbers']),
        ('centre_of_mass: [1, 2, .nan]', ['[1, 2, nan]', 'list of 3 finite numbers']),
        ('centre_of_mass: {x: 1}', ["{'x': 1}", 'list of 3 finite numbers']),
        ('inertia: [1, 0, 0, 1]', ['inertia: [1, 0, 0, 1]', 'list of 6 finite numbers']),
        ('density: 1\n' + '#' * 70000, ['more than 65536 bytes']),
    ],
)
def test_yaml_that_is_not_allowed_is_told_with_what_is(folder, text, words):
    (folder / 'pin.yaml').write_text(text)
    with pytest.raises(PartError) as caught:
        PartLibrary(folder).load('pin')
    for word in [str(folder / 'pin.yaml'), *words]:
        assert word in str(caught.value)
    assert '\n' not in str(caught.value)


def test_values_that_only_the_part_can_judge_are_told_too(folder):
    (folder / 'pin.yaml').write_text('density: 1\nmass: 2')
    with pytest.raises(InvalidValueError, match=r'both a density \(1.0\) and a mass \(2.0\)'):
        PartLibrary(folder).load('pin')
    (folder / 'pin.yaml').write_text('centre_of_mass: [0, 0, 15.1]')
    with pytest.raises(InvalidValueError, match='must lie inside the convex hull'):
        PartLibrary(folder).load('pin')


def test_yaml_that_grows_without_end_when_shown_is_cut(tmp_path):
    bomb = 'centre_of_mass:\n- &a [x, x, x, x]\n' + ''.join(
        f'- &{chr(98 + i)} [{", ".join(["*" + chr(97 + i)] * 9)}]\n' for i in range(20)
    )
    (tmp_path / 'pin.yaml').write_text(bomb)
    with pytest.raises(PartError, match='list of 3 finite numbers') as caught:
        read_part_yaml(tmp_path / 'pin.yaml')
    assert len(str(caught.value)) < 600


def test_yaml_that_is_a_folder_is_told(folder):
    (folder / 'pin.yaml').mkdir()
    with pytest.raises(PartError, match=r'pin\.yaml.*cannot be read'):
        PartLibrary(folder).load('pin')


def test_a_part_is_read_once_until_its_files_change(folder):
    library = PartLibrary(folder)
    first = library.load('pin')
    assert library.load('pin') is first

    (folder / 'pin.yaml').write_text('density: 2000')
    heavier = library.load('pin')
    assert heavier.mass == pytest.approx(2 * first.mass)
    assert library.load('pin') is heavier

    trimesh.creation.box((10, 20, 60)).export(folder / 'pin.stl')
    os.utime(folder / 'pin.stl', ns=(0, 1))  # a clock too coarse to see the change is no excuse
    longer = library.load('pin')
    assert longer.volume == pytest.approx(2 * first.volume)

    (folder / 'pin.yaml').unlink()
    assert library.load('pin').mass == pytest.approx(2 * first.mass)

    (folder / 'pin.stl').unlink()
    with pytest.raises(UnknownPartError):
        library.load('pin')


def test_a_bad_mesh_is_an_error_each_time_until_it_is_repaired(folder, monkeypatch):
    library = PartLibrary(folder)
    (folder / 'pin.stl').write_bytes(b'x')
    reads = []
    read = Path.read_bytes
    monkeypatch.setattr(Path, 'read_bytes', lambda path: reads.append(path) or read(path))
    for _ in range(3):
        with pytest.raises(PartError, match=r'pin\.stl.*not an STL'):
            library.load('pin')
    assert reads == [folder / 'pin.stl']
    BOX.export(folder / 'pin.stl')
    assert library.load('pin').volume == pytest.approx(6e-6)
