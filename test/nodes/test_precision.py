"""Runs that stop as soon as every interval is narrow enough."""

import pytest
from resting_aspects_interfaces.msg import Status

from resting_aspects_ros.simulation.job import MAX_DROPS
from resting_aspects_ros.statistics.intervals import checkpoints, is_precise

PRECISION = 0.05


@pytest.fixture(scope='module')
def answer(suite):
    """Return the response to a request without a number of drops."""
    return suite.client.ask('tetrahedron', 0, precision=PRECISION, seed=[33])


def test_run_stops_at_the_first_precise_checkpoint(suite, answer, counts):
    assert answer.status.code == Status.OK
    distribution = answer.distribution
    assert distribution.complete
    assert distribution.run.precision == PRECISION
    assert distribution.drops == sum(counts(distribution))
    found = [aspect.count for aspect in distribution.aspects]
    assert is_precise(found, distribution.drops, PRECISION)
    assert distribution.drops in checkpoints(MAX_DROPS)
    # The run up to the previous checkpoint has the same first drops, and is not precise.
    before = max(drops for drops in checkpoints(MAX_DROPS) if drops < distribution.drops)
    shorter = suite.client.drop('tetrahedron', before, seed=33).result
    assert shorter.drops == before
    seen = suite.client.ask('tetrahedron', before, seed=[33], only_known=True).distribution
    assert seen.drops >= before
    for aspect in distribution.aspects:
        assert (aspect.upper - aspect.lower) / 2 <= PRECISION


def test_run_is_known_for_its_precision_and_coarser(suite, answer):
    def known(**fields):
        return suite.client.ask('tetrahedron', only_known=True, seed=[33], **fields)

    for precision in (PRECISION, 0.1):
        again = known(drops=0, precision=precision)
        assert again.status.code == Status.OK
        assert again.distribution.run == answer.distribution.run
    assert known(drops=0, precision=0.01).status.code == Status.NOT_AVAILABLE
    assert known(drops=answer.distribution.drops).status.code == Status.OK


def test_drops_is_the_maximum_number(suite):
    distribution = suite.client.ask('tetrahedron', 300, precision=0.01, seed=[4]).distribution
    assert distribution.drops == 300
    assert distribution.complete


def test_action_goal_stops_at_the_precision(suite, answer):
    result = suite.client.drop('tetrahedron', 0, precision=PRECISION, seed=33).result
    assert result.status.code == Status.OK
    assert result.drops == answer.distribution.drops
