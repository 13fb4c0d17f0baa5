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
    file = values['log files']
    suite.client.canceled(drop)
    assert drop.result.run_id in file
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
    first, _, third, _ = batches(4)
    out.publish(first)
    out.publish(third)

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


@pytest.mark.parametrize(
    ('node', 'level', 'advice'),
    [
        ('drop_simulator', DiagnosticStatus.ERROR, 'use another namespace or ROS_DOMAIN_ID'),
        ('drop_recorder', DiagnosticStatus.WARN, 'each writes a log of every run'),
    ],
)
def test_duplicate_nodes_report_each_other(
    start, connect, namespace, few_parts, tmp_path_factory, node, level, advice
):
    client = connect(namespace)
    diagnostics = Diagnostics(client)

    def begin():
        given = {'parts_folder': few_parts('tetrahedron')}
        if node == 'drop_recorder':
            given = {'log_folder': tmp_path_factory.mktemp('logs')}
        return start(node, namespace, given, {'ros.health.DUPLICATE_DELAY': 0.5})

    def reported(message):
        return diagnostics.wait(node, lambda _, m, __: m == message, message)[0]

    expected = f'2 {node}s in namespace {namespace}: {advice}'
    first, second = begin(), begin()
    # Both have one name, so the output has the lines of each.
    client.wait(lambda: first.output.count(expected) == 2, 'message of each')
    assert reported(expected) == level
    second.end()
    assert reported('idle') == DiagnosticStatus.OK
    assert first.output.count(expected) == 2
    begin()
    client.wait(lambda: first.output.count(expected) == 4, 'messages again')


# Last: it leaves an error.
def test_unrecorded_drops_are_not_counted_as_recorded(suite, diagnostics, tmp_path):
    # A log that is closed later would end the error.
    diagnostics.forget()
    diagnostics.wait('drop_recorder', lambda *status: not status[2]['log files'], 'closed logs')
    suite.logs.rename(tmp_path / 'logs')
    suite.logs.write_bytes(b'')  # no folder can be created there
    run_id = suite.client.drop('tetrahedron', 300, seed=6).result.run_id
    before = f'only 0 drops of run {run_id} of tetrahedron are recorded: '
    _, _, values = diagnostics.wait(
        'drop_recorder',
        lambda level, message, _: level == DiagnosticStatus.ERROR and message.startswith(before),
        before,
    )
    assert values['log files'] == ''
