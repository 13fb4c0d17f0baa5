"""`drop --check-convergence`: how much the result changes with a finer time step."""

import json

import numpy as np
import pytest

import resting_aspects_ros as ra
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.simulation.job import make_job
from resting_aspects_ros.simulation.workers import drop_range
from resting_aspects_ros.statistics.distribution import count_poses

DROPS = 2000


@pytest.mark.slow
def test_shift_compares_the_same_drops_with_half_the_time_step(part, surfaces):
    bracket = part('l_bracket')
    result = ra.drop(bracket, DROPS, check_convergence=True)
    found = result.convergence
    assert found.time_step == pytest.approx(result.run.time_step / 2, rel=1e-12)
    job = make_job(bracket, surfaces.get(), 1, refinement=2)
    fine = count_poses(find_aspects(bracket), drop_range(job, 0, DROPS)).counts
    before = result.distribution.counts
    shift = fine / fine.sum() - before / before.sum()
    moved = int(np.abs(shift).argmax())
    assert (found.aspect, found.drops) == (moved + 1, DROPS)
    assert found.shift == pytest.approx(shift[moved], abs=1e-12)
    assert found.lower <= found.shift <= found.upper


@pytest.mark.slow
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
