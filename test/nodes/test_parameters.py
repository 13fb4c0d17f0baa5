"""Parameters over their ROS services: their descriptions, and which may change when."""

import importlib
import math
import shutil

import pytest
import yaml
from rcl_interfaces.msg import ParameterType

from resting_aspects_ros.simulation.conditions import (
    config_folder,
    parts_folder,
    surfaces_file,
    surroundings_folder,
)

FILE = config_folder() / 'resting_aspects.yaml'
TYPES = {
    str: ParameterType.PARAMETER_STRING,
    int: ParameterType.PARAMETER_INTEGER,
    float: ParameterType.PARAMETER_DOUBLE,
}
# rclpy's own.
EVERY_NODE_HAS = {'use_sim_time', 'start_type_description_service'}


SUITE = ('drop_simulator', 'aspect_classifier', 'drop_recorder')


def declarations():
    """The declared parameters of each node of the suite, by its name."""
    found = {}
    others = ('log_replayer', 'feeder_controller', 'camera_simulator', 'vision_example')
    for node in (*SUITE, *others):
        found[node] = importlib.import_module(f'resting_aspects_ros.nodes.{node}.node').PARAMETERS
    return {node: {each.name: each for each in declared} for node, declared in found.items()}


DECLARED = declarations()
DECLARED_IN_SUITE = [(node, parameter) for node in SUITE for parameter in DECLARED[node].values()]


@pytest.fixture
def parameters(suite, parameters_of):
    """The parameters of each node; they are at their defaults again after the test."""
    found = {node: parameters_of(suite.client, node) for node in SUITE}
    before = {
        (node, p.name): found[node].get(p.name) for node, p in DECLARED_IN_SUITE if p.changeable
    }
    yield found
    for (node, name), value in before.items():
        assert found[node].set(**{name: value}) == []


# -- the declarations ----------------------------------------------------------------------------


@pytest.mark.parametrize('node', SUITE)
def test_node_describes_its_parameters_as_declared(suite, parameters_of, node):
    access = parameters_of(suite.client, node)
    assert access.names() == {*DECLARED[node], *EVERY_NODE_HAS}
    for parameter in DECLARED[node].values():
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


# -- the parameter file --------------------------------------------------------------------------


def entries():
    """Return the parameters in config/resting_aspects.yaml by node."""
    document = yaml.safe_load(FILE.read_text(encoding='utf-8'))
    assert all(name.startswith('/**/') and list(entry) == ['ros__parameters']
               for name, entry in document.items())  # fmt: skip
    return {
        name.removeprefix('/**/'): entry['ros__parameters'] for name, entry in document.items()
    }


def test_file_has_every_parameter_at_its_default():
    declared = {
        node: {name: parameter.default for name, parameter in parameters.items()}
        for node, parameters in DECLARED.items()
    }
    assert entries() == declared
    for node, values in entries().items():
        for name, value in values.items():
            assert type(value) is type(declared[node][name]), name


def test_every_entry_is_commented_with_bounds_and_changeability():
    comments, node, collected = {}, '', ''
    for line in FILE.read_text(encoding='utf-8').splitlines():
        text = line.strip()
        if line.startswith('/**/'):
            node = text.removeprefix('/**/').rstrip(':')
        elif text.startswith('#'):
            collected += text.removeprefix('#')
        elif ':' in text and 'ros__parameters' not in text:
            comments[node, text.split(':')[0]] = collected
            collected = ''
        else:
            collected = ''
    assert set(comments) == {(node, name) for node, names in DECLARED.items() for name in names}
    for (node, name), comment in comments.items():
        parameter = DECLARED[node][name]
        assert ('any time' in comment.lower()) == parameter.changeable, name
        if parameter.bounds is not None:
            assert '{:g} to {:g}'.format(*parameter.bounds) in comment


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


# -- setting them --------------------------------------------------------------------------------


@pytest.mark.parametrize('node', SUITE)
def test_read_only_parameters_cannot_be_set(parameters, node):
    for parameter in DECLARED[node].values():
        if not parameter.changeable:
            (message,) = parameters[node].set(**{parameter.name: parameter.default})
            assert message == f'Trying to set a read-only parameter: {parameter.name}.'


NO_SURFACE = "invalid surface '{}': expected one of rubber_mat, steel, thrown"
NO_FOLDER = "invalid log_folder '{}': expected a folder that exists or can be made"


@pytest.mark.parametrize(
    ('node', 'name', 'value', 'message'),
    [
        ('drop_simulator', 'surface', 'ice', NO_SURFACE.format('ice')),
        ('drop_simulator', 'surface', math.nan, "expected 'Type.STRING' got 'Type.DOUBLE'"),
        ('aspect_classifier', 'publish_period', math.nan, 'Min: 0.05, Max: 10.0, value: nan'),
        (
            'aspect_classifier',
            'publish_period',
            10.0 + 1e-8,  # which ROS lets pass
            'invalid publish_period 10.00000001: expected 0.05 to 10',
        ),
        ('aspect_classifier', 'publish_period', True, "expected 'Type.DOUBLE' got 'Type.BOOL'"),
        ('drop_recorder', 'log_folder', '', NO_FOLDER.format('')),
        ('drop_recorder', 'log_folder', str(FILE / 'x'), NO_FOLDER.format(FILE / 'x')),
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


# -- the others ----------------------------------------------------------------------------------
