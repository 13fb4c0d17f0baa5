"""Which requests and parameters are refused, and the surface of a request that names none."""

import math

import pytest
from resting_aspects_interfaces.msg import DropConditions, Status
from ros_graph import Parameters

from resting_aspects_ros.nodes.drop_simulator.node import PARAMETERS
from resting_aspects_ros.ros.conversions import conditions_from
from resting_aspects_ros.ros.interface import DEFAULT_CONDITIONS, LATCHED
from resting_aspects_ros.simulation.workers import MAX_WORKERS

# -- invalid requests -----------------------------------------------------------------------------


@pytest.fixture(params=['get_distribution', 'drop_part'])
def refused(request, suite):
    """Send an invalid request in either way; return its status."""

    def refused(**fields):
        if request.param == 'drop_part':
            drop = suite.client.drop(**fields)
            assert (drop.outcome, drop.result.drops) == ('aborted', 0)
            return drop.result.status
        answer = suite.client.ask(**fields)
        assert answer.distribution.drops == 0
        return answer.status

    yield refused
    assert suite.client.ask('tetrahedron', 5).status.code == Status.OK


@pytest.mark.parametrize(
    ('fields', 'code', 'message'),
    [
        ({'part': 'x' * 300}, Status.UNKNOWN_PART, 'known parts: box_10x20x30, '),
        ({'drops': 2**64 - 1}, Status.INVALID, f'invalid drops {2**64 - 1}: expected'),
        ({'precision': math.nan}, Status.INVALID, 'invalid precision nan: expected'),
        ({'conditions': [DropConditions()]}, Status.INVALID, 'invalid height 0.0: expected'),
    ],
)
def test_invalid_request_is_refused_with_a_reason(refused, fields, code, message):
    status = refused(**fields)
    assert status.code == code
    assert message in status.message


# -- parameters -----------------------------------------------------------------------------------


def test_node_describes_its_parameters_as_declared(suite):
    access = Parameters(suite.client, 'drop_simulator')
    for parameter in PARAMETERS:
        reported = access.describe(parameter.name)
        assert reported.description == parameter.description
        assert reported.read_only == (not parameter.changeable)
    (found,) = access.describe('workers').integer_range
    assert (found.from_value, found.to_value) == (0, MAX_WORKERS)


def test_invalid_value_is_rejected_with_a_reason(suite):
    for node, name, value, message in (
        ('drop_simulator', 'surface', 'ice', "invalid surface 'ice': expected one of rubber_mat"),
        # ROS lets values just above a bound pass.
        ('aspect_classifier', 'publish_period', 10 + 1e-8, 'period 10.00000001: expected 0.05 to'),
    ):
        (reason,) = Parameters(suite.client, node).set(**{name: value})
        assert message in reason


# -- the default surface --------------------------------------------------------------------------


@pytest.fixture
def surface(suite):
    """Set the surface of the simulator; it is the default again after the test."""
    parameters = Parameters(suite.client, 'drop_simulator')
    yield lambda name: parameters.set(surface=name)
    assert parameters.set(surface='rubber_mat') == []


def test_default_surface_is_that_of_the_simulator(suite, surface, surfaces):
    for name in ('rubber_mat', 'steel'):
        assert surface(name) == []
        run_id = suite.client.drop(drops=3, seed=101).result.run_id
        found = suite.client.ask(drops=3, seed=[101]).distribution
        assert found.run.run_id == run_id, 'the same conditions: it is known'
        assert found.run.conditions.surface == name
    received = suite.client.listen(DropConditions, DEFAULT_CONDITIONS, LATCHED)
    suite.client.wait(lambda: received, 'default conditions')
    assert conditions_from(received[-1]) == surfaces.get('steel')
    # A request that names a surface is not affected.
    named = suite.client.ask(drops=3, seed=[101], surface='rubber_mat').distribution
    assert named.run.conditions.surface == 'rubber_mat'
