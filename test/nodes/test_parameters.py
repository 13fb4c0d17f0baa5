"""Parameters over their ROS services: their descriptions, and which may change when."""

import importlib
import math
import shutil
import time

import pytest
import yaml
from rcl_interfaces.msg import ParameterType
from resting_aspects_interfaces.msg import AspectDistribution

from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.ros.interface import ALL_LATCHED
from resting_aspects_ros.ros.parameters import Parameter
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


def by_name(value):
    """The id of a test of a node's parameter."""
    return getattr(value, 'name', value)


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


def test_suite_nodes_are_found():
    assert set(DECLARED) >= set(SUITE)
    assert {name for node in DECLARED.values() for name in node} >= {'surface', 'workers'}


@pytest.mark.parametrize('value', [math.nan, math.inf, -math.inf, 0.0, 0.5 - 1e-9, 2.0 + 1e-9])
def test_number_out_of_bounds_is_rejected(value):
    parameter = Parameter('rate', 1.0, 'a rate', bounds=(0.5, 2.0))
    for allowed in (0.5, 1, 2.0):
        parameter.check(allowed)
    with pytest.raises(InvalidValueError) as refused:
        parameter.check(value)
    assert str(refused.value) == f'invalid rate {value!r}: expected 0.5 to 2'


def test_default_is_within_its_bounds():
    with pytest.raises(InvalidValueError, match='invalid rate 3'):
        Parameter('rate', 3, 'a rate', bounds=(1, 2))


@pytest.mark.parametrize(('node', 'parameter'), DECLARED_IN_SUITE, ids=by_name)
def test_node_describes_its_parameters_as_declared(suite, parameters_of, node, parameter):
    reported = parameters_of(suite.client, node).describe(parameter.name)
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


@pytest.mark.parametrize('node', SUITE)
def test_node_has_exactly_the_declared_parameters(suite, parameters_of, node):
    assert parameters_of(suite.client, node).names() == {*DECLARED[node], *EVERY_NODE_HAS}


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


@pytest.fixture
def start_with_file(start, wait):
    """Start a node with a parameter file, in some namespace."""

    def start_with_file(node, namespace, file):
        process = start(node, namespace, arguments=('--params-file', file), ready='')
        wait(lambda: 'ready' in process.output or not process.running, f'{node} ready')
        return process

    return start_with_file


def test_nodes_read_their_parameters_from_the_file(
    start_with_file, connect, parameters_of, namespace, tmp_path
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
    processes = [start_with_file(node, namespace, tmp_path / 'changed.yaml') for node in SUITE]
    client = connect(namespace)
    for node, values in changed.items():
        reported = parameters_of(client, node)
        assert {name: reported.get(name) for name in values} == values
    assert 'ready: 1 part, 1 worker' in processes[0].output
    found = client.ask(drops=3).distribution
    assert (found.run.conditions.surface, found.header.frame_id) == ('granite', 'cell_tray')
    received = client.poses()
    client.wait(lambda: received, 'poses')
    assert received[0].header.frame_id == 'cell_tray'
    assert all('not known' not in process.output for process in processes)


@pytest.mark.parametrize('node', SUITE)
def test_unmodified_file_changes_nothing(start_with_file, connect, parameters_of, namespace, node):
    process = start_with_file(node, namespace, FILE)
    assert process.running, process.output
    reported = parameters_of(connect(namespace), node)
    for name, parameter in DECLARED[node].items():
        assert reported.get(name) == parameter.default
    assert process.end() == 0
    assert 'not known' not in process.output


def test_parameter_file_and_surface_file_are_distinguished(start_with_file, start, namespace):
    process = start_with_file('aspect_classifier', namespace, surfaces_file())
    assert process.end(0) == 2
    assert 'Cannot have a value before ros__parameters' in process.output
    process = start('aspect_classifier', namespace, {'surfaces_file': FILE}, ready='')
    assert process.end(0) == 2
    assert "invalid name '/**/drop_simulator' of a surface" in process.output
    assert 'Not a ROS parameter file' in surfaces_file().read_text(encoding='utf-8')


# -- setting them --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ('node', 'parameter'),
    [pair for pair in DECLARED_IN_SUITE if not pair[1].changeable],
    ids=by_name,
)
def test_read_only_parameter_cannot_be_set(parameters, node, parameter):
    before = parameters[node].get(parameter.name)
    (message,) = parameters[node].set(**{parameter.name: parameter.default})
    assert message == f'Trying to set a read-only parameter: {parameter.name}.'
    assert parameters[node].get(parameter.name) == before


def test_changeable_parameters_are_these():
    changeable = {(node, p.name) for node, p in DECLARED_IN_SUITE if p.changeable}
    assert changeable == {
        ('drop_simulator', 'surface'),
        ('aspect_classifier', 'publish_period'),
        ('drop_recorder', 'log_folder'),
    }


NO_SURFACE = "invalid surface '{}': expected one of rubber_mat, steel, thrown"
NO_FOLDER = "invalid log_folder '{}': expected a folder that exists or can be made"


