"""/diagnostics: what each node says of itself, and a disk that is full."""

import resource

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from resting_aspects_interfaces.msg import Status

from resting_aspects_ros.nodes.interface import DIAGNOSTICS


@pytest.fixture(scope='module')
def heard(suite):
    """The newest status of each node, by its name."""
    newest = {}

    def take(message):
        for status in message.status:
            newest[status.name] = status

    suite.client.node.create_subscription(DiagnosticArray, DIAGNOSTICS, take, 10)
    return newest


def of(suite, heard, node):
    return heard.get(f'{suite.namespace[1:]}/{node}')


def values(status):
    return {each.key: each.value for each in status.values}


def wait_for(suite, heard, node, holds, what):
    """The node's status, once it is as it should be."""

    def found():
        status = of(suite, heard, node)
        return status if status is not None and holds(status) else None

    return suite.client.wait(found, what)


def test_nodes_say_what_they_do_once_a_second(suite, heard):
    drop = suite.client.dropping('tetrahedron', 500_000, seed=1)  # until it is canceled
    for node in ('drop_simulator', 'aspect_classifier', 'drop_recorder'):
        status = wait_for(
            suite, heard, node, lambda s: int(values(s)['drops per second']) > 0, node
        )
        assert status.level == DiagnosticStatus.OK
        assert status.message in ('1 runs under way', '1 logs open')
    file = values(of(suite, heard, 'drop_recorder'))['log files']
    drop.cancel()
    suite.client.wait(lambda: drop.done, 'canceled run')
    assert drop.result.log == file
    for node, key in (
        ('drop_simulator', 'drops made'),
        ('aspect_classifier', 'drops received'),
        ('drop_recorder', 'drops recorded'),
    ):
        status = wait_for(suite, heard, node, lambda s: s.message == 'idle', f'{node} idle')
        assert int(values(status)[key]) == drop.result.drops


def test_a_full_disk_stops_the_log_and_not_the_answer(suite, heard):
    recorder = suite.processes['drop_recorder']
    # As a quota: no file of the recorder grows beyond this.
    _, hard = resource.prlimit(recorder.pid, resource.RLIMIT_FSIZE)
    resource.prlimit(recorder.pid, resource.RLIMIT_FSIZE, (40_000, hard))
    drop = suite.client.drop('tetrahedron', 2000, seed=2)
    assert (drop.result.status.code, drop.result.drops) == (Status.OK, 2000)
    words = f'log {drop.result.log}'
    assert drop.result.log_error.startswith(words)
    assert drop.result.log_error.endswith('cannot be written: File too large')
    status = wait_for(
        suite, heard, 'drop_recorder', lambda s: s.level == DiagnosticStatus.ERROR, 'error'
    )
    assert status.message == (f'run {drop.result.run_id} is not recorded: {drop.result.log_error}')
    answer = suite.client.ask('tetrahedron', 2000, seed=[3])
    assert answer.status.code == Status.OK
    assert answer.status.message.startswith('the run is not recorded: log ')
    assert answer.distribution.drops == 2000
    # There is space again: the next run is recorded, and the error is over.
    resource.prlimit(recorder.pid, resource.RLIMIT_FSIZE, (hard, hard))
    again = suite.client.drop('tetrahedron', 300, seed=4)
    assert (again.result.log_error, again.result.log != '') == ('', True)
    suite.log_of(again.result.run_id)
    wait_for(suite, heard, 'drop_recorder', lambda s: s.level == DiagnosticStatus.OK, 'well')
    assert recorder.running


def test_a_disk_that_is_full_at_the_end_of_a_run_is_in_its_result(suite):
    """All drops are in the log, and what closes it is not."""
    first = suite.client.drop('tetrahedron', 5, seed=10).result
    (file,) = suite.log_of(first.run_id).glob('*.mcap')
    size = file.stat().st_size
    recorder = suite.processes['drop_recorder']
    _, hard = resource.prlimit(recorder.pid, resource.RLIMIT_FSIZE)
    # The same once more, but for the last of the index.
    resource.prlimit(recorder.pid, resource.RLIMIT_FSIZE, (size - 500, hard))
    try:
        drop = suite.client.drop('tetrahedron', 5, seed=11)
    finally:
        resource.prlimit(recorder.pid, resource.RLIMIT_FSIZE, (hard, hard))
    assert (drop.result.status.code, drop.result.drops) == (Status.OK, 5)
    assert drop.result.log_error.endswith('cannot be written: File too large')


def test_without_a_recorder_a_result_says_so_and_does_not_wait(suite):
    assert suite.processes['drop_recorder'].end() == 0
    suite.client.wait(
        lambda: not suite.client.node.count_publishers(f'{suite.namespace}/recorded_runs'), 'gone'
    )
    drop = suite.client.drop('tetrahedron', 20, seed=5)
    assert (drop.result.status.code, drop.result.log, drop.result.log_error) == (0, '', '')
    suite.start_again('drop_recorder')
