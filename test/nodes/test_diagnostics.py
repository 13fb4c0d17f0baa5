"""The diagnostics of each node, also with a full disk, without a simulator, and of duplicates."""

import re

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from resting_aspects_interfaces.msg import PartDescription, RestingPoses
from ros_graph import Diagnostics

from resting_aspects_ros.ros.conversions import part_msg
from resting_aspects_ros.ros.interface import LATCHED, POSES


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


def test_missing_and_uncounted_drops_are_reported(
    start, connect, namespace, batches, part, tmp_path
):
    client = connect(namespace)
    diagnostics = Diagnostics(client)
    start('aspect_classifier', namespace, {'log_folder': tmp_path})
    out = client.node.create_publisher(RestingPoses, 'resting_poses', POSES)
    for data in list(batches(4))[:3:2]:
        out.publish(data)

    def reported(key, number):
        return diagnostics.wait(
            'aspect_classifier', lambda *status: status[2][key] == number, f'{number} {key}'
        )

    level, message, _ = reported('missing drops', '250')
    assert level == DiagnosticStatus.WARN
    assert message.startswith('250 drops are missing')
    # The aspects are unknown, since the part has not been described.
    reported('drops not counted yet', '500')
    described = client.node.create_publisher(PartDescription, 'parts/tetrahedron', LATCHED)
    described.publish(part_msg(part('tetrahedron')))
    reported('drops not counted yet', '250')


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
