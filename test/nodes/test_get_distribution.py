"""The service get_distribution: known, missing and running drops, and those before a restart."""

import itertools
import math

import numpy as np
import pytest
from resting_aspects_interfaces.msg import AspectDistribution, Status

import resting_aspects_ros as ra
from resting_aspects_ros.aspects.estimate import RestingShape, estimate
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.ros.conversions import conditions_msg
from resting_aspects_ros.ros.interface import LATCHED
from resting_aspects_ros.simulation.job import plan_run
from resting_aspects_ros.simulation.workers import drop_range
from resting_aspects_ros.statistics.distribution import count_poses


@pytest.fixture(scope='module')
def suite(fresh_suite):
    quick = {
        'ros.goal_client.STARTUP_TIMEOUT': 1.0,
        'nodes.aspect_classifier.known.QUIET_PERIOD': 1.0,
    }
    return fresh_suite({'aspect_classifier': quick})


@pytest.fixture(scope='module')
def first(suite):
    """Return the response to the first request for a seed."""
    return suite.client.ask('tetrahedron', 260, seed=[7])


def test_every_drop_is_counted_once(first, counts):
    assert first.status.code == Status.OK
    assert first.status.message == ''
    distribution = first.distribution
    assert distribution.complete
    assert distribution.method == 'drops'
    assert distribution.drops == 260 == sum(counts(distribution))
    assert len(distribution.aspects) == 4
    for aspect in distribution.aspects:
        assert aspect.probability == aspect.count / 260
        assert aspect.lower < aspect.probability < aspect.upper


def test_model_range_is_that_of_the_python_interface(first):
    found = ra.drop('tetrahedron', 260, seed=7).distribution
    shares = [(each.lower, each.upper) for each in found.model_intervals()]
    distribution = first.distribution
    assert [(each.model_lower, each.model_upper) for each in distribution.aspects] == shares
    assert tuple(distribution.model_uncertain) == ('restitution', 'friction')
    classes = zip(distribution.class_model_lower, distribution.class_model_upper, strict=True)
    assert list(classes) == [tuple(row) for row in found.model.by_class]


def test_known_distribution_needs_no_drop(suite, first, counts):
    received = suite.client.poses()
    suite.client.wait(lambda: received and received[-1].last, 'the first run')
    before = len(received)
    again = suite.client.ask('tetrahedron', 260, seed=[7])
    fewer = suite.client.ask('tetrahedron', 100, seed=[7])
    any_seed = suite.client.ask('tetrahedron', 260)
    only_known = suite.client.ask('tetrahedron', 260, only_known=True)
    for answer in (again, fewer, any_seed, only_known):
        assert answer.status.code == Status.OK
        assert answer.distribution.run == first.distribution.run
        assert counts(answer.distribution) == counts(first.distribution)
    # A drop made now arrives after everything that these requests could have caused.
    new = suite.client.drop('tetrahedron', 1, seed=99).result.run_id
    suite.client.wait(lambda: received[-1].last and received[-1].run.run_id == new, 'the new run')
    assert len(received) == before + 1


@pytest.mark.parametrize(
    ('fields', 'expected'),
    [
        ({'drops': 261}, ['has at least 261 drops', ' 260 drops on rubber_mat']),
        ({'seed': [8]}, ['with seed 8 has', ' 260 drops on rubber_mat with seed 7']),
    ],
)
def test_only_known_drops_nothing(suite, first, fields, expected):
    answer = suite.client.ask(**{'drops': 260, 'only_known': True, **fields})
    assert answer.status.code == Status.NOT_AVAILABLE
    for each in (*expected, 'no known distribution'):
        assert each in answer.status.message


def test_conditions_equal_to_a_surface_are_known(suite, first, surfaces):
    same = conditions_msg(surfaces.get())
    same.surface = 'my own name for it'
    answer = suite.client.ask(drops=260, conditions=[same], only_known=True)
    assert answer.status.code == Status.OK
    assert answer.distribution.run == first.distribution.run


