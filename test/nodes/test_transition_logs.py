"""Transition matrices outlive nodes: they are in logs, which are read after a restart."""

import shutil
import signal

import pytest
from rclpy.serialization import serialize_message
from resting_aspects_interfaces.msg import Status, TransitionMatrix

import resting_aspects_ros as ra
from resting_aspects_ros.aspects.find import ASPECT_NUMBERING
from resting_aspects_ros.cli.main import main
from resting_aspects_ros.errors import InvalidValueError, LogError
from resting_aspects_ros.logs.bag import LogOutcome, recorded_outcome
from resting_aspects_ros.logs.reader import messages
from resting_aspects_ros.logs.topics import PART_TYPE, TRANSITIONS_TYPE, Topic
from resting_aspects_ros.nodes.aspect_classifier.log_loader import load_log
from resting_aspects_ros.ros.conversions import part_msg, time_msg
from resting_aspects_ros.ros.interface import ALL_LATCHED, LATCHED, offered_qos
from resting_aspects_ros.ros.transition_conversions import transitions_msg
from resting_aspects_ros.run_logs.recorder import RunRecorder

TOPIC = 'transitions/tetrahedron'


@pytest.fixture(scope='module')
def suite(fresh_suite):
    return fresh_suite(
        {
            'drop_simulator': {'nodes.drop_simulator.reorientation.PUBLISH_PERIOD': 0.05},
            'aspect_classifier': {'nodes.aspect_classifier.part_registry.QUIET_PERIOD': 1.0},
            'drop_recorder': {'nodes.run_tracking.tracker.GRACE': 0.5},
        },
        workers=1,
    )


@pytest.fixture(scope='module')
def first(suite):
    """Return the matrix of a recorded run."""
    found = suite.client.reorient('tetrahedron', 'tap', 20, drops=20, seed=1).result.transitions
    suite.log_of(found.run.run_id)
    return found


def latched(suite, what):
    """Return the matrices that a late subscriber receives."""
    late = suite.client.listen(TransitionMatrix, TOPIC, ALL_LATCHED)
    suite.client.wait(lambda: late, what)
    return late


def publishers(suite):
    """Return the names of the nodes that publish the topic."""
    topic = suite.client.node.resolve_topic_name(TOPIC)
    found = suite.client.node.get_publishers_info_by_topic(topic)
    return sorted(each.node_name for each in found)


def start_again(suite, *nodes):
    for node in nodes:
        assert suite.processes[node].end() == 0
    for node in nodes:
        suite.start_again(node)


@pytest.mark.slow
def test_matrices_are_known_and_latched_after_a_restart(suite, first):
    start_again(suite, 'drop_simulator', 'aspect_classifier')
    answer = suite.client.transitions('tetrahedron', 'tap')
    assert answer.status.code == Status.OK
    assert answer.transitions == first
    assert latched(suite, 'matrix of the log') == [first]
    assert publishers(suite) == ['aspect_classifier']

    # A new run replaces it: only the simulator publishes then.
    new = suite.client.reorient('tetrahedron', 'tap', 10, drops=20, seed=2).result.transitions
    suite.client.wait(lambda: publishers(suite) == ['drop_simulator'], 'one publisher')
    assert latched(suite, 'matrix of the new run') == [new]
    assert suite.client.transitions('tetrahedron').transitions == new

    # Without the simulator, the classifier publishes it again.
    suite.log_of(new.run.run_id)
    start_again(suite, 'drop_simulator')
    suite.client.wait(lambda: publishers(suite) == ['aspect_classifier'], 'the other publisher')
    assert latched(suite, 'matrix of the run before') == [new]
    assert len(list(suite.logs.glob('tetrahedron_*'))) == 2


@pytest.mark.slow
def test_canceled_run_does_not_hide_a_complete_one(suite, first):
    def known():
        found = suite.client.transitions('tetrahedron').transitions
        return found.complete and found

    complete = suite.client.wait(known, 'complete matrix')
    received = suite.client.listen(TransitionMatrix, TOPIC, ALL_LATCHED)
    goal = suite.client.reorienting('tetrahedron', 'tap', 300_000, drops=20, seed=3)
    suite.client.wait(lambda: len([m for m in received if m.run.seed == 3]) > 2, 'matrices')
    goal.cancel()
    suite.client.wait(lambda: goal.done, 'canceled goal')
    suite.client.wait(lambda: received[-1].ended and received[-1].run.seed == 3, 'its last')
    grown = [(sum(m.actions), m.ended) for m in received if m.run.seed == 3]
    assert grown == sorted(grown)
    assert [ended for _, ended in grown] == [False] * (len(grown) - 1) + [True]
    assert suite.client.transitions('tetrahedron').transitions == complete
    suite.log_of(goal.result.transitions.run.run_id)


