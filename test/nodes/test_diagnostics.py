"""The diagnostics of each node, also with a full disk, without a simulator, and of duplicates."""

import re

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from ros_graph import Diagnostics


@pytest.fixture(scope='module')
def suite(fresh_suite):
    return fresh_suite()


@pytest.fixture(scope='module')
def diagnostics(suite):
    return Diagnostics(suite.client)


@pytest.mark.slow
def test_nodes_publish_diagnostics(suite, diagnostics):
    drop = suite.client.dropping('tetrahedron', 2_000_000, seed=1)  # until it is canceled
    for node in ('drop_simulator', 'aspect_classifier', 'drop_recorder'):
        level, message, values = diagnostics.wait(
            node, lambda _, __, values: int(values['drops per second']) > 0, node
        )
        assert level == DiagnosticStatus.OK
        assert re.fullmatch(r'tetrahedron: \d+ of 2000000 drops', message)
        assert values['active runs'] == '1'
    suite.client.canceled(drop)
    assert drop.result.run_id in values['log files']
    for node, key in (
        ('drop_simulator', 'drops made'),
        ('aspect_classifier', 'drops received'),
        ('drop_recorder', 'drops recorded'),
    ):
        _, _, values = diagnostics.wait(
            node, lambda _, message, __: message == 'idle', f'{node} idle'
        )
        assert int(values[key]) == drop.result.drops


@pytest.mark.parametrize('node', ['drop_simulator', 'drop_recorder'])
def test_duplicate_nodes_report_each_other(
    start, connect, namespace, few_parts, tmp_path_factory, node
):
    client = connect(namespace)
    diagnostics = Diagnostics(client)

    def begin():
        given = {'parts_folder': few_parts('tetrahedron')}
        if node == 'drop_recorder':
            given = {'log_folder': tmp_path_factory.mktemp('logs')}
        return start(node, namespace, given, {'ros.health.DUPLICATE_DELAY': 0.5})

    first, second = begin(), begin()
    problem = f'2 {node}s in namespace {namespace}: '
    # Both have one name, so the output has the lines of each.
    client.wait(lambda: first.output.count(problem) == 2, 'message of each')
    level, *_ = diagnostics.wait(node, lambda _, text, __: text.startswith(problem), problem)
    is_harmless = node == 'drop_recorder'
    assert level == (DiagnosticStatus.WARN if is_harmless else DiagnosticStatus.ERROR)
    second.end()
    diagnostics.wait(node, lambda level, *_: level == DiagnosticStatus.OK, 'no duplicate')
    begin()
    client.wait(lambda: first.output.count(problem) == 4, 'messages again')


# Last: it leaves an error.
def test_unrecorded_drops_are_not_counted_as_recorded(suite, diagnostics, tmp_path):
    # A log that is closed later would end the error.
    diagnostics.forget()
    diagnostics.wait('drop_recorder', lambda *status: not status[2]['log files'], 'closed logs')
    suite.logs.rename(tmp_path / 'logs')
    suite.logs.write_bytes(b'')  # no folder can be created there
    run_id = suite.client.drop('tetrahedron', 300, seed=6).result.run_id
    before = f'only 0 drops of run {run_id} of tetrahedron are recorded: '
    level, *_ = diagnostics.wait(
        'drop_recorder', lambda _, message, __: message.startswith(before), before
    )
    assert level == DiagnosticStatus.ERROR
