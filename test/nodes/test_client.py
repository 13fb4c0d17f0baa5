"""The Python client over DDS, with a node that is spun and without a node."""

import math
import signal
import time
from types import SimpleNamespace

import pytest
import rclpy
from resting_aspects_interfaces.msg import Status
from scipy.spatial.transform import Rotation

from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.client import (
    AnswerTimeoutError,
    ClientUseError,
    InvalidValueError,
    NotAvailableError,
    RestingAspectsClient,
    UnknownPartError,
    connection,
)


@pytest.fixture
def spun(suite):
    """A client with the node that suite.client spins while it waits."""
    with RestingAspectsClient(suite.client.node) as client:
        yield client


@pytest.fixture
def unanswered_client(namespace):
    """A client without a suite."""
    with RestingAspectsClient(ros_args=['-r', f'__ns:={namespace}']) as client:
        yield client


def test_client_does_not_touch_rclpy_and_signals(client):
    assert not rclpy.ok()
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    rclpy.init()
    try:
        client.list_parts()
        client.close()
        assert rclpy.ok()
    finally:
        rclpy.shutdown()


def test_poses_are_classified(client, part):
    found = client.get_distribution('l_bracket', drops=20)
    for aspect in found.aspects:
        answer = client.classify_pose('l_bracket', aspect.orientation)
        assert (answer.aspect, answer.symmetry_class) == (aspect.id, aspect.symmetry_class)
    turn = Rotation.from_euler('zx', [77, 20], degrees=True)
    first = find_aspects(part('l_bracket')).aspects[0]
    tilted = (turn * Rotation.from_quat(first.orientation)).as_quat()
    none = client.classify_pose('l_bracket', tilted)
    assert (none.status.code, none.aspect) == (Status.NOT_AVAILABLE, 0)
    assert none.angle == pytest.approx(math.radians(20), abs=1e-9)
    with pytest.raises(UnknownPartError, match='box_10x20x30, '):
        client.classify_pose('gizmo', tilted)
    assert client.get_part('l_bracket').part_sha256 == part('l_bracket').part_sha256


def test_invalid_values_are_rejected_before_sending(unanswered_client):
    """Without a suite, a request that was sent would fail later, with another error."""
    with pytest.raises(InvalidValueError, match='expected printable text'):
        unanswered_client.get_distribution('a\0b')
    with pytest.raises(InvalidValueError, match='invalid timeout 0: ex'):
        unanswered_client.get_distribution('x', timeout=0)


def test_statuses_become_exceptions_and_a_closed_client_refuses(client):
    with pytest.raises(InvalidValueError, match="invalid surface 'ice': expected"):
        client.get_distribution('tetrahedron', surface='ice')
    with pytest.raises(NotAvailableError, match='no known distribution'):
        client.get_distribution('tetrahedron', seed=987, only_known=True)
    client.close()
    with pytest.raises(ClientUseError, match='this client is closed'):
        client.list_parts()


def test_closing_ends_the_requests_and_their_runs(suite, client):
    poses = suite.client.poses()
    answer = client.get_distribution_async('tetrahedron', drops=2_000_000, seed=79)
    suite.client.wait(lambda: any(b.run.seed == 79 for b in poses), 'first batch')
    client.close()
    assert isinstance(answer.exception(), ClientUseError)
    suite.client.wait(lambda: any(b.last and b.run.seed == 79 for b in poses), 'end of the run')


@pytest.mark.parametrize('timeout', [None, 600.0])
def test_abandoned_request_stops_its_run(suite, spun, monkeypatch, timeout):
    """Its drops are kept, after a cancel and after a timeout."""
    poses = suite.client.poses()
    seed = 84 if timeout is None else 85
    received = []
    answer = spun.get_distribution_async(
        'tetrahedron', drops=2_000_000, seed=seed, timeout=timeout, progress=received.append
    )
    suite.client.wait(lambda: received, 'progress')
    if timeout is None:
        answer.cancel()
    else:
        clock = SimpleNamespace(monotonic=lambda: time.monotonic() + timeout, sleep=time.sleep)
        monkeypatch.setattr(connection, 'time', clock)
    suite.client.wait(lambda: any(b.last and b.run.seed == seed for b in poses), 'end of the run')
    if timeout is not None:
        suite.client.wait(answer.done, 'timeout')
        assert isinstance(answer.exception(), AnswerTimeoutError)

    def known():
        answer = spun.get_distribution_async('tetrahedron', seed=seed, only_known=True)
        suite.client.wait(answer.done, 'what is known')
        return answer.exception() is None and answer.result()

    assert 0 < suite.client.wait(known, 'its drops are counted').drops < 2_000_000


def test_missing_suite_is_reported(unanswered_client, namespace):
    with pytest.raises(AnswerTimeoutError) as error:
        unanswered_client.get_distribution('washer', timeout=1)
    assert f'no aspect_classifier answers on {namespace}/get_distribution' in str(error.value)


@pytest.mark.slow
def test_shared_run_continues_after_one_cancel(suite, spun):
    asked = {'part': 'tetrahedron', 'drops': 20_000, 'seed': 86}
    with RestingAspectsClient(suite.client.node) as other:
        received, joined = [], []
        mine = spun.get_distribution_async(**asked, progress=received.append)
        suite.client.wait(lambda: received, 'progress')
        same = other.get_distribution_async(**asked, progress=joined.append)
        suite.client.wait(lambda: joined or same.done(), 'progress of the other')
        mine.cancel()
        suite.client.wait(same.done, 'the other answer')
        assert same.result().drops == 20_000
