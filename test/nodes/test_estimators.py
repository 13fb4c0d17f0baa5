"""Estimators as the method of get_distribution, requested over DDS."""

import math

import numpy as np
import pytest
from resting_aspects_interfaces.msg import Status

from resting_aspects_ros.aspects.estimate import METHODS, RestingShape, estimate
from resting_aspects_ros.aspects.find import find_aspects


@pytest.mark.quick_cases(2)
@pytest.mark.parametrize('method', METHODS)
def test_estimator_responds_without_a_drop(suite, part, method):
    received = suite.client.poses()
    suite.client.drop('tetrahedron', 1, seed=98)  # a fence: latched messages arrive before it
    suite.client.wait(lambda: any(b.run.seed == 98 for b in received), 'the fence')
    before = len(received)
    answer = suite.client.ask('u_bracket', method=method)
    assert (answer.status.code, answer.status.message) == (Status.OK, '')
    found = answer.distribution
    shape = RestingShape(part('u_bracket'), find_aspects(part('u_bracket')))
    expected = estimate(shape, method).probabilities
    # The part was sent in a message, which does not round its numbers.
    np.testing.assert_array_equal([a.probability for a in found.aspects], expected)
    assert (found.method, found.run.part, found.complete) == (method, 'u_bracket', True)
    assert found.run.part_sha256 == part('u_bracket').part_sha256
    assert (found.drops, found.interval, found.run.run_id) == (0, '', '')
    assert found.run.conditions.surface == ''
    assert all(math.isnan(each.lower) and math.isnan(each.upper) for each in found.aspects)
    for each in found.classes:
        together = sum(expected[k - 1] for k in each.aspects)
        assert each.probability == pytest.approx(together, abs=1e-12)
    # A drop made now arrives after everything that the request could have caused.
    new = suite.client.drop('tetrahedron', 1, seed=99).result.run_id
    suite.client.wait(lambda: any(b.run.run_id == new for b in received), 'the new run')
    assert 'u_bracket' not in {batch.run.part for batch in received[before:]}


def test_estimate_is_not_returned_for_drops(suite):
    assert suite.client.ask('washer', method='rolling').status.code == Status.OK
    answer = suite.client.ask('washer', 10, seed=[9900], only_known=True)
    assert answer.status.code == Status.NOT_AVAILABLE


@pytest.mark.parametrize('method', ['crsa', 'stability'])
def test_method_not_defined_for_a_part_is_rejected(suite, method):
    answer = suite.client.ask('cylinder_d20_h20', method=method)
    assert answer.status.code == Status.INVALID
    assert answer.status.message == (
        f'{method} is not defined for cylinder_d20_h20: aspect 1 rests on a curved side, not a '
        'polygon'
    )


def test_unknown_part_is_rejected(suite):
    answer = suite.client.ask('no_such_part', method='rolling')
    assert answer.status.code == Status.UNKNOWN_PART
    assert answer.status.message.startswith("part 'no_such_part' is not known; known parts: ")