@pytest.mark.slow
def test_actions_before_the_workers_die_are_kept(suite):
    # In surroundings with an edge, Bullet makes the actions, in processes.
    goal = suite.client.reorienting(
        'box_10x20x30', 'tap', 100_000, drops=20, surroundings='bowl_track'
    )
    suite.client.wait(lambda: goal.feedback and goal.feedback[-1].done, 'actions')
    simulator = suite.processes['drop_simulator']

    def ended():
        simulator.send_to_workers(signal.SIGKILL)  # there may be none that is alive
        return goal.done

    suite.client.wait(ended, 'its end')
    found, status = goal.result.transitions, goal.result.status
    assert (goal.outcome, status.code) == ('aborted', Status.FAILED)
    assert status.message.endswith(
        'died in a row near drop '
        f'{sum(found.actions)} of box_10x20x30; the actions made before are kept'
    )
    assert (found.complete, found.ended) == (False, True)
    assert recorded_outcome(suite.log_of(found.run.run_id)).drops == sum(found.actions)


@pytest.mark.slow
def test_log_of_a_killed_simulator_is_closed_as_incomplete(suite, first):
    received = suite.client.listen(TransitionMatrix, 'transitions/box_10x20x30', LATCHED)
    suite.client.reorienting('box_10x20x30', 'tap', 300_000, drops=20)
    suite.client.wait(lambda: len(received) > 2, 'matrices')
    suite.processes['drop_simulator'].end(signal.SIGKILL)
    log = suite.log_of(received[-1].run.run_id)
    last = load_log(log)
    assert recorded_outcome(log) == LogOutcome(sum(last.actions), whole=False)
    assert (last.complete, last.ended) == (False, False)
    suite.start_again('drop_simulator')
    start_again(suite, 'aspect_classifier')
    assert suite.client.transitions('box_10x20x30').transitions == last


# Logs without nodes


@pytest.fixture(scope='module')
def result(part):
    return ra.reorient(part('tetrahedron'), 'tap', 5, drops=10, seed=1, workers=1)


@pytest.fixture
def write(result, part, tmp_path):
    """Return a function that writes a log of matrices; it is not closed."""

    def write(*given):
        log = RunRecorder(tmp_path, result.run, 'actions')
        described = part_msg(part('tetrahedron'))
        topic = Topic('/parts/tetrahedron', PART_TYPE, offered_qos(LATCHED))
        log.write_part(topic, serialize_message(described), described, 1)
        topic = Topic(f'/{TOPIC}', TRANSITIONS_TYPE, offered_qos(LATCHED))
        for k, message in enumerate(given, 2):
            log.write(topic, serialize_message(message), k, k)
        return log

    return write


def matrix(result, *, ended=True):
    return transitions_msg(result, time_msg(1), ended=ended)


@pytest.mark.parametrize('ended', [False, True])
def test_log_that_was_cut_off_keeps_its_complete_messages(write, result, ended, tmp_path, capsys):
    log = write(matrix(result, ended=False), matrix(result, ended=ended))
    cut = shutil.copytree(log.folder, tmp_path / 'cut')
    (file,) = cut.glob('*.mcap')
    size = file.stat().st_size
    log.write(Topic(f'/{TOPIC}', TRANSITIONS_TYPE, offered_qos(LATCHED)), bytes(1000), 9, 9)
    (written,) = log.folder.glob('*.mcap')
    file.write_bytes(written.read_bytes()[: size + 50])  # in the middle of the third message
    with pytest.raises(LogError, match='it is not closed: repair it'):
        load_log(cut)
    assert main(['recover', str(cut)]) == 0
    text = '3 messages recovered, 20 of 20 actions of tetrahedron, tap'
    assert capsys.readouterr().out == f'{cut}: {text}\n'
    assert len(list(messages(cut, TRANSITIONS_TYPE))) == 2
    assert load_log(cut).ended == ended
    assert recorded_outcome(cut) == LogOutcome(20, whole=ended)


def test_info_describes_a_log_of_actions(write, result, capsys):
    log = write(matrix(result))
    log.drops = 20
    log.run_is_over(whole=True)
    log.close()
    assert main(['info', str(log.folder)]) == 0
    out = capsys.readouterr().out
    assert 'action      tap: kick, speed 0.3 m/s, ' in out
    assert 'actions     20 of 20\n' in out
    assert main(['info', '--json', str(log.folder)]) == 0
    out = capsys.readouterr().out
    assert '"actions_asked": 20' in out


def test_matrix_of_another_numbering_is_not_used(write, result):
    message = matrix(result)
    message.aspect_numbering = ASPECT_NUMBERING + 1
    log = write(message)
    log.close()
    with pytest.raises(InvalidValueError, match=f'expected {ASPECT_NUMBERING}'):
        load_log(log.folder)


def test_log_of_actions_has_no_drops(write, result):
    log = write(matrix(result))
    log.close()
    with pytest.raises(InvalidValueError, match='contains no drops'):
        ra.read_log(log.folder)
