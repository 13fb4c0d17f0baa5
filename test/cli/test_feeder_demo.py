"""`resting_aspects feeder_demo`: the feeder over ROS beside its forecast."""

import json
import os
import signal
from pathlib import Path

import pytest
from PIL import Image

from resting_aspects_ros.cli.main import main

NODES = 6


def processes_of(demo):
    """Return the processes of a demo and its nodes."""
    found = []
    for folder in Path('/proc').glob('[0-9]*'):
        try:
            words = (folder / 'cmdline').read_bytes().decode(errors='replace').split('\0')
        except (FileNotFoundError, ProcessLookupError):
            continue
        if f'__ns:=/feeder_demo_{demo}' in words:
            found.append(int(folder.name))
    return found


@pytest.mark.parametrize(
    ('flags', 'message'),
    [
        (['nothing'], 'nothing'),
        (['--pickable', '9'], 'invalid pickable aspect 9: expected 1 to 5'),
        (['--pickable-classes', 'x'], 'invalid --pickable-classes'),
        (['--minutes', '0'], 'invalid --minutes 0'),
        (['--minutes', '1e9'], 'expected more than 0, at most 10000'),
        (['--gripper', '20mm'], 'invalid --gripper'),
        (['--tray', '10x10mm'], 'tray'),
        (['--robot', '0s'], 'invalid robot time'),
        (['--place', '1s'], 'expected only with overlap'),
    ],
)
def test_wrong_input_is_refused_before_a_node_starts(flags, message, capsys, tmp_path):
    assert main(['feeder_demo', *flags, '--out', str(tmp_path)]) == 2
    printed = capsys.readouterr()
    assert message in printed.err
    assert 'Starting' not in printed.err


@pytest.mark.slow
def test_demo_compares_a_run_with_its_forecast(begin, tmp_path):
    demo = begin('feeder_demo', '--minutes', '1.5', '--json', '--out', tmp_path)
    printed, said = demo.communicate()
    assert demo.returncode == 0, said
    found = json.loads(printed)
    assert found == json.loads((tmp_path / 'feeder_demo.json').read_text())
    assert found['complete']
    run, forecast = found['run'], found['forecast']
    assert run['minutes'] >= 1.5
    assert run['picks'] == pytest.approx(run['minutes'] * run['parts_per_minute'])
    assert run['picks'] > 0
    assert forecast['prediction_lower'] < forecast['parts_per_minute']
    assert 'the robot picked' in said
    with Image.open(tmp_path / 'feeder_demo.png') as picture:
        assert min(picture.size) > 500
    assert list(tmp_path.glob('logs/feeder*/*.mcap'))
    assert not processes_of(demo.pid)


@pytest.mark.slow
def test_ctrl_c_ends_all_processes_and_keeps_the_result(begin, wait_until, tmp_path):
    demo = begin('feeder_demo', '--minutes', '9999', '--out', tmp_path)
    wait_until(lambda: len(processes_of(demo.pid)) == NODES)
    os.kill(demo.pid, signal.SIGINT)
    _, said = demo.communicate()
    assert demo.returncode == 130, said
    assert 'interrupted' in said
    assert 'Traceback' not in said
    assert not json.loads((tmp_path / 'feeder_demo.json').read_text())['complete']
    assert not processes_of(demo.pid)
