"""The named surroundings of config/surroundings, and changes of single values."""

import pytest

from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.simulation.conditions import surroundings_folder
from resting_aspects_ros.simulation.surroundings import named_surroundings, surroundings_names


@pytest.mark.parametrize('name', surroundings_names())
def test_every_file_can_be_used_and_has_its_source(name, mat):
    found = named_surroundings(name)
    assert found.name == name
    assert found.scene(mat, 0.02).bodies
    text = (surroundings_folder() / f'{name}.yaml').read_text()
    assert '\nsource: ' in text
    assert text.startswith('# ')


def test_changes_have_units_and_name_bodies_with_a_dot():
    plain = named_surroundings('l_chute')
    assert plain.shape.roll == pytest.approx(0.7853981633974483)  # as published
    assert plain.bodies['wall'] == {'friction': 0.2}
    changes = {'roll': '30deg', 'belt.friction': 0.5, 'release.y_min': '10mm'}
    chute = named_surroundings('l_chute', changes)
    assert chute.shape.roll == pytest.approx(0.5235987755982988)
    assert chute.bodies['belt'] == {'friction': 0.5, 'speed': 0.1}
    assert chute.release == {'y_min': 0.01}
    assert named_surroundings('chute').shape.kind == 'chute'


def test_a_file_of_its_own(tmp_path):
    path = tmp_path / 'mine.yaml'
    path.write_text('kind: slope\nangle: 12deg\n')
    found = named_surroundings(path)
    assert (found.name, found.text) == ('mine', 'mine (angle 12 deg)')


@pytest.mark.parametrize(
    ('text', 'says'),
    [
        ('kind: [', 'is not valid YAML'),
        ('', 'invalid surroundings None'),
        ('- 1', r'invalid surroundings \[1\]'),
        ('kind: [slope]', r"invalid kind of surroundings \['slope'\]: expected one of plane"),
        ('kind: mesh\nmesh: [1]', r'invalid mesh \[1\]: expected text'),
        ('kind: mesh\nmesh: a.stl\nmesh_sha256: {}', 'invalid mesh_sha256 {}: expected text'),
        ('kind: slope\nangle: 1' + 400 * '0', 'invalid angle 1000.*: expected 0 to'),
        ('kind: slope\nkind: wall', "the key 'kind' occurs twice"),
        ('kind: slope\nangle: 12mm', "angle '12mm'.*rad, deg"),
        ('kind: mesh\nmesh: no.stl', 'no.stl.*does not exist'),
    ],
)
def test_errors_name_the_file(tmp_path, text, says):
    path = tmp_path / 'mine.yaml'
    path.write_text(text)
    with pytest.raises(InvalidValueError, match=says) as caught:
        named_surroundings(path)
    assert 'mine.yaml' in str(caught.value)
    assert '\n' not in str(caught.value)
