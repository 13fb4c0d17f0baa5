"""Invalid requests are rejected with a message, and the nodes continue."""

import math
import shutil
import signal
import sys

import pytest
from resting_aspects_interfaces.msg import Status

from resting_aspects_ros.nodes.drop_simulator.goals import MAX_GOALS
from resting_aspects_ros.ros.conversions import conditions_msg
from resting_aspects_ros.simulation.conditions import parts_folder

NAMES = ('OK', 'INVALID', 'UNKNOWN_PART', 'NOT_AVAILABLE', 'BUSY', 'CANCELED', 'FAILED')
KINDS = {getattr(Status, name): name for name in NAMES}


@pytest.fixture(scope='module')
def suite(fresh_suite, tmp_path_factory):
    """Start a suite with a good and a broken part."""
    folder = tmp_path_factory.mktemp('parts')
    shutil.copy(parts_folder() / 'tetrahedron.stl', folder)
    whole = (folder / 'tetrahedron.stl').read_bytes()
    (folder / 'cut_short.stl').write_bytes(whole[:-20])
    quiet = {'nodes.aspect_classifier.part_registry.QUIET_PERIOD': 1.0}
    return fresh_suite({'aspect_classifier': quiet}, parts_folder=folder)


@pytest.fixture(params=['get_distribution', 'drop_part'])
def refused(request, suite):
    """Send an invalid request in either way; return the status name and the message."""

    def refused(**fields):
        if request.param == 'drop_part':
            drop = suite.client.drop(**fields)
            assert drop.outcome == 'aborted'
            assert drop.result.drops == 0
            status = drop.result.status
        else:
            if 'seed' in fields:
                fields['seed'] = [fields['seed']]
            answer = suite.client.ask(**fields)
            status = answer.status
            assert answer.distribution.drops == 0
        return KINDS[status.code], status.message

    yield refused
    assert suite.alive, [process.output for process in suite.processes.values()]
    assert suite.client.ask('tetrahedron', 5).status.code == Status.OK


@pytest.mark.parametrize(
    'name',
    ['no_such_part', '../x', '', 'a/b', 'x' * 300, 'Würfel ⬛', '/etc/passwd', 'tetrahedron\n'],
)
def test_unknown_part_name(refused, name):
    kind, message = refused(part=name)
    assert kind == 'UNKNOWN_PART'
    assert ' is not known; known parts: cut_short, tetrahedron' in message
    assert len(message) < 300


def test_part_with_a_broken_mesh(refused):
    kind, message = refused(part='cut_short')
    assert kind == 'INVALID'
    assert 'cut_short.stl' in message


@pytest.mark.parametrize('drops', [0, 10**12, 2**64 - 1])
def test_drops_out_of_bounds(refused, drops):
    message = f'invalid drops {drops}: expected an integer from 1 to 2000000'
    assert refused(drops=drops) == ('INVALID', message)


@pytest.mark.parametrize('value', [math.nan, math.inf, -math.inf, -0.5])
@pytest.mark.parametrize('name', ['friction', 'gravity'])
def test_conditions_out_of_bounds(refused, surfaces, name, value):
    conditions = conditions_msg(surfaces.get())
    setattr(conditions, name, value)
    kind, message = refused(conditions=[conditions])
    assert kind == 'INVALID'
    assert message.startswith(f'invalid {name} {value!r}: expected ')


def test_unknown_height_of(refused, surfaces):
    conditions = conditions_msg(surfaces.get())
    conditions.height_of = 7
    kind, message = refused(conditions=[conditions])
    assert (kind, message) == (
        'INVALID',
        'invalid height_of 7: expected 0 (LOWEST_POINT) or 1 (CENTRE_OF_MASS)',
    )


def test_centre_of_mass_too_low(refused, surfaces):
    conditions = conditions_msg(surfaces.get())
    conditions.height_of = conditions.CENTRE_OF_MASS
    conditions.height = 0.001
    kind, message = refused(conditions=[conditions])
    assert kind == 'INVALID'
    assert 'invalid height of the centre of mass 0.001 m' in message
    assert 'more than' in message


def test_unknown_surface(refused):
    assert refused(surface='ice') == (
        'INVALID',
        "invalid surface 'ice': expected one of rubber_mat, steel, thrown",
    )


@pytest.mark.parametrize('precision', [0.9, -1.0, 1e-4, math.nan, math.inf])
def test_precision_out_of_bounds(refused, precision):
    kind, message = refused(precision=precision)
    assert (kind, message) == (
        'INVALID',
        f'invalid precision {precision!r}: expected 0.001 to 0.25',
    )


