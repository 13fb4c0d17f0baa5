"""Tallies count each drop once, by its index, whichever run and message it is of."""

import dataclasses

import numpy as np
import pytest

from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.nodes.aspect_classifier.counting import Tallies
from resting_aspects_ros.simulation.job import plan_run
from resting_aspects_ros.statistics.distribution import count_poses

DROPS = 60
PART = 'tetrahedron'


@pytest.fixture(scope='module')
def solid(part):
    return part(PART)


@pytest.fixture(scope='module')
def aspects(solid):
    return find_aspects(solid)


@pytest.fixture(scope='module')
def poses(engine):
    return engine(DROPS, 1)


@pytest.fixture
def run(solid, surfaces):
    """Return a function that creates the description of a run."""

    def run(run_id='a', first=0, end=DROPS, *, seed=1, started=1, surface='', **changes):
        given = {'seed': seed, 'drops': end - first, 'first_drop': first, 'started': started}
        _, found = plan_run(solid, surfaces.get(surface), run_id=run_id, **given)
        return dataclasses.replace(found, **changes)

    return run


@pytest.fixture
def tallies(aspects):
    return Tallies(lambda _: aspects)


@pytest.fixture
def take(tallies, solid, aspects, poses):
    """Return a function that adds the drops of a message; it returns their tally."""

    def take(run, first, end, *, last=False):
        tally = tallies.of_run(run)
        tally.add(run, poses.between(first, end), last=last)
        tally.count(solid, aspects)
        return tally

    return take


def counts(tally):
    return tally.counted.counts.tolist()


@pytest.mark.parametrize(
    'messages',
    [
        [(0, 20), (20, 40), (40, 60)],
        [(0, 20), (0, 20), (10, 30), (20, 60)],
        [(40, 60), (0, 20), (20, 40)],
        [(0, 60)],
    ],
    ids=['in order', 'repeated', 'in another order', 'one'],
)
def test_each_drop_is_counted_once(run, take, aspects, poses, messages):
    for first, end in messages:
        tally = take(run(), first, end, last=end == DROPS)
    assert counts(tally) == count_poses(aspects, poses).counts.tolist()
    assert (tally.end, tally.complete, tally.missing()) == (DROPS, True, [])


def test_drops_after_a_gap_wait_for_the_missing_ones(run, take, aspects, poses):
    take(run(), 0, 10)
    tally = take(run(), 30, 60, last=True)
    assert (tally.end, tally.complete, tally.missing()) == (10, False, [(10, 30)])
    assert counts(tally) == count_poses(aspects, poses.between(0, 10)).counts.tolist()
    take(run(), 10, 30)
    assert (tally.end, tally.complete) == (DROPS, True)
    assert counts(tally) == count_poses(aspects, poses).counts.tolist()


def test_a_further_run_extends_a_tally(run, take, tallies, aspects, poses, solid):
    take(run('a', 0, 40), 0, 40, last=True)
    tally = take(run('b', 40, 60, started=2), 40, 50)
    assert not tally.complete
    take(run('b', 40, 60, started=2), 50, 60, last=True)
    assert (tally.run.run_id, tally.first, tally.run.drops) == ('b', 0, 60)
    assert counts(tally) == count_poses(aspects, poses).counts.tolist()
    assert tallies.find(solid.part_sha256, run().conditions, 60, 0.0, 1) is tally
    assert tallies.find(solid.part_sha256, run().conditions, 61, 0.0, 1) is None


def test_repeated_drops_do_not_change_the_description(run, take, tallies):
    tally = take(run('a'), 0, 60, last=True)
    before = tally.counted
    take(run('b', 0, 40, started=2), 0, 40)
    assert (tally.run.run_id, tally.complete, len(tallies)) == ('a', True, 1)
    assert tally.counted is before


def test_drops_that_do_not_continue_others_are_another_tally(run, take, tallies, solid):
    take(run('a', 0, 20), 0, 20, last=True)
    apart = take(run('b', 40, 60), 40, 60, last=True)
    assert (apart.first, apart.drops, len(tallies)) == (40, 20, 2)
    find = tallies.find
    assert find(solid.part_sha256, run().conditions, 20, 0.0, 1).first == 0
    assert tallies.longest(solid.part_sha256, run().conditions, 1, run().suite_version).end == 20
    assert tallies.longest(solid.part_sha256, run().conditions, 1, 'another') is None
    assert tallies.longest(solid.part_sha256, run().conditions, 2, run().suite_version) is None


def test_a_precision_widens_the_intervals_from_then_on(run, take):
    plain = take(run('a', 0, 40), 0, 40, last=True).counted.intervals()
    tally = take(run('b', 0, 60, precision=0.1), 0, 41)
    assert tally.counted.by_precision
    assert tally.run.precision == 0.1
    assert tally.counted.intervals()[0].lower < plain[0].lower


def test_message_that_contradicts_its_run_is_rejected(run, take):
    take(run('a'), 0, 20)
    with pytest.raises(InvalidValueError, match='describes another run'):
        take(run('a', seed=2), 20, 40)


def test_newest_is_the_largest_under_the_newest_conditions(run, take, tallies, solid):
    sha = solid.part_sha256
    assert tallies.newest(sha) is None
    large = take(run('a', seed=1), 0, 60, last=True)
    take(run('b', seed=2, started=2), 0, 20)
    assert tallies.newest(sha) is large
    steel = take(run('c', seed=3, started=3, surface='steel'), 0, 10)
    assert tallies.newest(sha) is steel
    assert tallies.newest(sha, ended=True) is large
    assert tallies.newest('another') is None


def test_log_extends_what_is_known(run, take, tallies, aspects, poses):
    tally = take(run(), 40, 60, last=True)
    assert tally.missing() == [(0, 40)]
    tallies.add(run(), count_poses(aspects, poses.between(0, 50)))
    assert (tally.end, tally.missing()) == (50, [])
    take(run(), 0, 0)
    assert counts(tally) == count_poses(aspects, poses).counts.tolist()
    # A smaller distribution changes nothing.
    tallies.add(run('old', 0, 20), count_poses(aspects, poses.between(0, 20)))
    assert (tally.drops, len(tallies)) == (60, 1)


def test_distributions_of_other_aspects_are_removed(run, aspects, poses, solid):
    described = {}
    tallies, sha = Tallies(described.get), solid.part_sha256
    whole = count_poses(aspects, poses)
    fewer = AspectSet(sha, aspects[:-1])
    wrong = dataclasses.replace(whole, aspects=fewer, counts=np.array([1, 1, 1]))
    tallies.add(run('a', seed=1), whole)
    tallies.add(run('b', seed=2), wrong)
    assert tallies.remove_inconsistent(sha) == []
    described[sha] = aspects
    assert [each.run_id for each in tallies.remove_inconsistent(sha)] == ['b']
    assert len(tallies) == 1
    with pytest.raises(InvalidValueError, match='expected the 4 aspects of tetrahedron'):
        tallies.add(run('b', seed=2), wrong)
