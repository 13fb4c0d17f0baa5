"""Drops at many points: counts that follow from each point alone."""

import numpy as np
import pytest

import resting_aspects_ros as ra
from resting_aspects_ros.api.condition_text import given_conditions
from resting_aspects_ros.core.errors import EngineError
from resting_aspects_ros.simulation.conditions import HeightOf
from resting_aspects_ros.studies.design import Setting
from resting_aspects_ros.studies.point_plans import point_seed
from resting_aspects_ros.studies.point_runs import drop_points

MAT = given_conditions('rubber_mat', {'height': 0.03})
POINTS = [MAT.changed(restitution=r) for r in (0.1, 0.2, 0.3)]


@pytest.fixture(scope='module')
def part():
    return ra.load_part('tetrahedron')


@pytest.fixture(scope='module')
def counted(part, here):
    return drop_points(part, POINTS, 630, 1, workers=here())


def test_every_drop_is_counted(counted):
    assert counted.drops.tolist() == [630] * 3
    assert counted.counts.shape == (3, 4)
    assert counted.by_class().tolist() == counted.counts.sum(axis=1, keepdims=True).tolist()


def test_counts_of_a_point_do_not_depend_on_other_points(part, counted, here):
    backward = drop_points(part, POINTS[:0:-1], 630, 1, workers=here())
    assert (backward.counts == counted.counts[:0:-1]).all()
    assert (counted.counts[0] != counted.counts[1]).any()


def test_counts_are_those_of_a_run_with_the_seed_of_the_point(part, counted, here):
    seed = point_seed(1, part, Setting(POINTS[1]))
    run = ra.drop(part, 630, surface=POINTS[1], seed=seed, workers=here(), keep_poses=False)
    assert (run.distribution.counts == counted.counts[1]).all()


def test_seed_follows_from_the_point(part):
    named = given_conditions('rubber_mat', {})
    other = ra.load_part('hex_nut')
    seeds = [
        point_seed(1, part, Setting(named)),
        point_seed(2, part, Setting(named)),
        point_seed(1, other, Setting(named)),
        point_seed(1, part, Setting(named.changed(friction=0.123))),
    ]
    assert len(set(seeds)) == 4
    assert seeds[0] == point_seed(1, part, Setting(named.changed(friction=named.friction)))


def test_chunk_of_a_dead_worker_is_repeated(part, counted, here):
    workers = here(dying=(1, 4))
    with pytest.warns(ra.RestingAspectsWarning, match='a worker died'):
        again = drop_points(part, POINTS, 630, 1, workers=workers)
    assert (again.counts == counted.counts).all()
    assert len(workers.submitted) == 8


def test_failure_of_a_worker_is_reported(part, here):
    with pytest.raises(EngineError, match='a worker failed'):
        drop_points(part, POINTS, 630, 1, workers=here(failing=(2,)))


def test_impossible_point_is_skipped(part, here):
    low = MAT.changed(height=0.001, height_of=HeightOf.CENTRE_OF_MASS)
    counted = drop_points(part, [MAT, low], 10, 1, workers=here())
    assert counted.drops.tolist() == [10, 0]
    assert list(counted.skipped) == [1]
    assert 'height of the centre of mass' in counted.skipped[1]


def test_drops_can_be_stopped(part, here):
    made = []
    counted = drop_points(
        part, POINTS, 630, 1, workers=here(), progress=made.append, stopped=lambda: bool(made)
    )
    assert np.sum(counted.drops) == made[-1] < 1890
