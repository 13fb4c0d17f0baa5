"""Requests without a surface use the default surface of the simulator."""

import pytest
from resting_aspects_interfaces.msg import DropConditions, Status

from resting_aspects_ros.ros.conversions import conditions_from
from resting_aspects_ros.ros.interface import DEFAULT_CONDITIONS, LATCHED


@pytest.fixture
def simulator(suite, parameters_of):
    """The parameters of the simulator; its surface is the default again after the test."""
    found = parameters_of(suite.client, 'drop_simulator')
    yield found
    assert found.set(surface='rubber_mat') == []


@pytest.fixture
def surfaces_meant(suite):
    """Return the surfaces that drop_part and get_distribution use by default."""

    def surfaces_meant(seed):
        received = suite.client.poses()
        run_id = suite.client.drop(drops=3, seed=seed).result.run_id
        suite.client.wait(lambda: any(b.run.run_id == run_id for b in received), 'poses')
        (dropped,) = {b.run.conditions.surface for b in received if b.run.run_id == run_id}
        answer = suite.client.ask(drops=3, seed=[seed])
        assert answer.distribution.run.run_id == run_id, 'the same conditions: it is known'
        return dropped, answer.distribution.run.conditions.surface

    return surfaces_meant


def test_default_surface_is_that_of_the_simulator(suite, simulator, surfaces_meant, surfaces):
    assert surfaces_meant(seed=101) == ('rubber_mat', 'rubber_mat')
    assert simulator.set(surface='steel') == []
    assert surfaces_meant(seed=101) == ('steel', 'steel')
    received = suite.client.listen(DropConditions, DEFAULT_CONDITIONS, LATCHED)
    suite.client.wait(lambda: received, 'default conditions')
    assert conditions_from(received[-1]) == surfaces.get('steel')
    # A request that names a surface is not affected.
    named = suite.client.ask(drops=3, seed=[101], surface='rubber_mat').distribution
    assert named.run.conditions.surface == 'rubber_mat'


@pytest.mark.slow
def test_default_stays_known_after_the_simulator_stopped(fresh_suite):
    names = ('ros.goal_client.STARTUP_TIMEOUT', 'nodes.aspect_classifier.known.QUIET_PERIOD')
    quick = {'aspect_classifier': dict.fromkeys(names, 1.0)}
    suite = fresh_suite(quick, workers=1, surface='steel')
    first = suite.client.ask(drops=2).distribution
    assert first.run.conditions.surface == 'steel'
    suite.log_of(first.run.run_id)
    suite.nodes['drop_simulator'].end()
    known = suite.client.ask(drops=2, only_known=True).distribution
    assert known.run.conditions == first.run.conditions
    # A classifier that has received no default conditions has no default.
    suite.restart('aspect_classifier')
    unnamed = suite.client.ask(drops=2, only_known=True).status
    assert unnamed.code == Status.NOT_AVAILABLE
    assert 'no drop_simulator answers' in unnamed.message
    known = suite.client.ask(drops=2, only_known=True, surface='steel').distribution
    assert known.run.conditions == first.run.conditions
