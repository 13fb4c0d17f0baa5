"""The command `drop` with several parts or a folder."""

import shutil

import pytest

from resting_aspects_ros.system import parts_folder


@pytest.fixture
def meshes(tmp_path):
    """A folder with two designs of a part and a broken file."""
    folder = tmp_path / 'designs'
    folder.mkdir()
    for name in ('one', 'two'):
        shutil.copy(parts_folder() / 'tetrahedron.stl', folder / f'{name}.stl')
    (folder / 'broken.stl').write_text('hello')
    return folder


@pytest.mark.slow
def test_one_bad_file_does_not_cost_the_others(run, tmp_path, meshes):
    ended = run('drop', 'designs', 'missing.stl', '--drops', 20, '--workers', 1, '--out', 'out')
    assert ended.returncode == 1
    words = [line.split() for line in ended.stdout.splitlines()]
    for begin in ('one 1 to 4 100 %', 'two 1 to 4 100 %', 'Model range:', 'Index: out/'):
        assert sum(' '.join(each).startswith(begin) for each in words) == 1
    assert "broken.stl' is not an STL" in ended.stderr
    assert "'missing.stl' does not exist" in ended.stderr
    index = (tmp_path / 'out/index.html').read_text()
    for text in (
        'href="one/report.html"',
        'href="two/report.html"',
        'one and two side by side',
        '2 of 4 parts failed',
        'missing.stl',
    ):
        assert text in index
    for name in ('one', 'two'):
        assert (tmp_path / 'out' / name / 'report.html').is_file()
        assert (tmp_path / 'out' / name / 'distribution.json').is_file()
