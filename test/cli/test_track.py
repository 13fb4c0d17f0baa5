"""`resting_aspects track`: its output, files and exit codes."""

import csv
import json

import pytest


@pytest.fixture
def done(run):
    """Run the command with few drops; returns what it printed."""

    def text(*words, code=0):
        ended = run('track', *words, '--drops', '50')
        assert ended.returncode == code, ended.stderr
        return ended.stdout

    return text


@pytest.mark.slow
def test_output_fits_80_columns(done):
    text = done('l_bracket', '--design')
    tables = [line for line in text.splitlines() if '. ' not in line and not line.endswith('.')]
    assert max(map(len, tables)) <= 80
    assert '…' not in text


@pytest.mark.slow
def test_files_are_written(done, tmp_path):
    done('hex_nut', '--on', 'wiper_and_balcony', '--out', tmp_path, '--report')
    names = {file.name for file in tmp_path.iterdir()}
    assert names >= {'track.json', 'orientations.csv', 'orientations.png', 'track.html'}
    document = json.loads((tmp_path / 'track.json').read_text(encoding='utf-8'))
    assert [trap['kind'] for trap in document['traps']] == ['wiper', 'balcony']
    with (tmp_path / 'orientations.csv').open(encoding='utf-8') as file:
        assert len(list(csv.DictReader(file))) == len(document['orientations'])


@pytest.mark.slow
def test_flags_of_the_track_are_in_the_document(done):
    words = ('--width', '40mm', '--roll', '10deg', '--speed', '80mm/s', '--fill', '0.5')
    walls = ('--wall-height', '20mm', '--wall-friction', '0.1')
    track = json.loads(done('hex_nut', *words, *walls, '--json'))['track']
    assert (track['width'], track['speed'], track['fill']) == (0.04, 0.08, 0.5)
    assert track['wall'] == {'height': 0.02, 'friction': 0.1}


@pytest.mark.slow
def test_no_design_exits_with_1_and_shows_the_rows(done):
    text = done('t_prism', '--design', '--want', '4', code=1)
    assert 'No set of traps passes only row 4' in text
