"""The Python client, while nodes are stopped, killed and started again."""

import signal

import pytest

from resting_aspects_ros.client import AnswerTimeoutError, NotAvailableError, RestingAspectsClient
from resting_aspects_ros.nodes import pending_request


@pytest.fixture(scope='module')
def suite(fresh_suite):
    return fresh_suite()


@pytest.fixture
def spun(suite):
    """A client with the node that suite.client spins while it waits."""
    with RestingAspectsClient(suite.client.node) as client:
        yield client


def test_a_timeout_says_how_far_the_drops_are(suite, spun):
    simulator = suite.processes['drop_simulator']
    try:
        answer = spun.get_distribution_async(
            'tetrahedron',
            drops=100_000,
            seed=81,
            timeout=10,
            progress=lambda _: simulator.send_to_group(signal.SIGSTOP),
        )
        suite.client.wait(answer.done, 'timeout')
    finally:
        simulator.send_to_group(signal.SIGCONT)
    with pytest.raises(AnswerTimeoutError, match=r'waited 10 s: \d+ drops are done$'):
        answer.result()


def test_a_classifier_that_is_killed_and_started_again_answers(suite, spun, monkeypatch):
    monkeypatch.setattr(pending_request, 'ASK_PERIOD', 1.0)
    heard = []
    answer = spun.get_distribution_async('tetrahedron', drops=6000, seed=82, progress=heard.append)
    suite.client.wait(lambda: heard, 'progress')
    suite.processes['aspect_classifier'].end(signal.SIGKILL)
    assert not answer.done()
    suite.start_again('aspect_classifier')
    suite.client.wait(answer.done, 'answer of the new classifier')
    assert (answer.result().drops, answer.result().run.seed) == (6000, 82)


def test_a_classifier_that_ends_is_waited_for_a_while(suite, spun, monkeypatch):
    monkeypatch.setattr(pending_request, 'SERVICE_TIMEOUT', 2.0)
    heard = []
    answer = spun.get_distribution_async('tetrahedron', drops=6000, seed=83, progress=heard.append)
    suite.client.wait(lambda: heard, 'progress')
    assert suite.processes['aspect_classifier'].end(signal.SIGTERM) == 0
    suite.client.wait(answer.done, 'error')
    with pytest.raises(
        AnswerTimeoutError, match=r'no aspect_classifier answers on .*, waited 2 s'
    ):
        answer.result()
    suite.start_again('aspect_classifier')


def test_a_simulator_that_is_killed_ends_the_request_in_words(suite, spun):
    heard = []
    answer = spun.get_distribution_async(
        'tetrahedron', drops=500_000, seed=84, progress=heard.append
    )
    suite.client.wait(lambda: heard, 'progress')
    suite.processes['drop_simulator'].end(signal.SIGKILL)
    suite.client.wait(answer.done, 'error')
    with pytest.raises(NotAvailableError, match='the simulator went away'):
        answer.result()
    suite.start_again('drop_simulator')
    again = spun.get_distribution_async('tetrahedron', drops=100, seed=85)
    suite.client.wait(again.done, 'answer of the next simulator')
    assert again.result().drops == 100
