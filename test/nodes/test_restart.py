"""A restarted classifier knows the distributions in the logs of earlier runs."""

import pytest
from resting_aspects_interfaces.msg import Status

from resting_aspects_ros.api.conditions import with_surroundings
from resting_aspects_ros.client import RestingAspectsClient, connection

SEED = 5


@pytest.fixture(scope='module')
def suite(fresh_suite):
    return fresh_suite(
        {
            'aspect_classifier': {
                'ros.goal_client.STARTUP_TIMEOUT': 1.0,
                'nodes.aspect_classifier.known.QUIET_PERIOD': 0.3,
            },
        },
        workers=1,
    )


@pytest.fixture(scope='module')
def first(suite):
    """Return the distribution from the first classifier."""
    answer = suite.client.ask('tetrahedron', 300, seed=[SEED])
    assert answer.status.code == Status.OK
    suite.log_of(answer.distribution.run.run_id)
    return answer.distribution


@pytest.fixture(scope='module')
def restarted(suite, first):
    suite.restart('drop_simulator', 'aspect_classifier')
    return suite


def without_stamp(distribution):
    distribution.header.stamp.sec = distribution.header.stamp.nanosec = 0
    return distribution


def known(suite, part='tetrahedron', drops=300, **fields):
    return suite.client.ask(part, drops, only_known=True, **fields)


def test_known_distribution_is_returned_at_once(restarted, first):
    answer = known(restarted, seed=[SEED])
    assert (answer.status.code, answer.status.message) == (Status.OK, '')
    assert without_stamp(answer.distribution) == without_stamp(first)
    # Without only_known, nothing is dropped either: the run is the old one.
    again = restarted.client.ask('tetrahedron', 200)
    assert again.distribution.run.run_id == first.run.run_id


def test_known_distribution_needs_no_simulator(restarted, first):
    restarted.nodes['drop_simulator'].end()
    restarted.restart('aspect_classifier')
    answer = known(restarted, surface='rubber_mat')
    assert without_stamp(answer.distribution) == without_stamp(first)
    restarted.start_again('drop_simulator')


def test_restarted_classifier_answers_a_waiting_client(suite, surfaces, monkeypatch):
    monkeypatch.setattr(connection, 'RETRY_PERIOD', 1.0)
    slow = with_surroundings(surfaces.get(), 'bowl_track')
    received = []
    with RestingAspectsClient(suite.client.node) as client:
        answer = client.get_distribution_async(
            'tetrahedron', drops=400, conditions=slow, seed=82, progress=received.append
        )
        suite.client.wait(lambda: received, 'progress')
        suite.nodes['aspect_classifier'].end()
        assert not answer.done()
        suite.start_again('aspect_classifier')
        suite.client.wait(answer.done, 'answer of the new classifier')
    assert (answer.result().drops, answer.result().run.seed) == (400, 82)
