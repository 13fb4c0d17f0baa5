"""`resting_aspects identify`: its table, its document and its errors."""

import json

import numpy as np
import pytest
import shapely
import trimesh

RECTANGLE = {'outer': [[0.1, 0], [0.14, 0], [0.14, 0.02], [0.1, 0.02]]}


@pytest.fixture
def polygon(tmp_path):
    """Write a polygon into a file; returns its name."""

    def write(document):
        text = document if isinstance(document, str) else json.dumps(document)
        (tmp_path / 'seen.json').write_text(text)
        return 'seen.json'

    return write


def test_position_of_the_camera_gives_the_place_of_a_high_part(run, polygon):
    # A box 30 mm high, 20 x 10 mm, at (0.1, 0.05) m, seen from the height 0.5 m above the origin.
    base = np.array([[0.09, 0.045], [0.11, 0.045], [0.11, 0.055], [0.09, 0.055]])
    seen = shapely.MultiPoint(np.vstack([base, base * 0.5 / 0.47])).convex_hull
    name = polygon({'outer': np.asarray(seen.exterior.coords).tolist()})
    words = ('identify', 'box_10x20x30', '--polygon', name)
    ended = run(*words, '--camera', '0mm,0mm,0.5m', '--json')
    found = json.loads(ended.stdout)['candidates'][0]
    assert found['symmetry_class'] == 3
    assert (found['x'], found['y'], found['posterior']) == pytest.approx((0.1, 0.05, 1), abs=1e-3)
    assert json.loads(run(*words, '--json').stdout)['answer'] == 'none'
    assert '--camera' in run(*words).stdout
    for wrong in ('0,0', '0mm,0mm,2px', '0mm,0mm,-1mm', '0mm,0mm,10mm'):
        ended = run(*words, '--camera', wrong)
        assert (ended.returncode, ended.stdout) == (2, '')
        assert 'expected' in ended.stderr
    wrong = run(*words, '--camera', '0mm,0mm,0mm').stderr
    assert '--camera' in wrong
    assert '[0.0, 0.0, 0.0]' in wrong
    for height in (20, 30):  # of the box 30 mm high
        low = run(*words, '--camera', f'0mm,0mm,{height}mm').stderr
        for word in (
            f'invalid height {height / 1000:g} m of the camera',
            '0.03 m',
            'box_10x20x30',
        ):
            assert word in low


@pytest.mark.parametrize(
    ('document', 'words'),
    [
        ('[1, 2', 'is not JSON'),
        ('[]', 'expected a JSON object'),
        ('{}', 'expected outer'),
        ({'outer': [[0, 0], [200, 0], [200, 100]]}, 'pixels'),
        ({'outer': [[0, 0], [0.2, 0.1], [0.2, 0], [0, 0.1]]}, 'cross'),
        ({**RECTANGLE, 'hole': []}, "seen.json': invalid key 'hole': expected one of outer"),
        pytest.param(
            '{"outer": [[' + '9' * 400 + ', 0], [1, 0], [1, 1]]}',
            'not a finite number',
            id='large integer',
        ),
        ({'outlines': [RECTANGLE]}, 'this is the document of resting_aspects outlines'),
    ],
)
def test_wrong_polygons_are_refused(run, polygon, document, words):
    ended = run('identify', 'l_bracket', '--polygon', polygon(document))
    assert ended.returncode == 2
    assert words in ended.stderr
    assert ended.stdout == ''


def test_a_part_that_is_given_twice_is_one_candidate(run, polygon, tmp_path):
    for name in ('box', 'copy'):
        trimesh.creation.box((40, 20, 10)).export(tmp_path / f'{name}.stl')
    words = ('--polygon', polygon(RECTANGLE), '--json')
    once = json.loads(run('identify', 'box.stl', *words).stdout)
    ended = run('identify', 'box.stl', 'copy.stl', 'box.stl', *words)
    assert json.loads(ended.stdout) == once
    assert 'copy is the same part as box' in ended.stderr


def test_missing_file_and_wrong_noise(run, polygon):
    assert 'does not exist' in run('identify', 'l_bracket', '--polygon', 'no.json').stderr
    ended = run('identify', 'l_bracket', '--polygon', polygon(RECTANGLE), '--noise', '2px')
    assert ended.returncode == 2
    assert '--noise' in ended.stderr
