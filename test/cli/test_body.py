"""Flag --body: one body of a mesh with several bodies, in all commands that accept a mesh."""

import json

import pytest
import trimesh

SMALL = '10 x 12 x 14 mm'


@pytest.fixture(autouse=True)
def two(tmp_path):
    """Write a mesh of a box of 20 x 30 x 40 mm and a smaller box beside it."""
    large = trimesh.creation.box((20, 30, 40))
    small = trimesh.creation.box((10, 12, 14))
    small.apply_translation((50, 0, 0))
    trimesh.util.concatenate([small, large]).export(tmp_path / 'two.stl')


@pytest.mark.slow
def test_a_body_is_used_by_all_commands(run, refused, tmp_path):
    assert SMALL in refused('drop', 'two.stl')
    few = ('--drops', 20, '--out', 'o')
    for words in (('aspects', 'two.stl'), ('drop', 'two.stl', *few)):
        assert SMALL in run(*words, '--body', 2).stdout
    assert json.loads((tmp_path / 'o' / 'distribution.json').read_text())['body'] == 2
    assert run('report', 'o/distribution.json', '--out', 'page').returncode == 0
    assert SMALL in (tmp_path / 'page' / 'report.html').read_text()
    ended = run('classify', 'o/poses.csv', '--part', 'two.stl', '--body', 2)
    assert ended.returncode == 0, ended.stderr
