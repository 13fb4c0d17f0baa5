"""Flag --body: one body of a mesh with several bodies, in all commands that accept a mesh."""

import json

import pytest
import trimesh

import resting_aspects_ros as ra
from resting_aspects_ros.cli import main


@pytest.fixture
def two(tmp_path, monkeypatch):
    """Write a mesh of a box of 20 x 30 x 40 mm and a smaller box beside it."""
    large = trimesh.creation.box((20, 30, 40))
    small = trimesh.creation.box((10, 12, 14))
    small.apply_translation((50, 0, 0))
    trimesh.util.concatenate([small, large]).export(tmp_path / 'two.stl')
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def ended(capsys):
    """Run a command; returns exit code, standard output and standard error."""

    def ended(*words):
        code = main.main([str(word) for word in words])
        return code, *capsys.readouterr()

    return ended


@pytest.mark.slow
def test_every_command_that_takes_a_mesh_takes_a_body(two, ended):
    commands = (('aspects',), ('estimate',), ('drop', '--drops', 20, '--out', 'o'))
    for command, *words in commands:
        code, _, error = ended(command, 'two.stl', *words)
        assert code == 2
        assert (
            '2 bodies that do not touch each other (1: 20 x 30 x 40 mm, 2: 10 x 12 x 14 mm)'
            in (error)
        )
        code, out, _ = ended(command, 'two.stl', *words, '--body', 2)
        assert code == 0
        assert ('10 x 12 x 14 mm' in out) == (command != 'estimate')  # its title has no size
    document = json.loads((two / 'o' / 'distribution.json').read_text())
    assert document['body'] == 2
    code, out, error = ended('report', 'o/distribution.json', '--out', 'page')
    assert (code, error) == (0, '')
    assert '10 x 12 x 14 mm' in (two / 'page' / 'report.html').read_text()
    code, out, _ = ended('classify', 'o/poses.csv', '--part', 'two.stl', '--body', 2)
    assert code == 0


@pytest.mark.parametrize('body', ['small box', '2'])
def test_body_is_chosen_by_its_name_or_number(two, ended, body):
    meshes = trimesh.load_mesh('two.stl').split()
    meshes = sorted(meshes, key=lambda mesh: mesh.volume)
    names = ('small box', 'large box')
    trimesh.Scene(dict(zip(names, meshes, strict=True))).export('two.3mf')
    code, _, error = ended('aspects', 'two.3mf')
    assert code == 2
    assert "1: 'large box' 20 x 30 x 40 mm, 2: 'small box' 10 x 12 x 14 mm" in error
    code, out, _ = ended('aspects', 'two.3mf', '--body', body)
    assert code == 0
    assert '10 x 12 x 14 mm' in out
    code, _, error = ended('aspects', 'two.stl', '--body', 'small box')
    assert code == 2
    assert "invalid body 'small box' of mesh 'two.stl': expected 1 to 2" in error


def test_name_that_is_a_number_takes_precedence(two, ended):
    small, large = sorted(trimesh.load_mesh('two.stl').split(), key=lambda mesh: mesh.volume)
    trimesh.Scene({'1': small, '7': large}).export('two.3mf')
    for body, size in (('1', '10 x 12 x 14'), ('7', '20 x 30 x 40'), ('2', '10 x 12 x 14')):
        code, out, _ = ended('aspects', 'two.3mf', '--body', body)
        assert (code, f'{size} mm' in out) == (0, True)
    # A number in a result or in Python is a number.
    assert ra.load_part('two.3mf', body='1').body == 2
    assert ra.load_part('two.3mf', body=1).body == 1
    (two / 'two.yaml').write_text('body: "7"')
    assert ended('aspects', 'two.3mf', '--body', '7')[0] == 0
    assert ended('aspects', 'two.3mf', '--body', '1')[0] == 2


@pytest.mark.parametrize(
    ('words', 'sheet', 'message'),
    [
        (['two.stl', '--body', 3], '', 'invalid body 3 of mesh'),
        (
            ['two.stl', '--body', 1],
            'body: 2',
            "invalid body 1: expected 2, the body in 'two.yaml'",
        ),
        (['l_bracket', '--body', 1], '', 'invalid body 1: expected only with a mesh file'),
    ],
)
def test_invalid_body_is_refused(two, ended, words, sheet, message):
    if sheet:
        (two / 'two.yaml').write_text(sheet)
    code, _, error = ended('aspects', *words)
    assert (code, error.count('\n')) == (2, 1)
    assert message in error


def test_yaml_beside_a_mesh_selects_the_body_for_every_command(two, ended):
    (two / 'two.yaml').write_text('body: 2\nunit: mm\n')
    for words in (['two.stl'], ['two.stl', '--body', 2], ['two', '--parts', '.']):
        code, out, _ = ended('aspects', *words)
        assert code == 0
        assert '10 x 12 x 14 mm' in out
