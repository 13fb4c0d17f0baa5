"""The service get_distribution, requested over DDS."""

import math

import numpy as np
import pytest
from resting_aspects_interfaces.msg import Status

import resting_aspects_ros as ra
from resting_aspects_ros.aspects.estimate import RestingShape, estimate
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.ros.conversions import conditions_msg


@pytest.fixture(scope='module')
def suite(fresh_suite):
    return fresh_suite()


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