def test_run_from_the_middle_does_not_match_its_seed(suite, counts):
    slice_of_run = suite.client.drop('box_10x20x30', 30, first_drop=500, seed=5).result
    assert slice_of_run.drops == 30
    refused = suite.client.ask('box_10x20x30', 30, seed=[5], only_known=True).status
    assert refused.message.endswith(
        '; known distributions: 30 drops on rubber_mat from drop 500 on'
    )
    answer = suite.client.ask('box_10x20x30', 30, seed=[5])
    assert answer.distribution.run.first_drop == 0
    assert answer.distribution.run.run_id != slice_of_run.run_id


# -- a precision ----------------------------------------------------------------------------------


def test_run_stops_at_the_precision_as_a_drop_does(suite, part, surfaces):
    own = surfaces.get().changed(friction=0.29)  # no other test drops under these conditions
    asked = {'seed': [33], 'conditions': [conditions_msg(own)]}
    expected = ra.drop(part('tetrahedron'), precision=0.05, seed=33, surface=own, workers=1)
    answer = suite.client.ask(drops=0, precision=0.05, **asked)
    assert answer.status.code == Status.OK
    found = answer.distribution
    assert (found.drops, found.complete) == (expected.distribution.drops, True)
    assert [each.count for each in found.aspects] == expected.distribution.counts.tolist()
    assert max((each.upper - each.lower) / 2 for each in found.aspects) <= 0.05
    for precision, code in ((0.05, Status.OK), (0.1, Status.OK), (0.01, Status.NOT_AVAILABLE)):
        known = suite.client.ask(drops=0, precision=precision, only_known=True, **asked)
        assert known.status.code == code
    few = suite.client.ask(drops=300, precision=0.01, seed=[34], conditions=asked['conditions'])
    assert (few.distribution.drops, few.distribution.complete) == (300, True)


# -- estimators -----------------------------------------------------------------------------------


def test_estimator_responds_without_a_drop(suite, part):
    box = part('box_10x20x30')
    answer = suite.client.ask(box.name, method='rolling')
    assert (answer.status.code, answer.status.message) == (Status.OK, '')
    found = answer.distribution
    expected = estimate(RestingShape(box, find_aspects(box)), 'rolling').probabilities
    # The part was sent in a message, which does not round its numbers.
    np.testing.assert_array_equal([a.probability for a in found.aspects], expected)
    assert (found.method, found.run.part_sha256, found.complete) == (
        'rolling',
        box.part_sha256,
        True,
    )
    assert (found.drops, found.interval, found.run.run_id) == (0, '', '')
    assert all(math.isnan(each.lower) and math.isnan(each.upper) for each in found.aspects)
    # It is not taken for drops.
    known = suite.client.ask(box.name, 10, seed=[9900], only_known=True)
    assert known.status.code == Status.NOT_AVAILABLE


# -- drops that are missing -----------------------------------------------------------------------


@pytest.fixture(scope='module')
def received(suite):
    return suite.client.poses()


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


def test_request_makes_only_the_drops_that_are_missing(suite, received, counted):
    first = suite.client.ask(drops=400, seed=[1])
    again = suite.client.ask(drops=600, seed=[1])
    for drops, answer in ((400, first), (600, again)):
        assert answer.status.code == Status.OK, answer.status.message
        assert answer.distribution.drops == drops
        assert [each.count for each in answer.distribution.aspects] == counted(drops, 1)
        assert answer.distribution.complete
        assert (answer.distribution.run.first_drop, answer.distribution.run.drops) == (0, drops)
    suite.client.wait(lambda: received and made(received, 1)[-1][1] == 600, 'drops')
    assert made(received, 1) == [(0, 400), (400, 600)]
    assert suite.client.ask(drops=500, seed=[1]).distribution.drops == 600


