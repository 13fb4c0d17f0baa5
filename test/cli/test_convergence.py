"""`drop --check-convergence`: how much the result changes with a finer time step."""

import json
import signal

import numpy as np
import pytest

from resting_aspects_ros.api.runner import DropProgress, check_convergence
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.simulation.job import make_job
from resting_aspects_ros.simulation.workers import drop_range
from resting_aspects_ros.statistics.distribution import count_poses, no_drops

DROPS = 2000


def test_shift_compares_the_same_drops_with_half_the_time_step(run, part, surfaces):
    ended = run('drop', 'l_bracket', '--drops', DROPS, '--check-convergence', '--json')
    assert ended.returncode == 0, ended.stderr
    document = json.loads(ended.stdout)
    found = document['convergence']
    assert found['time_step'] == pytest.approx(document['time_step'] / 2, rel=1e-12)
    aspects = find_aspects(part('l_bracket'))
    fine = count_poses(
        aspects, drop_range(make_job(part('l_bracket'), surfaces.get(), 1, refinement=2), 0, DROPS)
    )
    before = np.array([aspect['count'] for aspect in document['aspects']])
    shift = fine.counts / fine.counts.sum() - before / before.sum()
    moved = int(np.abs(shift).argmax())
    assert (found['aspect'], found['drops']) == (moved + 1, DROPS)
    assert found['shift'] == pytest.approx(shift[moved], abs=1e-12)
    assert found['lower'] <= found['shift'] <= found['upper']
    assert 'with a finer time step' in ended.stderr


def test_interrupted_convergence_check_keeps_the_result(run, monkeypatch):
    update = DropProgress.update

    def interrupt(shown, done):
        update(shown, done)
        if 'with a finer time step' in shown._what:
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(DropProgress, 'update', interrupt)
    ended = run('drop', 'washer', '--drops', 2000, '--check-convergence', '--json')
    assert ended.returncode == 130
    document = json.loads(ended.stdout)
    assert (document['drops'], document['complete']) == (2000, True)
    assert 'convergence' not in document
    assert ended.stderr.splitlines()[-1] == 'interrupted; convergence was not checked'


def test_run_without_resting_parts_has_a_result(run, tmp_path):
    ended = run(
        'drop', 'l_bracket', '--drops', 2, '--restitution', 1, '--friction', 0,
        '--check-convergence', '--out', tmp_path / 'o', '--json',
    )  # fmt: skip
    assert ended.returncode == 0, ended.stderr
    document = json.loads(ended.stdout)
    assert document['unsettled'] + document['unclassified'] + document['failed'] == 2
    assert 'convergence' not in document
    assert 'warning: convergence could not be determined: no drop came to rest' in ended.stderr
    assert (tmp_path / 'o' / 'distribution.json').is_file()


def test_convergence_needs_a_drop_in_an_aspect(part):
    nothing = no_drops(find_aspects(part('l_bracket')))
    assert check_convergence(nothing, nothing, 1e-4, seed=1) is None
