"""The Python client while nodes are stopped, killed and restarted."""

import signal

import pytest

from resting_aspects_ros.api.conditions import with_surroundings
from resting_aspects_ros.client import (
    AnswerTimeoutError,
    NotAvailableError,
    RestingAspectsClient,
    pending_request,
)


@pytest.fixture(scope='module')
def suite(fresh_suite):
    return fresh_suite()


@pytest.fixture
def spun(suite):
    """A client with the node that suite.client spins while it waits."""
    with RestingAspectsClient(suite.client.node) as client:
        yield client


@pytest.fixture
def slow(surfaces):
    """Conditions with an edge, in which Bullet needs seconds for 1500 drops."""
    return with_surroundings(surfaces.get(), 'bowl_track')


@pytest.mark.slow
def test_timeout_error_contains_the_progress(suite, spun, ahead):
    simulator = suite.processes['drop_simulator']

    def hold_up(_):
        simulator.send_to_group(signal.SIGSTOP)
        ahead(600)

    try:
        answer = spun.get_distribution_async(
            'tetrahedron',
            drops=2_000_000,
            seed=81,
            timeout=600,
            progress=hold_up,
        )
        suite.client.wait(answer.done, 'timeout')
    finally:
        simulator.send_to_group(signal.SIGCONT)
    with pytest.raises(AnswerTimeoutError, match=r'waited 600 s: \d+ drops are done$'):
        answer.result()


@pytest.mark.slow
def test_stopped_classifier_leads_to_a_timeout(suite, spun, slow, monkeypatch):
    monkeypatch.setattr(pending_request, 'SERVICE_TIMEOUT', 2.0)
    received = []
    answer = spun.get_distribution_async(
        'tetrahedron', drops=1500, conditions=slow, seed=83, progress=received.append
    )
    suite.client.wait(lambda: received, 'progress')
    assert suite.processes['aspect_classifier'].end(signal.SIGTERM) == 0
    suite.client.wait(answer.done, 'error')
    with pytest.raises(
        AnswerTimeoutError, match=r'no aspect_classifier answers on .*, waited 2 s'
    ):
        answer.result()
    suite.start_again('aspect_classifier')


@pytest.mark.slow
@pytest.mark.parametrize('number', [signal.SIGTERM, signal.SIGKILL])
def test_stopped_simulator_leads_to_an_error(suite, spun, number):
    received = []
    answer = spun.get_distribution_async(
        'tetrahedron', drops=2_000_000, seed=84 + number, progress=received.append
    )
    suite.client.wait(lambda: received, 'progress')
    suite.processes['drop_simulator'].end(number)
    suite.client.wait(answer.done, 'error')
    with pytest.raises(NotAvailableError, match='the simulator stopped'):
        answer.result()
    suite.start_again('drop_simulator')
    again = spun.get_distribution_async('tetrahedron', drops=100, seed=85)
    suite.client.wait(again.done, 'answer of the next simulator')
    assert again.result().drops == 100


# Last test: ROS lists a killed node for another 20 s.
@pytest.mark.slow
def test_restarted_classifier_responds(suite, spun, slow, monkeypatch):
    monkeypatch.setattr(pending_request, 'RETRY_PERIOD', 1.0)
    received = []
    answer = spun.get_distribution_async(
        'tetrahedron', drops=1500, conditions=slow, seed=82, progress=received.append
    )
    suite.client.wait(lambda: received, 'progress')
    suite.processes['aspect_classifier'].end(signal.SIGKILL)
    assert not answer.done()
    suite.start_again('aspect_classifier')
    suite.client.wait(answer.done, 'answer of the new classifier')
    assert (answer.result().drops, answer.result().run.seed) == (1500, 82)
