"""What nodes notice of each other: a simulator that is gone, and others of their kind."""

import itertools
import re
import signal

import pytest
from diagnostic_msgs.msg import DiagnosticStatus

CONSUMERS = ('aspect_classifier', 'drop_recorder')


@pytest.fixture(scope='module')
def suite(fresh_suite):
    return fresh_suite({'drop_recorder': {'nodes.drop_recorder.node.IDLE_WITHOUT_SOURCE': 1.0}})


@pytest.fixture(scope='module')
def diagnostics(suite, diagnostics_of):
    return diagnostics_of(suite.client)


@pytest.fixture
def begin(suite, diagnostics, seeds=itertools.count(1)):  # noqa: B008 - one for all tests is meant
    """Begin a run that does not end by itself, seen by all; its id."""

    def begin():
        seed = next(seeds)
        received = suite.client.poses()
        suite.client.dropping('tetrahedron', 2_000_000, seed=seed)

        def run_ids():
            return [batch.run.run_id for batch in received if batch.run.seed == seed]

        run_id = suite.client.wait(run_ids, 'first batch')[0]
        for node in CONSUMERS:
            diagnostics.wait(node, lambda _, __, v: run_id in v.get('run 1', ''), f'{node} has it')
            diagnostics.wait(node, lambda _, __, v: v['drop_simulators'] == '1', f'{node} sees it')
        return run_id

    return begin


@pytest.mark.slow
def test_interrupted_run_is_reported(suite, diagnostics, begin):
    run_id = begin()
    assert suite.processes['drop_simulator'].end(signal.SIGTERM) == 0
    for node in CONSUMERS:
        level, _, values = diagnostics.wait(
            node, lambda _, message, __: message.startswith('no drop_simulator'), f'{node}: gone'
        )
        assert (level, values['drop_simulators']) == (DiagnosticStatus.WARN, '0')
    expected = rf'run {run_id} of tetrahedron was interrupted: the closed log .* has '
    recorder = suite.processes['drop_recorder']
    suite.client.wait(lambda: re.search(expected, recorder.output), 'closed log')
    suite.start_again('drop_simulator')
    suite.client.drop('tetrahedron', 5, seed=100)
    for node in CONSUMERS:
        diagnostics.wait(node, lambda level, *_: level == DiagnosticStatus.OK, f'{node} is well')


@pytest.mark.slow
def test_replayer_counts_as_a_source_of_poses(
    suite, diagnostics, start, batches, write_log, tmp_path_factory, wait
):
    assert suite.processes['drop_simulator'].end(signal.SIGTERM) == 0
    for node in CONSUMERS:
        diagnostics.wait(
            node, lambda *status: status[:2] == (DiagnosticStatus.WARN, 'no drop_simulator'), ''
        )
    log = write_log(tmp_path_factory.mktemp('replayed'), batches(2))
    replayer = start('log_replayer', suite.namespace, {'log': log})
    for node in CONSUMERS:
        diagnostics.wait(node, lambda level, *_: level == DiagnosticStatus.OK, f'{node} is well')
    assert replayer.end() == 0
    suite.start_again('drop_simulator')


# Last: for 20 s a node that was killed is taken for present by ROS.
@pytest.mark.slow
def test_killed_simulator_is_reported(suite, diagnostics, begin):
    begin()
    suite.processes['drop_simulator'].end(signal.SIGKILL)
    for node in CONSUMERS:
        level, message, _ = diagnostics.wait(
            node, lambda _, __, values: values['drop_simulators'] == '0', f'{node} misses it'
        )
        assert level == DiagnosticStatus.WARN
        assert message.startswith('no drop_simulator')
        assert suite.processes[node].running


@pytest.mark.parametrize(
    ('node', 'level', 'expected'),
    [
        pytest.param(
            'drop_simulator',
            DiagnosticStatus.ERROR,
            'use another namespace or ROS_DOMAIN_ID',
            marks=pytest.mark.slow,
        ),
        ('drop_recorder', DiagnosticStatus.WARN, 'each writes a log of every run'),
    ],
)
def test_duplicate_nodes_report_each_other(
    start, connect, diagnostics_of, namespace, tmp_path, node, level, expected
):
    client = connect(namespace)
    diagnostics = diagnostics_of(client)
    folders = map(str, (tmp_path / 'a', tmp_path / 'b', tmp_path / 'c'))

    def begin():
        parameters = {} if node == 'drop_simulator' else {'log_folder': next(folders)}
        return start(node, namespace, parameters, {'ros.liveliness.DUPLICATE_DELAY': 0.5})

    expected = f'2 {node}s in namespace {namespace}: {expected}'
    first, second = begin(), begin()
    for each in (first, second):
        client.wait(lambda each=each: expected in each.output, 'message in the output')
    assert diagnostics.wait(node, lambda _, m, __: m != 'idle', 'diagnosis')[:2] == (
        level,
        expected,
    )
    assert second.end() == 0
    diagnostics.wait(
        node, lambda *status: status[:2] == (DiagnosticStatus.OK, 'idle'), 'alone again'
    )
    assert first.output.count(expected) == 1
    begin()
    client.wait(lambda: first.output.count(expected) == 2, 'message again')
