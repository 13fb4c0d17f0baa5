"""Transition matrices outlive nodes: they are in logs, which are read after a restart."""

import shutil

import pytest
from rclpy.serialization import serialize_message
from resting_aspects_interfaces.msg import TransitionMatrix

import resting_aspects_ros as ra
from resting_aspects_ros.cli.main import main
from resting_aspects_ros.errors import InvalidValueError, LogError
from resting_aspects_ros.logs.bag import LogOutcome, recorded_outcome
from resting_aspects_ros.logs.reader import messages
from resting_aspects_ros.logs.topics import PART_TYPE, TRANSITIONS_TYPE, Topic
from resting_aspects_ros.nodes.aspect_classifier.known import load_log
from resting_aspects_ros.ros.conversions import part_msg, time_msg
from resting_aspects_ros.ros.distribution_conversions import transitions_msg
from resting_aspects_ros.ros.interface import (
    ALL_LATCHED,
    LATCHED,
    offered_qos,
)
from resting_aspects_ros.run_logs import RunRecorder

TOPIC = 'transitions/tetrahedron'


@pytest.fixture(scope='module')
def suite(fresh_suite):
    constants = {
        'drop_simulator': {'nodes.drop_simulator.actions.MATRIX_PERIOD': 0.05},
        'aspect_classifier': {'nodes.aspect_classifier.known.QUIET_PERIOD': 1.0},
        'drop_recorder': {'nodes.drop_recorder.node.IDLE_WITHOUT_SOURCE': 0.5},
    }
    return fresh_suite(constants, workers=1)


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


@pytest.mark.slow
def test_matrices_are_known_and_latched_after_a_restart(suite):
    first = suite.client.reorient('tetrahedron', 'tap', 20, drops=20, seed=1).result.transitions
    suite.log_of(first.run.run_id)
    suite.restart('drop_simulator', 'aspect_classifier')
    assert suite.client.transitions('tetrahedron', 'tap').transitions == first
    assert latched(suite, 'matrix of the log') == [first]
    assert publishers(suite) == ['aspect_classifier']

    # A new run replaces it: only the simulator publishes then.
    new = suite.client.reorient('tetrahedron', 'tap', 10, drops=20, seed=2).result.transitions
    suite.client.wait(lambda: publishers(suite) == ['drop_simulator'], 'one publisher')
    assert latched(suite, 'matrix of the new run') == [new]

    # Without the simulator, the classifier publishes it again.
    suite.log_of(new.run.run_id)
    suite.restart('drop_simulator')
    suite.client.wait(lambda: publishers(suite) == ['aspect_classifier'], 'the other publisher')
    assert latched(suite, 'matrix of the run before') == [new]


# Logs without nodes


@pytest.fixture(scope='module')
def result(part):
    return ra.reorient(part('tetrahedron'), 'tap', 5, drops=10, seed=1, workers=1)


MATRICES = Topic(f'/{TOPIC}', TRANSITIONS_TYPE, offered_qos(LATCHED))


@pytest.fixture
def write(result, part, tmp_path):
    """Return a function that writes a log of matrices, given by whether they are the last."""

    def write(*ended):
        log = RunRecorder(tmp_path, result.run, 'actions')
        described = part_msg(part('tetrahedron'))
        topic = Topic('/parts/tetrahedron', PART_TYPE, offered_qos(LATCHED))
        log.write_part(topic, serialize_message(described), described, 1)
        for k, last in enumerate(ended, 2):
            message = transitions_msg(result, time_msg(1), ended=last)
            log.write(MATRICES, serialize_message(message), k, k)
        return log

    return write


@pytest.mark.parametrize('ended', [False, True])
def test_log_that_was_cut_off_keeps_its_complete_messages(write, ended, tmp_path, capsys):
    log = write(False, ended)
    cut = shutil.copytree(log.folder, tmp_path / 'cut')
    (file,) = cut.glob('*.mcap')
    size = file.stat().st_size
    log.write(MATRICES, bytes(1000), 9, 9)
    (written,) = log.folder.glob('*.mcap')
    file.write_bytes(written.read_bytes()[: size + 50])  # in the middle of the third message
    with pytest.raises(LogError, match='it is not closed: repair it'):
        load_log(cut)
    assert main(['recover', str(cut)]) == 0
    assert '3 messages recovered, 20 of 20 actions' in capsys.readouterr().out
    assert len(list(messages(cut, TRANSITIONS_TYPE))) == 2
    assert load_log(cut).ended == ended
    assert recorded_outcome(cut) == LogOutcome(20, whole=ended)
    log.close(whole=False)
    with pytest.raises(InvalidValueError, match='contains no drops'):
        ra.read_log(log.folder)
