"""Goals and requests in surroundings: from the drop to the log."""

import copy

import pytest
from resting_aspects_interfaces.msg import Status, SurroundingsDescription
from visualization_msgs.msg import MarkerArray

import resting_aspects_ros as ra
from resting_aspects_ros.logs.reader import messages
from resting_aspects_ros.logs.topics import SURROUNDINGS_TYPE
from resting_aspects_ros.nodes.aspect_classifier.publishers import BODIES
from resting_aspects_ros.ros.distribution_conversions import distribution_from
from resting_aspects_ros.ros.interface import LATCHED, SURROUNDINGS_MARKERS, SURROUNDINGS_QOS

PART = 'l_bracket'


@pytest.fixture(scope='module')
def answer(suite):
    """The answer to a request in the chute, which is dropped first."""
    return suite.client.ask(PART, 40, surroundings='l_chute', seed=[18])


def test_a_request_in_a_chute_counts_contacts(answer):
    assert answer.status.code == Status.OK, answer.status.message
    message = answer.distribution
    found = distribution_from(message)
    assert found.contacts.planes == ('belt', 'wall')
    direct = ra.drop(PART, drops=40, seed=18, surroundings='l_chute', workers=1)
    assert found.drops == 40
    assert found.counts.tolist() == direct.distribution.counts.tolist()
    assert (found.lost, found.sliding) == (direct.distribution.lost, direct.distribution.sliding)
    # The message has the most frequent contacts first.
    counts = [{p.contacts: p.count for p in each.contacts.placements} for each in (found, direct)]
    assert counts[0] == counts[1]


def test_only_the_same_surroundings_match(suite, answer):
    stated = answer.distribution.run.conditions
    changed = copy.deepcopy(stated)
    changed.surroundings.values[0] += 0.1

    def known(**fields):
        found = suite.client.ask(PART, 40, only_known=True, seed=[18], **fields)
        return found.distribution.run.run_id

    assert known(conditions=[stated]) == answer.distribution.run.run_id
    for other in ({}, {'surroundings': 'slope'}, {'conditions': [changed]}):
        assert known(**other) == ''


def test_surroundings_are_described_recorded_and_shown(suite, answer):
    run, name = answer.distribution.run, f'surroundings/{PART}'
    described = suite.client.listen(SurroundingsDescription, name, SURROUNDINGS_QOS)
    shown = suite.client.listen(MarkerArray, SURROUNDINGS_MARKERS, LATCHED)

    def description():
        return [each for each in described if each.run_id == run.run_id]

    (message,) = suite.client.wait(description, 'description')
    assert (message.part, message.surroundings) == (PART, run.conditions.surroundings)
    assert [body.name for body in message.bodies] == ['belt', 'wall']

    # One more drop: the markers are those of the run whose distribution changed last.
    suite.client.ask(PART, 41, surroundings='l_chute', seed=[18])

    def patches():
        return shown and len([m for m in shown[-1].markers if m.ns == BODIES]) == 2

    suite.client.wait(patches, 'markers')
    result = ra.read_log(suite.log_of(run.run_id))
    assert result.complete
    assert result.distribution.counts.tolist() == [a.count for a in answer.distribution.aspects]
    counted = sum(each.count for each in answer.distribution.contacts)
    assert sum(each.count for each in result.contacts.placements) == counted


def test_actions_in_surroundings_are_those_of_the_python_interface(suite):
    options = {'drops': 250, 'seed': 4}
    goal = suite.client.reorient(PART, 'tap', 5, surroundings='l_chute', **options)
    assert goal.outcome == 'succeeded', goal.result.status.message
    found = goal.result.transitions
    expected = ra.reorient(PART, 'tap', 5, surroundings='l_chute', workers=1, **options)
    assert list(found.counts) == expected.matrix.counts.ravel().tolist()
    assert [each.count for each in found.aspects] == expected.drop.counts.tolist()
    assert {each.total for each in goal.feedback} == {5 * len(found.aspects)}
    assert len(list(messages(suite.log_of(found.run.run_id), SURROUNDINGS_TYPE))) == 1
