"""Invalid values of flags: exit code 2, and one line that states what was expected."""

import json
import os

import pytest


@pytest.mark.parametrize(
    ('words', 'says'),
    [
        (['--height', '60parsec'], ['--height', "'60parsec'", 'mm, cm']),
        (['--height', 'nan'], ['--height', "'nan'", 'a number']),
        (['--height', '-3mm'], ['height', '-0.003', 'more than 0 and at most 100 m']),
        (['--height=-3mm'], ['height', '-0.003', 'more than 0 and at most 100 m']),
        (['--friction', '-.5'], ['friction', '-0.5', '0 to 10']),
        (['--restitution', '1e999'], ['restitution', 'inf', '0 to 1']),
        (['--drops', '0'], ['drops', '0', '1 to 2000000']),
        (['--drops', '1e-3'], ['--drops', "'1e-3'", 'not an integer']),
        (['--drops', '1000000000000'], ['drops', '1000000000000', '1 to 2000000']),
        (['--seed', '-1'], ['seed', '-1', '0 to 18446744073709551615']),
        (['--workers', '0'], ['workers', '0', '1 to 1024']),
        (['--workers', 'two'], ['--workers', "'two'", 'not an integer']),
        (['--surface', 'ice'], ["'ice'", 'rubber_mat']),
        (['--unit', 'mm'], ['unit', "'mm'", "'tetrahedron'"]),
        (['--height-of', 'top'], ['--height-of', 'LOWEST_POINT', 'CENTRE_OF_MASS']),
        (['--height', '1mm', '--height-of', 'CENTRE_OF_MASS'], ['0.001 m', 'more than']),
        (['--parts', 'nowhere'], ['folder of parts', "'nowhere'", 'folder']),
        (['--confidence', '95'], ['confidence', '95', '0.95']),
        (['--friktion', '1'], ['--friktion']),
        (['--drop', '5'], ['--drop']),
        (['--seed'], ['--seed']),
        (['--two\nlines'], ['two lines']),
    ],
    ids=' '.join,
)
def test_invalid_value_is_refused(refused, words, says):
    line = refused('drop', 'tetrahedron', *words)
    for word in says:
        assert word in line


def test_an_unknown_flag_names_the_help_of_its_command(refused):
    line = refused('reorient', 'tetrahedron', '--export', 'map.json')
    assert line.endswith('(see resting_aspects reorient --help)')


@pytest.fixture
def blocked(tmp_path):
    """Write a file in place of a folder."""
    path = tmp_path / 'file'
    path.write_text('', encoding='utf-8')
    return path


@pytest.mark.parametrize(
    ('flag', 'value', 'says'),
    [
        ('--out', 'file', 'exists'),
        ('--out', 'file/below', 'Not a directory'),
        ('--poses', 'nowhere/p.csv', "the folder 'nowhere' does not exist"),
        ('--poses', 'folder', 'this is a folder'),
        ('--out', '/proc/self', 'expected a folder that can be made and written'),
        ('--log', '/proc/self', 'expected a folder that can be made and written'),
        ('--poses', '/proc/p.csv', 'expected a file that can be written'),
    ],
)
def test_unwritable_output_is_refused_before_the_drops(
    refused, tmp_path, blocked, flag, value, says
):
    (tmp_path / 'folder').mkdir()
    # The deadline is too short for this number of drops.
    line = refused('drop', 'l_bracket', '--drops', 2_000_000, flag, value)
    assert f"invalid {flag} '{value}" in line
    assert says in line


def test_folder_in_place_of_an_output_file_is_refused(refused, tmp_path):
    (tmp_path / 'o' / 'distribution.png').mkdir(parents=True)
    line = refused('drop', 'l_bracket', '--drops', 2_000_000, '--out', 'o')
    assert os.path.join('o', 'distribution.png') in line  # noqa: PTH118


def test_full_disk_prints_one_line_and_keeps_the_result(run):
    ended = run('drop', 'tetrahedron', '--drops', 3, '--poses', '/dev/full', '--json')
    assert ended.returncode == 1
    assert json.loads(ended.stdout)['drops'] == 3
    assert ended.stderr.splitlines()[-1] == (
        "error: '/dev/full' cannot be written: No space left on device; the result has 3 of 3 "
        'drops'
    )
    assert 'Traceback' not in ended.stderr
