"""Flag --body: one body of a mesh with several bodies, in all commands that accept a mesh."""

import json

import pytest
import trimesh

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


def test_yaml_beside_a_mesh_selects_the_body_for_every_command(two, ended):
    (two / 'two.yaml').write_text('body: 2\nunit: mm\n')
    for words in (['two.stl'], ['two.stl', '--body', 2], ['two', '--parts', '.']):
        code, out, _ = ended('aspects', *words)
        assert code == 0
        assert '10 x 12 x 14 mm' in out
