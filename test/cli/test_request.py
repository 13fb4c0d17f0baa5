"""`nodes` and `request`: the suite in one process, a client in another."""

import json
import os
import re
import signal
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from resting_aspects_ros.client import client


@pytest.mark.slow
def test_request_returns_every_form_of_result(begin, run, read_until, wait_until, tmp_path):
    ros = ('--ros-args', '-r', f'__ns:=/request_{os.getpid()}')
    nodes = begin('nodes', *ros, '-p', 'log_folder:=logs', '-p', 'surface:=steel')

    # Without a surface, that of the simulator.
    asked = ('request', 'tetrahedron', '--drops', 20, '--seed', 3)
    ended = run(*asked, '--json', '--picture', 'p.png', *ros)
    assert ended.returncode == 0, ended.stderr
    dropped = json.loads(run('drop', *asked[1:], '--surface', 'steel', '--json').stdout)
    document = json.loads(ended.stdout)
    # The drops and the fields are the same as those of `drop`.
    assert document.keys() == dropped.keys()
    for of in (document, dropped):
        del of['run_id'], of['started']
    for asked_for, made_here in zip(document['aspects'], dropped['aspects'], strict=True):
        # The message has a polygon of float32.
        assert np.allclose(asked_for.pop('support'), made_here.pop('support'), atol=1e-8)
    assert document.pop('history') is None  # not part of the service
    del dropped['history']
    assert document == dropped
    with Image.open(tmp_path / 'p.png') as picture:
        picture.load()

    def conditions(*words):
        ended = run('request', 'tetrahedron', '--drops', 3, *words, '--json', *ros)
        assert ended.returncode == 0, ended.stderr
        return json.loads(ended.stdout)['conditions']

    steel = document['conditions']
    assert (steel['surface'], steel['friction']) == ('steel', 0.15)
    assert conditions('--friction', '0.4') == steel | {'surface': '', 'friction': 0.4}
    assert conditions('--surface', 'rubber_mat')['restitution'] == 0.64

    known = run(*asked, '--only-known', *ros)
    assert known.stdout.splitlines()[1].strip() == '20 drops on steel, seed 3'
    assert known.stderr == ''

    unknown = run('request', 'nothing', *ros)
    assert (unknown.returncode, unknown.stdout) == (2, '')
    (line,) = unknown.stderr.splitlines()
    assert line.startswith("error: part 'nothing' is not known; known parts: angle_45x30x8")

    never = run('request', 'washer', '--only-known', *ros)
    assert (never.returncode, never.stdout) == (1, '')
    assert len(never.stderr.splitlines()) == 1

    asking = begin('request', 'tetrahedron', '--drops', 4000, '--seed', 4, *ros)
    read_until(asking.stderr, lambda line: re.match(r'tetrahedron: [1-9]\d* of 4000', line))
    os.killpg(asking.pid, signal.SIGINT)
    *_, last = asking.communicate(timeout=600)[1].splitlines()
    assert asking.returncode == 130
    assert re.fullmatch(
        r'interrupted after \d+ drops, which are kept; the run ends unless another client '
        r'requested the same drops',
        last,
    )
    # The completed drops are logged, and the log is closed.
    wait_until(lambda: len(list(tmp_path.glob('logs/tetrahedron_*/metadata.yaml'))) == 4)

    nodes.send_signal(signal.SIGINT)
    _, errors = nodes.communicate(timeout=600)
    assert nodes.returncode == 0
    assert 'Traceback' not in errors


@pytest.mark.slow
def test_ctrl_c_before_the_first_progress_of_a_run(begin, wait_until):
    process = begin('request', 'washer', '--ros-args', '-r', f'__ns:=/nobody_{os.getpid()}')
    maps = Path(f'/proc/{process.pid}/maps')
    wait_until(lambda: 'rclpy' in maps.read_text())
    os.killpg(process.pid, signal.SIGINT)
    printed, errors = process.communicate(timeout=600)
    assert (process.returncode, printed) == (130, '')
    assert errors == 'interrupted\n'


@pytest.mark.slow
def test_condition_without_surface_needs_the_default_surface(run, monkeypatch):
    monkeypatch.setattr(client, 'PART_TIMEOUT', 0.5)
    ros = ('--ros-args', '-r', f'__ns:=/request_nobody_{os.getpid()}')
    ended = run('request', 'tetrahedron', '--friction', '0.4', *ros)
    assert (ended.returncode, ended.stdout) == (1, '')
    (line,) = ended.stderr.splitlines()
    assert line.startswith('error: the default surface is unknown, name a surface or ')
    assert line.endswith('default_conditions, waited 0.5 s')
