"""Tallies count each drop once, by its index, whichever run and message it is of."""

import dataclasses

import numpy as np
import pytest

from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.nodes.aspect_classifier.counting import Tallies
from resting_aspects_ros.ros.conversions import time_msg
from resting_aspects_ros.ros.distribution_conversions import distribution_from, distribution_msg
from resting_aspects_ros.simulation.job import plan_run
from resting_aspects_ros.simulation.workers import drop_range
from resting_aspects_ros.statistics.distribution import count_poses

DROPS = 60


@pytest.fixture(scope='module')
def solid(part):
    return part('tetrahedron')


@pytest.fixture(scope='module')
def aspects(solid):
    return find_aspects(solid)


@pytest.fixture(scope='module')
def counted(aspects, engine):
    """Return the distribution of the first drops."""
    return lambda end=DROPS: count_poses(aspects, engine(end, 1))


@pytest.fixture
def run(solid, surfaces):
    """Return a function that creates the description of a run."""

    def run(run_id='a', first=0, end=DROPS, *, surface='', **changes):
        given = {'seed': 1, 'drops': end - first, 'first_drop': first, 'started': 1, **changes}
        return plan_run(solid, surfaces.get(surface), run_id=run_id, **given)[1]

    return run


@pytest.fixture
def tallies(aspects):
    return Tallies(lambda _: aspects)


@pytest.fixture
def take(tallies, solid, aspects, engine):
    """Return a function that adds the drops of a message; it returns their tally."""

    def take(run, first, end, *, last=False):
        tally = tallies.of_run(run)
        tally.add(run, engine(DROPS, 1).between(first, end), last=last)
        tally.count(solid, aspects)
        return tally

    return take


def test_a_further_run_extends_a_tally(run, take, tallies, counted):
    take(run('a', 0, 40), 0, 40, last=True)
    further = run('b', 40, 60, started=2)
    assert not take(further, 40, 50).complete
    tally = take(further, 50, 60, last=True)
    assert tally.counted.counts.tolist() == counted().counts.tolist()
    assert (tally.run.run_id, tally.first, tally.run.drops) == ('b', 0, 60)
    # Repeated drops do not change the description.
    before = tally.counted
    take(run('c', 0, 40, started=3), 0, 40)
    assert (tally.run.run_id, tally.complete, len(tallies)) == ('b', True, 1)
    assert tally.counted is before


def test_newest_is_the_largest_under_the_newest_conditions(run, take, tallies, solid):
    sha = solid.part_sha256
    assert tallies.newest(sha) is None
    large = take(run('a', seed=1), 0, 60, last=True)
    take(run('b', seed=2, started=2), 0, 20)
    assert tallies.newest(sha) is large
    steel = take(run('c', seed=3, started=3, surface='steel'), 0, 10)
    assert tallies.newest(sha) is steel
    assert tallies.newest(sha, ended=True) is large


def test_log_extends_what_is_known(run, take, tallies, counted):
    tally = take(run(), 40, 60, last=True)
    assert tally.missing() == [(0, 40)]
    tallies.add(run(), counted(50))
    assert (tally.end, tally.missing()) == (50, [])
    take(run(), 0, 0)
    assert tally.counted.counts.tolist() == counted().counts.tolist()
    tallies.add(run('old', 0, 20), counted(20))  # a smaller one changes nothing
    assert (tally.drops, len(tallies)) == (60, 1)


def test_drops_after_those_of_a_log_are_counted_by_the_part(part, surfaces):
    """The aspects in a message lack the sides by which poses are classified."""
    solid = part('cylinder_d20_h20')
    aspects = find_aspects(solid)
    job, run = plan_run(solid, surfaces.get(), seed=1, drops=60, run_id='a', started=1)
    poses = drop_range(job, 0, 60)
    logged = count_poses(aspects, poses.between(0, 20))
    message = distribution_msg(logged, run, time_msg(1), complete=True)
    tallies = Tallies({solid.part_sha256: aspects}.get)
    tallies.add(run, distribution_from(message))
    tally = tallies.of_run(run)
    tally.add(run, poses, last=True)
    tally.count(solid, aspects)
    assert tally.counted.counts.tolist() == count_poses(aspects, poses).counts.tolist()


def test_distributions_of_other_aspects_are_removed(run, aspects, counted, solid):
    described = {}
    tallies, sha = Tallies(described.get), solid.part_sha256
    fewer = AspectSet(sha, aspects[:-1])
    wrong = dataclasses.replace(counted(), aspects=fewer, counts=np.array([1, 1, 1]))
    tallies.add(run('a', seed=1), counted())
    tallies.add(run('b', seed=2), wrong)
    assert tallies.remove_inconsistent(sha) == []
    described[sha] = aspects
    assert [each.run_id for each in tallies.remove_inconsistent(sha)] == ['b']
    assert len(tallies) == 1
    with pytest.raises(InvalidValueError, match='expected the aspects of tetrahedron'):
        tallies.add(run('b', seed=2), wrong)
