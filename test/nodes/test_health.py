"""What nodes notice of each other: a simulator that is gone, and others of their kind."""

import pytest
from diagnostic_msgs.msg import DiagnosticStatus

CONSUMERS = ('aspect_classifier', 'drop_recorder')


@pytest.fixture(scope='module')
def suite(fresh_suite):
    return fresh_suite({'drop_recorder': {'nodes.drop_recorder.node.IDLE_WITHOUT_SOURCE': 1.0}})


@pytest.fixture(scope='module')
def diagnostics(suite, diagnostics_of):
    return diagnostics_of(suite.client)


def test_replayer_counts_as_a_source_of_poses(
    suite, diagnostics, start, batches, write_log, tmp_path_factory, wait
):
    suite.nodes['drop_simulator'].end()
    for node in CONSUMERS:
        diagnostics.wait(
            node, lambda *status: status[:2] == (DiagnosticStatus.WARN, 'no drop_simulator'), ''
        )
    log = write_log(tmp_path_factory.mktemp('replayed'), batches(2))
    replayer = start('log_replayer', suite.namespace, {'log': log})
    for node in CONSUMERS:
        diagnostics.wait(node, lambda level, *_: level == DiagnosticStatus.OK, f'{node} is well')
    replayer.end()
    suite.start_again('drop_simulator')


@pytest.mark.parametrize(
    ('node', 'level', 'expected'),
    [
        ('drop_simulator', DiagnosticStatus.ERROR, 'use another namespace or ROS_DOMAIN_ID'),
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
        return start(node, namespace, parameters, {'ros.discovery.DUPLICATE_DELAY': 0.5})

    expected = f'2 {node}s in namespace {namespace}: {expected}'
    first, second = begin(), begin()
    for each in (first, second):
        client.wait(lambda each=each: expected in each.output, 'message in the output')
    assert diagnostics.wait(node, lambda _, m, __: m != 'idle', 'diagnosis')[:2] == (
        level,
        expected,
    )
    second.end()
    diagnostics.wait(
        node, lambda *status: status[:2] == (DiagnosticStatus.OK, 'idle'), 'alone again'
    )
    assert first.output.count(expected) == 1
    begin()
    client.wait(lambda: first.output.count(expected) == 2, 'message again')
