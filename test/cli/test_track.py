"""`resting_aspects track`: its output, files and exit codes."""

import json

import pytest


@pytest.mark.slow
def test_files_have_what_the_flags_state(run, tmp_path):
    words = ('--width', '40mm', '--roll', '10deg', '--speed', '80mm/s', '--fill', '0.5')
    walls = ('--wall-height', '20mm', '--wall-friction', '0.1', '--trap', 'wiper:height=12mm')
    more = ('--drops', 50, '--out', '.', '--report')
    ended = run('track', 'hex_nut', *words, *walls, *more)
    assert ended.returncode == 0, ended.stderr
    names = {file.name for file in tmp_path.iterdir()}
    assert names >= {'track.json', 'orientations.csv', 'orientations.png', 'track.html'}
    document = json.loads((tmp_path / 'track.json').read_text(encoding='utf-8'))
    assert [trap['kind'] for trap in document['traps']] == ['wiper']
    track = document['track']
    assert (track['width'], track['speed'], track['fill']) == (0.04, 0.08, 0.5)
    assert track['wall'] == {'height': 0.02, 'friction': 0.1}


@pytest.mark.slow
def test_no_design_exits_with_1_and_shows_the_rows(run):
    ended = run('track', 't_prism', '--design', '--want', '4', '--drops', 50)
    assert ended.returncode == 1
    assert 'No set of traps passes only row 4' in ended.stdout
    assert max(map(len, ended.stdout.splitlines())) <= 80
