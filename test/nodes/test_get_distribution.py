"""The service get_distribution: known, missing and running drops, and those before a restart."""

import itertools

import numpy as np
import pytest
from resting_aspects_interfaces.msg import AspectDistribution, Status

import resting_aspects_ros as ra
from resting_aspects_ros.aspects.estimate import RestingShape, estimate
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.ros.conversions import conditions_msg
from resting_aspects_ros.ros.interface import LATCHED


@pytest.fixture(scope='module')
def suite(fresh_suite):
    names = ('ros.goal_client.STARTUP_TIMEOUT', 'nodes.aspect_classifier.known.QUIET_PERIOD')
    return fresh_suite({'aspect_classifier': dict.fromkeys(names, 1.0)})


@pytest.fixture(scope='module')
def first(suite):
    """Return the response to the first request for a seed."""
    return suite.client.ask('tetrahedron', 260, seed=[7])


def test_answer_is_that_of_the_python_interface(first):
    assert (first.status.code, first.status.message) == (Status.OK, '')
    expected = ra.drop('tetrahedron', 260, seed=7).distribution
    found = first.distribution
    assert (found.complete, found.method, found.drops) == (True, 'drops', 260)
    assert [each.count for each in found.aspects] == expected.counts.tolist()
    for aspect in found.aspects:
        assert aspect.probability == aspect.count / 260
        assert aspect.lower < aspect.probability < aspect.upper
    shares = [(each.lower, each.upper) for each in expected.model_intervals()]
    assert [(each.model_lower, each.model_upper) for each in found.aspects] == shares


def test_known_distribution_needs_no_drop(suite, first, surfaces):
    received = suite.client.poses()
    suite.client.wait(lambda: received and received[-1].last, 'the first run')
    before = len(received)
    named = conditions_msg(surfaces.get())
    named.surface = 'my own name for it'
    for drops, fields in (
        (260, {'seed': [7]}),
        (100, {'seed': [7]}),
        (260, {}),
        (260, {'only_known': True}),
        (260, {'conditions': [named]}),
    ):
        answer = suite.client.ask('tetrahedron', drops, **fields)
        assert answer.status.code == Status.OK
        assert answer.distribution.run == first.distribution.run
        assert answer.distribution.drops == 260
    # A drop made now arrives after everything that these requests could have caused.
    new = suite.client.drop('tetrahedron', 1, seed=99).result.run_id
    suite.client.wait(lambda: received[-1].last and received[-1].run.run_id == new, 'the new run')
    assert len(received) == before + 1


def test_only_known_drops_nothing(suite, first):
    assert first.distribution.drops == 260
    for fields in ({'drops': 261}, {'drops': 260, 'seed': [8]}):
        status = suite.client.ask(**fields, only_known=True).status
        assert status.code == Status.NOT_AVAILABLE
        assert 'no known distribution' in status.message


def test_run_from_the_middle_does_not_match_its_seed(suite):
    assert suite.client.drop('box_10x20x30', 30, first_drop=500, seed=5).result.drops == 30
    refused = suite.client.ask('box_10x20x30', 30, seed=[5], only_known=True).status
    assert refused.code == Status.NOT_AVAILABLE
    assert suite.client.ask('box_10x20x30', 30, seed=[5]).distribution.run.first_drop == 0


def test_run_stops_at_the_precision_as_a_drop_does(suite, part, surfaces):
    own = surfaces.get().changed(friction=0.29)  # no other test drops under these conditions
    asked = {'seed': [33], 'conditions': [conditions_msg(own)]}
    expected = ra.drop(part('tetrahedron'), precision=0.05, seed=33, surface=own, workers=1)
    found = suite.client.ask(drops=0, precision=0.05, **asked).distribution
    assert [each.count for each in found.aspects] == expected.distribution.counts.tolist()
    assert max((each.upper - each.lower) / 2 for each in found.aspects) <= 0.05
    known = suite.client.ask(drops=0, precision=0.01, only_known=True, **asked)
    assert known.status.code == Status.NOT_AVAILABLE


def test_estimator_responds_without_a_drop(suite, part):
    box = part('box_10x20x30')
    answer = suite.client.ask(box.name, method='rolling')
    found = answer.distribution
    expected = estimate(RestingShape(box, find_aspects(box)), 'rolling').probabilities
    # The part was sent in a message, which does not round its numbers.
    np.testing.assert_array_equal([a.probability for a in found.aspects], expected)
    assert (found.method, found.drops, found.interval) == ('rolling', 0, '')


# -- drops that are missing -----------------------------------------------------------------------


@pytest.fixture(scope='module')
def received(suite):
    return suite.client.poses()


def counts(drops, seed):
    return ra.drop('tetrahedron', drops, seed=seed).distribution.counts.tolist()


def made(received, seed):
    """Return the ranges of the drops that were made of a seed."""
    return [
        (each.first_drop, each.first_drop + len(each.status))
        for each in received
        if each.run.seed == seed
    ]


def test_request_makes_only_the_drops_that_are_missing(suite, received):
    for drops in (400, 600):
        answer = suite.client.ask(drops=drops, seed=[1])
        assert answer.status.code == Status.OK, answer.status.message
        found = answer.distribution
        assert (found.drops, found.complete) == (drops, True)
        assert [each.count for each in found.aspects] == counts(drops, 1)
        assert (found.run.first_drop, found.run.drops) == (0, drops)
        suite.log_of(found.run.run_id)  # each run has one
    suite.client.wait(lambda: received and made(received, 1)[-1][1] == 600, 'drops')
    assert made(received, 1) == [(0, 400), (400, 600)]
    assert suite.client.ask(drops=500, seed=[1]).distribution.drops == 600


def test_concurrent_requests_make_the_larger_number_once(suite, received):
    asked = [suite.client.asking(drops=drops, seed=[2]) for drops in (500, 1500, 1000)]
    suite.client.wait(lambda: all(each.done() for each in asked), 'answers')
    found = [each.result().distribution for each in asked]
    assert max(each.drops for each in found) == found[1].drops == 1500
    assert [each.count for each in found[1].aspects] == counts(1500, 2)
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


# Last: it restarts nodes.
@pytest.mark.slow
def test_known_distribution_survives_restarts(suite):
    asked = {'part': 'tetrahedron', 'drops': 300, 'seed': [77]}
    before = suite.client.ask(**asked).distribution
    suite.log_of(before.run.run_id)

    def known(**fields):
        answer = suite.client.ask(**{**asked, **fields})
        assert (answer.status.code, answer.status.message) == (Status.OK, '')
        answer.distribution.header.stamp = before.header.stamp
        return answer.distribution

    suite.restart('drop_simulator', 'aspect_classifier')
    assert known(only_known=True) == before
    assert known(drops=200) == before  # without only_known, nothing is dropped either
    suite.nodes['drop_simulator'].end()
    assert known(only_known=True) == before  # the default surface is still known
    suite.restart('aspect_classifier')
    unnamed = suite.client.ask(**asked, only_known=True).status
    assert unnamed.code == Status.NOT_AVAILABLE
    assert 'no drop_simulator answers' in unnamed.message
    assert known(only_known=True, surface='rubber_mat') == before
