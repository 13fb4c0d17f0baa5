"""The command `forecast`."""

import json
from pathlib import Path

import pytest

from resting_aspects_ros.cli.verbs.forecast import parse_gripper, parse_tray
from resting_aspects_ros.errors import InvalidValueError

WORDS = ('forecast', 'tetrahedron', '--per-aspect', 10, '--drops', 20, '--workers', 2)


@pytest.mark.slow
def test_grasps_and_controller_reach_the_forecast(run_in, tmp_path):
    text = (Path(__file__).parents[2] / 'config' / 'grasps' / 'l_bracket.yaml').read_text()
    file = tmp_path / 'grasps.yaml'
    file.write_text(text.replace('footprint: 6', 'footprint: 60').replace('[20, 6]', '[60, 50]'))
    words = ('forecast', 'l_bracket', '--per-aspect', 5, '--drops', 20, '--tray', '100x100mm')
    more = ('--grasps', file, '--controller', '--minutes', 0.2, '--parts-on-tray', 3)
    ended = run_in(tmp_path, *words, '--pickable', 1, *more, '--out', 'o')
    assert ended.returncode == 0, ended.stderr
    assert ended.stdout.splitlines()[1].startswith('with feeder_controller: ')
    found = json.loads((tmp_path / 'o' / 'forecast.json').read_text())
    controller = found['controller']
    assert controller['prediction_minutes'] == 0.2
    assert controller['prediction_lower'] <= controller['lower'] <= controller['upper']
    plain = run_in(tmp_path, *words, '--pickable', 1, '--parts-on-tray', 3, '--json')
    document = json.loads(plain.stdout)
    assert document['controller'] is None
    # The drops and flips are the same, but the large gripper has less room.
    assert found['parts_per_minute'] < 0.9 * document['parts_per_minute']


@pytest.mark.slow
def test_flags_reach_the_forecast(run_in, tmp_path):
    words = ('--robot', '900ms', '--vibrate', '1s', '--settle', '0.4', '--image', '100ms')
    more = ('--supply', '50ms', '--overlap', '--place', '0.3s', '--tray', '0.15mx120mm')
    most = ('--clearance', '2mm', '--gripper', '40x10mm', '--parts-on-tray', 7, '--max-picks', 3)
    ended = run_in(
        tmp_path, *WORDS, '--pickable', '1,2', *words, *more, *most, '--minutes', 5, '--json'
    )
    document = json.loads(ended.stdout)
    assert document['times'] == {
        'robot': 0.9,
        'vibrate': 1.0,
        'settle': 0.4,
        'image': 0.1,
        'supply': 0.05,
        'place': 0.3,
        'overlap': 0.3,
    }
    assert document['tray'] == {
        'width': 0.15,
        'depth': 0.12,
        'clearance': 0.002,
        'gripper': {'length': 0.04, 'width': 0.01, 'radius': 0.0},
    }
    assert (document['parts_on_tray'], document['max_picks'], document['minutes']) == (7, 3, 5)
    assert document['action']['name'] == 'flip'


def test_sizes_have_units():
    assert parse_tray('200x150mm') == pytest.approx((0.2, 0.15))
    assert parse_tray('0.2m x 150mm') == pytest.approx((0.2, 0.15))
    disc = parse_gripper('20mm')
    assert (disc.length, disc.width, disc.radius) == (0, 0, pytest.approx(0.01))
    for wrong in ('', 'x', '10mm x', '1x2x3mm', '10', '1e3x1mm'):
        with pytest.raises(InvalidValueError, match='expected'):
            parse_tray(wrong)
