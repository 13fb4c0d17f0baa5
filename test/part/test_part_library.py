"""The folder of parts: registration, content of YAML files, and reloading after a change."""

import contextlib
import os
from pathlib import Path

import pytest
import trimesh

from resting_aspects_ros.errors import PartError, UnknownPartError
from resting_aspects_ros.part.library import PartLibrary, load_part

BOX = trimesh.creation.box((10, 20, 30))
KEYS = 'unit, density, mass, centre_of_mass, inertia, body'


@pytest.fixture
def folder(tmp_path) -> Path:
    for name in ('pin.stl', 'cover.obj', 'bush.PLY'):
        BOX.export(tmp_path / name, file_type=Path(name).suffix[1:].lower())
    return tmp_path


def test_unknown_part_lists_those_that_are_registered(folder):
    with pytest.raises(
        UnknownPartError, match="known parts: bush, cover, pin; did you mean 'cover'"
    ):
        PartLibrary(folder).load('covre')


def test_part_name_is_not_a_path(folder):
    BOX.export(folder.parent / 'outside.stl')
    paths = ['../outside', '../outside.stl', 'pin.stl', str(folder / 'pin')]
    for name in [*paths, '', 'PIN']:
        with pytest.raises(UnknownPartError):
            PartLibrary(folder).load(name)


def test_a_missing_folder_has_no_parts(tmp_path):
    library = PartLibrary(tmp_path / 'missing')
    assert library.names() == []
    assert len(library.problems()) == 1
    with pytest.raises(UnknownPartError, match='known parts: none'):
        library.load('pin')


def test_unregistered_files_are_reported(folder):
    for name in ('Teil_1.STL', 'pin.ply', 'notes.txt'):
        BOX.export(folder / name, file_type='stl')
    (folder / 'cap.stl').mkdir()
    for name in ('clip.yaml', 'cover.yml'):
        (folder / name).write_text('unit: mm\n')
    library = PartLibrary(folder)
    problems = library.problems()
    assert library.names() == ['bush', 'cover']
    expected = [
        ('clip.yaml', 'not used'),
        ('cover.yml', '<part>.yaml'),
        ('Teil_1.STL', 'lower case letters'),
        ('pin.ply, pin.stl', 'expected one mesh'),
    ]
    for problem, words in zip(problems, expected, strict=True):
        assert all(word in problem for word in (str(folder), *words))


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


def test_centre_of_mass_without_a_unit_is_in_the_requested_one(folder):
    (folder / 'pin.yaml').write_text('centre_of_mass: [1, 2, -3.5]\n')
    part = load_part(folder / 'pin.stl', unit='cm')
    assert part.centre_of_mass.tolist() == pytest.approx([0.01, 0.02, -0.035])


@pytest.mark.parametrize(
    ('text', 'expected'),
    [
        ('desity: 7850', ["invalid key 'desity'", f'expected one of {KEYS}']),
        ('- unit: mm', ['not a list', 'mapping', KEYS]),
        ('unit: [', ['is not valid YAML']),
        ('unit: furlong', ["invalid unit 'furlong'", 'um, mm, cm, m, in, ft']),
        ('density: yes', ['invalid density True', 'finite number above 0']),
        ('centre_of_mass: [1, 2]', ['invalid centre_of_mass [1, 2]', '3 finite numbers']),
        ('body: 0', ['invalid body 0', 'an integer of at least 1']),
        ('density: 0x' + 'f' * 4000, ['invalid density', 'finite number above 0']),
    ],
)
def test_invalid_yaml_is_reported_with_the_expected_value(folder, text, expected):
    (folder / 'pin.yaml').write_text(text)
    with pytest.raises(PartError) as caught:
        PartLibrary(folder).load('pin')
    for word in [str(folder / 'pin.yaml'), *expected]:
        assert word in str(caught.value)
    assert '\n' not in str(caught.value)


def test_a_part_is_read_once_until_its_files_change(folder):
    library = PartLibrary(folder)
    first = library.load('pin')
    assert library.load('pin') is first

    (folder / 'pin.yaml').write_text('density: 2000')
    assert library.load('pin').mass == pytest.approx(2 * first.mass)

    trimesh.creation.box((10, 20, 60)).export(folder / 'pin.stl')
    os.utime(folder / 'pin.stl', ns=(0, 1))  # or the clock might be too coarse
    longer = library.load('pin')
    assert longer.volume == pytest.approx(2 * first.volume)

    (folder / 'pin.stl').unlink()
    with pytest.raises(UnknownPartError):
        library.load('pin')


def test_invalid_mesh_raises_until_it_is_repaired(folder):
    library = PartLibrary(folder)
    (folder / 'pin.stl').write_bytes(b'x')
    for _ in range(2):
        with pytest.raises(PartError, match=r'pin\.stl.*not an STL'):
            library.load('pin')
    BOX.export(folder / 'pin.stl')
    assert library.load('pin').volume == pytest.approx(6e-6)


@pytest.mark.slow
def test_invalid_file_does_not_affect_other_parts(folder):
    BOX.export(folder / 'bad_yaml.stl')
    (folder / 'bad_yaml.yaml').write_text('[' * 5000)
    (folder / 'bad_mesh.obj').write_text('v ' + '0' * 100_000 + 'x\n')
    BOX.export(folder / 'bad_folder.stl')
    (folder / 'bad_folder.yaml').mkdir()
    (folder / 'long.stl').symlink_to('x' * 300)
    (folder / 'loop.stl').symlink_to('loop.stl')
    library = PartLibrary(folder)
    good = []
    for name in library.names():
        with contextlib.suppress(PartError):
            good.append(library.load(name).name)
    assert good == ['bush', 'cover', 'pin']
