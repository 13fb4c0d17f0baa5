"""Parameters over their ROS services: their descriptions, and which may change when."""

from importlib import import_module

import pytest
from rcl_interfaces.msg import ParameterType

TYPES = {
    str: ParameterType.PARAMETER_STRING,
    int: ParameterType.PARAMETER_INTEGER,
    float: ParameterType.PARAMETER_DOUBLE,
}
# rclpy's own.
EVERY_NODE_HAS = {'use_sim_time', 'start_type_description_service'}


SUITE = ('drop_simulator', 'aspect_classifier', 'drop_recorder')
DECLARED = {
    node: import_module(f'resting_aspects_ros.nodes.{node}.node').PARAMETERS for node in SUITE
}


@pytest.fixture
def parameters(suite, parameters_of):
    """The parameters of each node; they are at their defaults again after the test."""
    found = {node: parameters_of(suite.client, node) for node in SUITE}
    before = {
        (node, p.name): found[node].get(p.name)
        for node, declared in DECLARED.items()
        for p in declared
        if p.changeable
    }
    yield found
    for (node, name), value in before.items():
        assert found[node].set(**{name: value}) == []


@pytest.mark.parametrize('node', SUITE)
def test_node_describes_its_parameters_as_declared(suite, parameters_of, node):
    access = parameters_of(suite.client, node)
    assert access.names() == {*(each.name for each in DECLARED[node]), *EVERY_NODE_HAS}
    for parameter in DECLARED[node]:
        reported = access.describe(parameter.name)
        assert reported.description == parameter.description != ''
        assert reported.additional_constraints == parameter.allowed
        assert reported.read_only == (not parameter.changeable)
        assert reported.type == TYPES[type(parameter.default)]
        ranges = [*reported.integer_range, *reported.floating_point_range]
        bounds = [(each.from_value, each.to_value) for each in ranges]
        assert bounds == ([] if parameter.bounds is None else [parameter.bounds])


NO_SURFACE = "invalid surface '{}': expected one of rubber_mat, steel, thrown"
NO_FOLDER = "invalid log_folder '{}': expected a folder that exists or can be made"


@pytest.mark.parametrize(
    ('node', 'name', 'value', 'message'),
    [
        ('drop_simulator', 'surface', 'ice', NO_SURFACE.format('ice')),
        (
            'aspect_classifier',
            'publish_period',
            10.0 + 1e-8,  # which ROS lets pass
            'invalid publish_period 10.00000001: expected 0.05 to 10',
        ),
        ('drop_recorder', 'log_folder', '', NO_FOLDER.format('')),
        # The permissions of /proc allow the folder, but creating it fails.
        ('drop_recorder', 'log_folder', '/proc/x/y', NO_FOLDER.format('/proc/x/y') + ': No such'),
    ],
    ids=lambda value: str(value)[:20],
)
def test_invalid_value_is_rejected_with_a_reason(parameters, node, name, value, message):
    before = parameters[node].get(name)
    (reason,) = parameters[node].set(**{name: value})
    assert message in reason
    assert parameters[node].get(name) == before