def test_concurrent_requests_make_the_larger_number_once(suite, received, counted):
    asked = [suite.client.asking(drops=drops, seed=[2]) for drops in (500, 1500, 1000)]
    suite.client.wait(lambda: all(each.done() for each in asked), 'answers')
    assert {each.result().status.code for each in asked} == {Status.OK}
    found = {each.result().distribution.drops for each in asked}
    assert max(found) == 1500
    assert asked[1].result().distribution.drops == 1500
    assert [e.count for e in asked[1].result().distribution.aspects] == counted(1500, 2)
    suite.client.wait(lambda: made(received, 2)[-1:] and made(received, 2)[-1][1] == 1500, 'drops')
    ranges = made(received, 2)
    assert ranges[0][0] == 0
    assert all(one[1] == other[0] for one, other in itertools.pairwise(ranges))


def test_latched_distribution_is_not_replaced_by_a_smaller_one(suite, received):
    topic = 'aspect_distributions/box_10x20x30'
    suite.client.ask('box_10x20x30', 300, seed=[1])
    suite.client.ask('box_10x20x30', 100, seed=[3])
    late = suite.client.listen(AspectDistribution, topic, LATCHED)
    suite.client.wait(lambda: late, 'latched distribution')
    assert (late[0].drops, late[0].run.seed) == (300, 1)
    suite.client.ask('box_10x20x30', 301, seed=[3])
    suite.client.wait(lambda: late[-1].drops == 301, 'larger distribution')
    suite.client.ask('box_10x20x30', 50, surface='steel')
    suite.client.wait(lambda: late[-1].drops == 50, 'distribution of other conditions')


def test_known_answer_does_not_wait_for_an_active_run(suite):
    assert suite.client.ask('tetrahedron', 5, seed=[6]).status.code == Status.OK
    long = suite.client.dropping('tetrahedron', 2_000_000, seed=61)
    suite.client.wait(lambda: long.accepted, 'long goal')
    assert suite.client.ask('tetrahedron', 5, seed=[6]).status.code == Status.OK
    assert not long.done
    long.cancel()
    suite.client.wait(lambda: long.done, 'canceled goal')


# -- a restart, which ends the tests of the suite -------------------------------------------------


@pytest.fixture(scope='module')
def before(suite):
    """Return the distribution from the first classifier."""
    answer = suite.client.ask('tetrahedron', 300, seed=[77])
    assert answer.status.code == Status.OK
    suite.log_of(answer.distribution.run.run_id)
    return answer.distribution


@pytest.fixture(scope='module')
def restarted(suite, before):
    suite.restart('drop_simulator', 'aspect_classifier')
    return suite


def without_stamp(distribution):
    distribution.header.stamp.sec = distribution.header.stamp.nanosec = 0
    return distribution


def known(suite, part='tetrahedron', drops=300, **fields):
    return suite.client.ask(part, drops, only_known=True, **fields)


@pytest.mark.slow
def test_known_distribution_is_returned_at_once(restarted, before):
    answer = known(restarted, seed=[77])
    assert (answer.status.code, answer.status.message) == (Status.OK, '')
    assert without_stamp(answer.distribution) == without_stamp(before)
    # Without only_known, nothing is dropped either: the run is the old one.
    again = restarted.client.ask('tetrahedron', 200, seed=[77])
    assert again.distribution.run.run_id == before.run.run_id


@pytest.mark.slow
def test_known_distribution_needs_no_simulator(restarted, before):
    restarted.nodes['drop_simulator'].end()
    restarted.restart('aspect_classifier')
    answer = known(restarted, surface='rubber_mat', seed=[77])
    assert without_stamp(answer.distribution) == without_stamp(before)
    restarted.start_again('drop_simulator')


@pytest.mark.slow
def test_each_run_of_an_extended_distribution_has_a_log(suite, received):
    suite.client.ask(drops=100, seed=[4])
    second = suite.client.ask(drops=250, seed=[4]).distribution.run
    ids = list(dict.fromkeys(each.run.run_id for each in received if each.run.seed == 4))
    assert len(ids) == 2
    assert ids[1] == second.run_id
    for run_id in ids:
        suite.log_of(run_id)


@pytest.mark.slow
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
