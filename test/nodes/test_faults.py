"""Nodes that start late, are slow, die, or are missing."""

import signal

import pytest
from resting_aspects_interfaces.msg import Status
from rosbags.highlevel import AnyReader

from resting_aspects_ros.ros.interface import MIN_BATCH

# Shorter timeouts, which do not change the tested behaviour.
QUICK = {
    'aspect_classifier': {
        'nodes.run_tracking.tracker.CHECK_PERIOD': 0.2,
        'ros.goal_client.RETRY_PERIOD': 1.0,
        'nodes.aspect_classifier.drop_part_requests.STARTUP_TIMEOUT': 1.0,
        'nodes.aspect_classifier.drop_part_requests.DISCOVERY_TIMEOUT': 1.0,
    },
    'drop_recorder': {
        'nodes.run_tracking.tracker.CHECK_PERIOD': 0.2,
        'ros.goal_client.RETRY_PERIOD': 1.0,
        'run_logs.recorder.END_TIMEOUT': 2.0,
    },
}


@pytest.fixture(scope='module')
def suite(fresh_suite):
    return fresh_suite(QUICK)


@pytest.fixture
def recorded():
    """Return the indices of the drops in a log, in their order."""

    def recorded(folder):
        (file,) = folder.glob('*.mcap')
        found = []
        with AnyReader([file]) as reader:
            for connection, _, data in reader.messages():
                if connection.topic.endswith('/resting_poses'):
                    batch = reader.deserialize(data, connection.msgtype)
                    found += range(batch.first_drop, batch.first_drop + len(batch.poses))
        return found

    return recorded


@pytest.mark.slow
def test_late_node_receives_the_whole_run(suite, start, recorded, tmp_path, counts):
    """A recorder and a classifier start in the middle of a run, and others after it."""
    drops = 8 * MIN_BATCH + 50
    # In surroundings with an edge, worker processes make the drops, which can be held up.
    asked_for = {'seed': [41], 'surroundings': 'bowl_track'}
    received = suite.client.poses()
    asked = suite.client.asking('tetrahedron', drops, **asked_for)
    suite.client.wait(lambda: any(batch.run.seed == 41 for batch in received), 'first batch')
    simulator = suite.processes['drop_simulator']
    assert simulator.send_to_workers(signal.SIGSTOP)
    middle = start('drop_recorder', suite.namespace, {'log_folder': tmp_path / 'middle'})
    assert not asked.done()
    simulator.send_to_workers(signal.SIGCONT)
    suite.client.wait(asked.done, 'answer')
    expected = asked.result().distribution
    suite.processes['aspect_classifier'].end()
    after = start('drop_recorder', suite.namespace, {'log_folder': tmp_path / 'after'}, ready='')
    suite.start_again('aspect_classifier')
    for name, recorder in (('middle', middle), ('after', after)):
        pattern = f'{name}/*_{expected.run.run_id}/metadata.yaml'
        suite.client.wait(lambda pattern=pattern: list(tmp_path.glob(pattern)), f'log {name}')
        (metadata,) = tmp_path.glob(pattern)
        assert recorded(metadata.parent) == list(range(drops))
        assert recorder.end() == 0

    def known():
        answer = suite.client.ask(drops=drops, **asked_for, only_known=True)
        return answer.status.code == Status.OK and answer.distribution

    distribution = suite.client.wait(known, 'what the late classifier knows')
    assert distribution.run == expected.run
    assert counts(distribution) == counts(expected)


@pytest.mark.slow
def test_suspended_node_loses_no_drops(suite, recorded):
    drops = 4 * MIN_BATCH
    slow = [suite.processes[name] for name in ('aspect_classifier', 'drop_recorder')]
    for process in slow:
        process.send(signal.SIGSTOP)
    try:
        drop = suite.client.drop('tetrahedron', drops, seed=42)
    finally:
        for process in slow:
            process.send(signal.SIGCONT)
    assert drop.result.drops == drops

    def known():
        answer = suite.client.ask(drops=drops, seed=[42], only_known=True)
        return answer.status.code == Status.OK and answer.distribution

    assert suite.client.wait(known, 'what the slow classifier knows').drops == drops
    assert recorded(suite.log_of(drop.result.run_id)) == list(range(drops))


def test_missing_simulator_is_reported(suite):
    known = suite.client.ask(drops=5, seed=[44])
    received = suite.client.poses()
    asked = suite.client.asking('tetrahedron', 2_000_000, seed=[45])
    suite.client.wait(lambda: any(batch.run.seed == 45 for batch in received), 'first batch')
    assert suite.processes['drop_simulator'].end(signal.SIGTERM) == 0
    suite.client.wait(asked.done, 'answer of the interrupted request')
    assert asked.result().status.code == Status.NOT_AVAILABLE
    assert asked.result().status.message == 'the simulator stopped while it simulated tetrahedron'
    answer = suite.client.ask(drops=5, seed=[46])
    assert answer.status.code == Status.NOT_AVAILABLE
    why, _, known_are = answer.status.message.partition('; known distributions: ')
    assert why == (
        f'no drop_simulator answers on {suite.namespace}/drop_part, waited 1 s: start '
        'drop_simulator'
    )
    # Newest first; the drops of the run that ended early may precede it.
    assert '5 drops on rubber_mat with seed 44' in known_are.split(', ')[:2]
    # Known distributions do not need the simulator.
    assert suite.client.ask(drops=5, seed=[44]).distribution.run == known.distribution.run
    # The log of the abandoned run is closed.
    run_id = next(batch.run.run_id for batch in received if batch.run.seed == 45)
    suite.log_of(run_id)
    suite.start_again('drop_simulator')
    # Discovery by the classifier may take longer than its timeout in this test.
    suite.client.wait(
        lambda: suite.client.ask(drops=5, seed=[46]).status.code == Status.OK, 'good answer'
    )


# Last test: ROS lists a killed node for another 20 s.
@pytest.mark.slow
def test_restarted_simulator_does_not_end_other_nodes(suite, counts):
    received = suite.client.poses()
    asked = suite.client.asking('tetrahedron', 2_000_000, seed=[43])
    suite.client.wait(lambda: any(batch.run.seed == 43 for batch in received), 'first batch')
    run_id = next(batch.run.run_id for batch in received if batch.run.seed == 43)
    suite.client.wait(lambda: list(suite.logs.glob(f'*_{run_id}')), 'recorded batch')
    suite.processes['drop_simulator'].end(signal.SIGKILL)
    suite.start_again('drop_simulator')
    suite.client.wait(asked.done, 'answer in words')
    answer = asked.result()
    assert answer.status.code == Status.NOT_AVAILABLE
    # If the start takes longer than the killed one counts as alive, it has stopped first.
    assert answer.status.message in (
        'the simulator was restarted while it simulated tetrahedron: try again',
        'the simulator stopped while it simulated tetrahedron',
    )
    again = suite.client.ask('tetrahedron', 500, seed=[43])
    assert again.status.code == Status.OK
    assert again.distribution.drops == sum(counts(again.distribution)) == 500
    suite.log_of(run_id)
    assert suite.alive
