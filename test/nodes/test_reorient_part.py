"""The action reorient_part, its latched matrices, and the service get_transitions."""

import dataclasses

import pytest
from builtin_interfaces.msg import Time
from rclpy.serialization import deserialize_message
from resting_aspects_interfaces.msg import Status, TransitionMatrix

import resting_aspects_ros as ra
from resting_aspects_ros.logs.bag import LogOutcome, recorded_outcome
from resting_aspects_ros.logs.reader import messages
from resting_aspects_ros.logs.topics import PART_TYPE, TRANSITIONS_TYPE
from resting_aspects_ros.ros.conversions import run_from
from resting_aspects_ros.ros.distribution_conversions import transitions_msg
from resting_aspects_ros.ros.interface import LATCHED

SEED = 5


@pytest.fixture(scope='module')
def found(suite):
    """Return the matrix of a finished goal."""
    goal = suite.client.reorient('tetrahedron', 'tap', 60, drops=100, seed=SEED)
    assert (goal.outcome, goal.result.status) == ('succeeded', Status(code=Status.OK))
    progress = [(each.drops, each.done) for each in goal.feedback]
    assert progress == sorted(set(progress))
    assert {each.total for each in goal.feedback} == {240}
    return goal.result.transitions


def test_matrix_and_run_are_those_of_the_python_interface(found, part):
    expected = ra.reorient(part('tetrahedron'), 'tap', 60, drops=100, seed=SEED, workers=1)
    assert list(found.counts) == expected.matrix.counts.ravel().tolist()
    assert list(found.actions) == [60, 60, 60, 60]
    assert [aspect.count for aspect in found.aspects] == expected.drop.counts.tolist()
    assert (found.drops, found.complete, found.ended) == (100, True, True)
    run = run_from(found.run)
    of_run = {'run_id': run.run_id, 'started': run.started}
    assert run == dataclasses.replace(expected.run, **of_run)
    assert (found.action.name, found.action.kind) == ('tap', 'kick')


def test_matrix_is_recorded_and_known(suite, found):
    folder = suite.log_of(found.run.run_id)
    *_, logged = messages(folder, TRANSITIONS_TYPE)
    assert deserialize_message(logged, TransitionMatrix) == found
    assert len(list(messages(folder, PART_TYPE))) == 1
    assert recorded_outcome(folder) == LogOutcome(240, whole=True)
    known = lambda: suite.client.transitions('tetrahedron', 'tap').transitions  # noqa: E731
    suite.client.wait(lambda: known() == found, 'known matrix')


def test_service_reports_what_is_not_known(suite):
    # No test of the shared suite requests actions on the box.
    for part, code in (
        ('box_10x20x30', Status.NOT_AVAILABLE),
        ('no_such_part', Status.UNKNOWN_PART),
    ):
        assert suite.client.transitions(part).status.code == code


def test_first_matrix_of_a_part_is_waited_for(suite, monkeypatch):
    monkeypatch.setattr('resting_aspects_ros.nodes.aspect_classifier.known.ARRIVAL', 300.0)
    topic, client = 'transitions/u_bracket', suite.client
    publisher = client.node.create_publisher(TransitionMatrix, topic, LATCHED)
    client.wait(lambda: client.node.count_publishers(f'{suite.namespace}/{topic}'), topic)
    asked = client.asking_transitions('u_bracket')
    assert client.ask('tetrahedron').status.code == Status.OK  # it answers other requests
    assert not asked.done()
    result = ra.reorient('u_bracket', 'tap', 2, drops=20)
    publisher.publish(transitions_msg(result, Time(sec=1), ended=True))
    client.wait(asked.done, 'the matrix')
    assert asked.result().status.code == Status.OK
    assert asked.result().transitions.run.part == 'u_bracket'
    client.node.destroy_publisher(publisher)


def test_invalid_matrix_is_ignored(suite):
    topic = 'transitions/box_10x20x30'
    publisher = suite.client.node.create_publisher(TransitionMatrix, topic, LATCHED)
    publisher.publish(TransitionMatrix())
    ignored = f"ignored a message on {suite.namespace}/{topic}: invalid run_id ''"
    for name in ('aspect_classifier', 'drop_recorder'):
        node = suite.nodes[name]
        suite.client.wait(lambda node=node: ignored in node.output, f'{name} ignores it')
    suite.client.node.destroy_publisher(publisher)


@pytest.mark.parametrize(
    ('fields', 'code', 'message'),
    [
        ({'action': 'no_action'}, Status.INVALID, "invalid action 'no_action': expected one of"),
        ({'drops': 0}, Status.INVALID, 'invalid drops 0: expected an integer from 1 to 2000000'),
    ],
)
def test_invalid_goal_is_aborted_with_a_message(suite, fields, code, message):
    goal = suite.client.reorient(**fields)
    assert (goal.outcome, goal.result.status.code) == ('aborted', code)
    assert message in goal.result.status.message


def test_actions_before_a_cancel_are_kept(suite):
    received = suite.client.listen(TransitionMatrix, 'transitions/tetrahedron', LATCHED)
    goal = suite.client.reorienting('tetrahedron', 'tap', 100_000, drops=20, seed=SEED)
    suite.client.wait(lambda: goal.feedback and goal.feedback[-1].done, 'first actions')
    suite.client.canceled(goal)
    found, status = goal.result.transitions, goal.result.status
    made = sum(found.actions)
    assert (goal.outcome, status.code) == ('canceled', Status.CANCELED)
    assert made > 0
    assert (found.complete, found.ended, len(found.long_run)) == (False, True, 4)
    suite.client.wait(lambda: received and received[-1] == found, 'last matrix')
    assert recorded_outcome(suite.log_of(found.run.run_id)) == LogOutcome(made, whole=True)
