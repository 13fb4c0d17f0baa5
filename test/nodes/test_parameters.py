"""Parameters over their ROS services: their descriptions, and which may change when."""

import shutil
from importlib import import_module

import pytest
import yaml
from rcl_interfaces.msg import ParameterType

from resting_aspects_ros.simulation.conditions import surfaces_file, surroundings_folder
from resting_aspects_ros.system import config_folder, parts_folder

FILE = config_folder() / 'resting_aspects.yaml'
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
        check_description(access.describe(parameter.name), parameter)


def check_description(reported, parameter):
    assert reported.description == parameter.description != ''
    assert reported.additional_constraints == parameter.allowed
    assert reported.read_only == (not parameter.changeable)
    assert reported.type == TYPES[type(parameter.default)]
    assert not reported.dynamic_typing
    ranges = [*reported.integer_range, *reported.floating_point_range]
    bounds = [(reported.from_value, reported.to_value) for reported in ranges]
    assert bounds == ([] if parameter.bounds is None else [parameter.bounds])
    if not isinstance(parameter.default, str):
        assert bounds, 'a number has bounds'


@pytest.mark.slow
def test_nodes_read_their_parameters_from_the_file(
    start, connect, parameters_of, namespace, tmp_path
):
    namespace += '/deep/er'
    (tmp_path / 'parts').mkdir()
    shutil.copy(parts_folder() / 'tetrahedron.stl', tmp_path / 'parts')
    surfaces = surfaces_file().read_text(encoding='utf-8').replace('steel:', 'granite:')
    (tmp_path / 'surfaces.yaml').write_text(surfaces, encoding='utf-8')
    shutil.copytree(surroundings_folder(), tmp_path / 'surroundings')
    changed = {
        'drop_simulator': {
            'parts_folder': str(tmp_path / 'parts'),
            'surfaces_file': str(tmp_path / 'surfaces.yaml'),
            'surroundings_folder': str(tmp_path / 'surroundings'),
            'surface': 'granite',
            'frame_id': 'cell_tray',
            'workers': 1,
        },
        'aspect_classifier': {
            'surfaces_file': str(tmp_path / 'surfaces.yaml'),
            'surroundings_folder': str(tmp_path / 'surroundings'),
            'frame_id': 'cell_tray',
            'publish_period': 0.5,
            'log_folder': '',
            'prior_weight': 50.0,
            'drift_window': 30,
            'drift_level': 0.02,
        },
        'drop_recorder': {'log_folder': str(tmp_path / 'logs')},
    }
    document = yaml.safe_load(FILE.read_text(encoding='utf-8'))
    for node, values in changed.items():
        given = document[f'/**/{node}']['ros__parameters']
        assert given.keys() == values.keys()
        assert all(given[name] != value for name, value in values.items())
        given.update(values)
    (tmp_path / 'changed.yaml').write_text(yaml.safe_dump(document), encoding='utf-8')
    file = ('--params-file', tmp_path / 'changed.yaml')
    nodes = [start(node, namespace, arguments=file) for node in SUITE]
    client = connect(namespace)
    for node, values in changed.items():
        reported = parameters_of(client, node)
        assert {name: reported.get(name) for name in values} == values
    assert 'ready: 1 part, 1 worker' in nodes[0].output
    found = client.ask(drops=3).distribution
    assert (found.run.conditions.surface, found.header.frame_id) == ('granite', 'cell_tray')
    received = client.poses()
    client.wait(lambda: received, 'poses')
    assert received[0].header.frame_id == 'cell_tray'


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