@pytest.mark.parametrize(
    ('node', 'name', 'value', 'message'),
    [
        ('drop_simulator', 'surface', 'ice', NO_SURFACE.format('ice')),
        ('drop_simulator', 'surface', 'steel\n', NO_SURFACE.format('steel\\n')),
        ('drop_simulator', 'surface', math.nan, "expected 'Type.STRING' got 'Type.DOUBLE'"),
        ('aspect_classifier', 'publish_period', math.nan, 'Min: 0.05, Max: 10.0, value: nan'),
        ('aspect_classifier', 'publish_period', math.inf, 'Min: 0.05, Max: 10.0, value: inf'),
        ('aspect_classifier', 'publish_period', -1.0, 'publish_period out of range'),
        (
            'aspect_classifier',
            'publish_period',
            10.0 + 1e-8,  # which ROS lets pass
            'invalid publish_period 10.00000001: expected 0.05 to 10',
        ),
        ('aspect_classifier', 'publish_period', 11, 'Min: 0.05, Max: 10.0, value: 11.0'),
        ('aspect_classifier', 'publish_period', True, "expected 'Type.DOUBLE' got 'Type.BOOL'"),
        ('drop_recorder', 'log_folder', '', NO_FOLDER.format('')),
        ('drop_recorder', 'log_folder', str(FILE / 'x'), NO_FOLDER.format(FILE / 'x')),
        ('drop_recorder', 'log_folder', 'x' * 9000, NO_FOLDER.format('x' * 9000)),
        # The permissions of /proc allow the folder, but creating it fails.
        ('drop_recorder', 'log_folder', '/proc/x/y', NO_FOLDER.format('/proc/x/y') + ': No such'),
    ],
    ids=lambda value: str(value)[:20],
)
def test_invalid_value_is_rejected_with_a_reason(suite, parameters, node, name, value, message):
    before = parameters[node].get(name)
    (reason,) = parameters[node].set(**{name: value})
    assert message in reason
    assert parameters[node].get(name) == before
    assert suite.processes[node].running


def test_integer_is_accepted_for_a_float(parameters):
    assert parameters['aspect_classifier'].set(publish_period=2) == []
    value = parameters['aspect_classifier'].get('publish_period')
    assert (value, type(value)) == (2.0, float)


def test_integer_at_the_start_is_accepted_for_a_float(start, connect, parameters_of, namespace):
    start('aspect_classifier', namespace, {'publish_period': 1})
    assert parameters_of(connect(namespace), 'aspect_classifier').get('publish_period') == 1.0


def test_list_of_strings_for_a_list_of_integers_is_rejected(start, namespace):
    process = start('feeder_controller', namespace, {'pickable_classes': '[a]'}, ready='')
    assert process.end(0) == 2
    assert 'pickable_classes' in process.output


def test_parameters_are_set_all_or_none(suite, parameters):
    simulator = parameters['drop_simulator']
    (message,) = simulator.set_all_or_nothing(surface='steel', workers=1)
    assert 'read-only' in message
    classifier = parameters['aspect_classifier']
    (message,) = classifier.set_all_or_nothing(publish_period=1.0, log_folder='x')
    assert 'read-only' in message
    assert simulator.get('surface') == 'rubber_mat'
    assert (
        classifier.get('publish_period') == DECLARED['aspect_classifier']['publish_period'].default
    )
    assert suite.client.drop(drops=2).done
    assert suite.client.ask(drops=2, only_known=True).distribution.run.conditions.surface == (
        'rubber_mat'
    )


# -- the others ----------------------------------------------------------------------------------


@pytest.mark.slow
def test_publish_period_limits_updates_during_a_run(suite, parameters):
    received = suite.client.listen(
        AspectDistribution, 'aspect_distributions/u_bracket', ALL_LATCHED
    )

    def reported(seed):
        suite.client.ask('u_bracket', 1000, seed=[seed])
        suite.client.wait(
            lambda: any(m.run.seed == seed and m.complete for m in received), 'last distribution'
        )
        return [m.complete for m in received if m.run.seed == seed]

    start = time.monotonic()
    assert parameters['aspect_classifier'].set(publish_period=10.0) == []
    *earlier, last = reported(seed=1)
    assert last is True  # published immediately
    assert len(earlier) <= (time.monotonic() - start) // 10  # none on a machine that is not busy
    assert parameters['aspect_classifier'].set(publish_period=0.05) == []
    often = reported(seed=2)
    assert len(often) > 1
    assert often[-1] is True


def test_new_log_folder_applies_to_new_runs(suite, parameters, tmp_path):
    before = suite.client.ask('washer', 3, seed=[1]).distribution.run.run_id
    suite.log_of(before)
    assert parameters['drop_recorder'].set(log_folder=str(tmp_path / 'a' / 'b')) == []
    after = suite.client.ask('washer', 3, seed=[2]).distribution.run.run_id
    suite.client.wait(lambda: list((tmp_path / 'a' / 'b').glob(f'*_{after}/metadata.yaml')), 'log')
    assert [path.name for path in suite.logs.glob('washer_*')] == [suite.log_of(before).name]
