"""Requests for known, missing and running drops, at the same time and side by side."""

import itertools

import pytest
from resting_aspects_interfaces.msg import AspectDistribution, Status

from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.ros.interface import LATCHED
from resting_aspects_ros.simulation.job import plan_run
from resting_aspects_ros.simulation.workers import drop_range
from resting_aspects_ros.statistics.distribution import count_poses


@pytest.fixture(scope='module')
def fresh(fresh_suite):
    return fresh_suite()


@pytest.fixture(scope='module')
def client(fresh):
    return fresh.client


@pytest.fixture(scope='module')
def received(client):
    return client.poses()


@pytest.fixture(scope='module')
def counted(part, surfaces):
    """Return the counts of the first drops of a seed, made without nodes."""
    solid = part('tetrahedron')

    def counted(drops, seed):
        job, _ = plan_run(solid, surfaces.get(), seed=seed, drops=drops, run_id='', started=0)
        return count_poses(find_aspects(solid), drop_range(job, 0, drops)).counts.tolist()

    return counted


def made(received, seed):
    """Return the ranges of the drops that were made of a seed."""
    return [
        (each.first_drop, each.first_drop + len(each.status))
        for each in received
        if each.run.seed == seed
    ]


def test_request_makes_only_the_drops_that_are_missing(client, received, counted):
    first = client.ask(drops=400, seed=[1])
    again = client.ask(drops=600, seed=[1])
    for drops, answer in ((400, first), (600, again)):
        assert answer.status.code == Status.OK, answer.status.message
        assert answer.distribution.drops == drops
        assert [each.count for each in answer.distribution.aspects] == counted(drops, 1)
        assert answer.distribution.complete
        assert (answer.distribution.run.first_drop, answer.distribution.run.drops) == (0, drops)
    client.wait(lambda: received and made(received, 1)[-1][1] == 600, 'drops')
    assert made(received, 1) == [(0, 400), (400, 600)]
    assert client.ask(drops=500, seed=[1]).distribution.drops == 600


def test_concurrent_requests_make_the_larger_number_once(client, received, counted):
    asked = [client.asking(drops=drops, seed=[2]) for drops in (500, 1500, 1000)]
    client.wait(lambda: all(each.done() for each in asked), 'answers')
    assert {each.result().status.code for each in asked} == {Status.OK}
    found = {each.result().distribution.drops for each in asked}
    assert max(found) == 1500
    assert asked[1].result().distribution.drops == 1500
    assert [e.count for e in asked[1].result().distribution.aspects] == counted(1500, 2)
    client.wait(lambda: made(received, 2)[-1:] and made(received, 2)[-1][1] == 1500, 'drops')
    ranges = made(received, 2)
    assert ranges[0][0] == 0
    assert all(one[1] == other[0] for one, other in itertools.pairwise(ranges))


def test_latched_distribution_is_not_replaced_by_a_smaller_one(client, received):
    topic = 'aspect_distributions/box_10x20x30'
    client.ask('box_10x20x30', 300, seed=[1])
    client.ask('box_10x20x30', 100, seed=[3])
    late = client.listen(AspectDistribution, topic, LATCHED)
    client.wait(lambda: late, 'latched distribution')
    assert (late[0].drops, late[0].run.seed) == (300, 1)
    client.ask('box_10x20x30', 301, seed=[3])
    client.wait(lambda: late[-1].drops == 301, 'larger distribution')
    client.ask('box_10x20x30', 50, surface='steel')
    client.wait(lambda: late[-1].drops == 50, 'distribution of other conditions')


def test_each_run_of_an_extended_distribution_has_a_log(client, fresh, received):
    client.ask(drops=100, seed=[4])
    second = client.ask(drops=250, seed=[4]).distribution.run
    ids = list(dict.fromkeys(each.run.run_id for each in received if each.run.seed == 4))
    assert len(ids) == 2
    assert ids[1] == second.run_id
    for run_id in ids:
        fresh.log_of(run_id)


def test_known_answer_does_not_wait_for_an_active_run(suite):
    assert suite.client.ask('tetrahedron', 5, seed=[6]).status.code == Status.OK
    long = suite.client.dropping('tetrahedron', 2_000_000, seed=61)
    suite.client.wait(lambda: long.accepted, 'long goal')
    assert suite.client.ask('tetrahedron', 5, seed=[6]).status.code == Status.OK
    assert not long.done
    long.cancel()
    suite.client.wait(lambda: long.done, 'canceled goal')


def test_suites_in_two_namespaces_are_independent(suite, fresh_suite):
    other = fresh_suite()
    here, there = suite.client.poses(), other.client.poses()
    run_id = other.client.ask('tetrahedron', 6, seed=[5501]).distribution.run.run_id
    other.client.wait(lambda: there and there[-1].last, 'batches there')
    answer = suite.client.ask('tetrahedron', 6, seed=[5501], only_known=True)
    assert answer.status.code == Status.NOT_AVAILABLE
    # What is dropped here now comes after anything that could have come from there.
    mine = suite.client.drop('tetrahedron', 1, seed=56).result.run_id
    suite.client.wait(lambda: here and here[-1].run.run_id == mine, 'batches here')
    assert run_id not in {batch.run.run_id for batch in here}
    assert [batch.run.run_id for batch in there] == [run_id]
    log = other.log_of(run_id)
    assert other.logs.samefile(log.parent)
    assert not list(suite.logs.glob(f'*_{run_id}*'))