def test_precision_requires_first_drop_0(suite):
    result = suite.client.drop(drops=1000, first_drop=125, precision=0.05).result
    assert result.status.code == Status.INVALID
    assert result.status.message.startswith('invalid first_drop 125: expected 0 for a run that')


def test_unknown_method(suite):
    answer = suite.client.ask(method='guess')
    assert answer.status.code == Status.INVALID
    assert answer.status.message == (
        "invalid method 'guess': expected drops or one of solid_angle, csa, crsa, stability, "
        'energy_barrier, quasi_static, rolling'
    )
    assert suite.client.ask(method='drops', drops=5).status.code == Status.OK


def test_request_for_drops_of_another_run(suite):
    run_id = suite.client.drop(drops=5, seed=21).result.run_id
    refused = suite.client.drop(drops=5, seed=22, run_id=run_id).result
    assert refused.status.code == Status.INVALID
    assert run_id in refused.status.message


@pytest.mark.parametrize('run_id', ['../../escape', 'a b', '-x', 'x' * 65, 'ä'])
def test_invalid_run_id(suite, run_id):
    refused = suite.client.drop(drops=5, run_id=run_id).result
    assert refused.status.code == Status.INVALID
    assert f'invalid run_id {run_id!r}: expected up to 64 letters' in refused.status.message


def test_goal_above_the_maximum_gets_busy(suite, diagnostics_of):
    simulator = suite.processes['drop_simulator']
    first = suite.client.dropping_in_bullet(drops=1)
    suite.client.wait(lambda: first.done, 'start of the worker processes')
    assert simulator.send_to_workers(signal.SIGSTOP) >= 1
    try:
        drops = [suite.client.dropping_in_bullet(drops=2, seed=seed) for seed in range(MAX_GOALS)]
        diagnostics = diagnostics_of(suite.client)
        many = str(MAX_GOALS)
        diagnostics.wait(
            'drop_simulator', lambda *status: status[2]['active runs'] == many, 'all runs'
        )
        one_more = suite.client.drop(drops=1)
        by_service = suite.client.ask(drops=7, seed=[31])
        assert not any(drop.done for drop in drops)
    finally:
        simulator.send_to_workers(signal.SIGCONT)
    message = f'{MAX_GOALS} drop_part goals are active, try again later'
    assert one_more.outcome == 'aborted'
    assert one_more.result.status == Status(code=Status.BUSY, message=message)
    assert by_service.status == Status(code=Status.BUSY, message=message)
    suite.client.wait(lambda: all(drop.done for drop in drops), 'goals')
    assert {drop.outcome for drop in drops} == {'succeeded'}
    assert suite.client.drop(drops=1).outcome == 'succeeded'


@pytest.mark.parametrize(
    ('node', 'parameter', 'message'),
    [
        ('drop_simulator', ('workers', 2000), 'workers out of range. Min: 0, Max: 1024'),
        ('drop_simulator', ('workers', -1), 'workers out of range. Min: 0, Max: 1024'),
        ('drop_simulator', ('workers', 'many'), "'workers' to 'many'"),
        ('drop_simulator', ('parts_folder', 'x' * 300), "invalid parts_folder 'xxx"),
        ('drop_simulator', ('surfaces_file', '{broken}'), 'surfaces.yaml'),
        ('aspect_classifier', ('surfaces_file', '{broken}'), 'surfaces.yaml'),
        ('drop_recorder', ('log_folder', 5), "'log_folder' to '5'"),
    ],
    ids=lambda value: '-'.join(map(str, value)) if isinstance(value, tuple) else None,
)
def test_node_that_cannot_start_prints_one_error_line(
    start, namespace, tmp_path, traceback, node, parameter, message
):
    broken = tmp_path / 'surfaces.yaml'
    broken.write_text('rubber_mat: [', encoding='utf-8')
    name, value = parameter
    process = start(node, namespace, {name: str(value).format(broken=broken)}, ready='')
    assert process.end(number=0) == 2
    errors = [line for line in process.output.splitlines() if line.startswith('error: ')]
    assert len(errors) == 1
    assert message in errors[0]
    assert not traceback(process.output)


def test_invalid_ros_arguments_print_one_error_line(run_command, traceback):
    module = 'resting_aspects_ros.nodes.drop_recorder.node'
    process = run_command(sys.executable, '-m', module, '--ros-args', '-p', 'nonsense')
    assert process.end(number=0) == 2
    assert 'error: ' in process.output
    assert 'nonsense' in process.output
    assert not traceback(process.output)
