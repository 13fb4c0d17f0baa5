"""The Python client over DDS, with a node that is spun and without a node."""

import math
import re
import signal
import threading
import time
from types import SimpleNamespace

import pytest
import rclpy
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node
from resting_aspects_interfaces.msg import Status
from scipy.spatial.transform import Rotation

from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.client import (
    AnswerTimeoutError,
    ClientUseError,
    InvalidValueError,
    NotAvailableError,
    RestingAspectsClient,
    RestingAspectsError,
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
    # Turned about the vertical, and then tilted.
    turn = Rotation.from_euler('zx', [77, 20], degrees=True)
    first = find_aspects(part('l_bracket')).aspects[0]
    tilted = (turn * Rotation.from_quat(first.orientation)).as_quat()
    none = client.classify_pose('l_bracket', tilted)
    assert (none.status.code, none.aspect) == (Status.NOT_AVAILABLE, 0)
    assert 'the nearest is aspect 1 at 20 degrees, expected at most 3' in none.status.message
    assert none.angle == pytest.approx(math.radians(20), abs=1e-9)
    with pytest.raises(UnknownPartError, match='box_10x20x30, '):
        client.classify_pose('gizmo', tilted)
    assert client.get_part('l_bracket').part_sha256 == part('l_bracket').part_sha256


@pytest.mark.parametrize(
    ('ask', 'kind', 'expected'),
    [
        (lambda c: c.get_distribution('a\0b'), InvalidValueError, 'expected printable text'),
        (lambda c: c.get_distribution('x', timeout=0), InvalidValueError, 'invalid timeout 0: ex'),
        (lambda c: c.get_part('a/b'), UnknownPartError, "part 'a/b' is not known"),
    ],
)
def test_invalid_values_are_rejected_before_sending(unanswered_client, ask, kind, expected):
    """Without a suite, a request that was sent would fail later, with another error."""
    with pytest.raises(kind) as error:
        ask(unanswered_client)
    assert expected in str(error.value)


def test_statuses_become_exceptions_and_a_closed_client_refuses(client):
    with pytest.raises(InvalidValueError, match="invalid surface 'ice': expected"):
        client.get_distribution('tetrahedron', surface='ice')
    with pytest.raises(NotAvailableError, match='no known distribution'):
        client.get_distribution('tetrahedron', seed=987, only_known=True)
    client.close()
    with pytest.raises(ClientUseError, match='this client is closed'):
        client.list_parts()


# With a node that is spun


@pytest.fixture
def cell(suite, spinning):
    """A node that an executor spins in a thread."""
    context = rclpy.Context()
    context.init([])
    node = Node('cell', namespace=suite.namespace, context=context)
    executor = MultiThreadedExecutor(context=context)
    executor.add_node(node)
    over = threading.Event()

    def spin():
        while not over.is_set():
            executor.spin_once(timeout_sec=0.1)

    thread = threading.Thread(target=spin)
    thread.start()
    yield node
    over.set()
    thread.join()
    executor.shutdown()
    context.try_shutdown()


def test_async_callback_awaits_several_responses(cell, wait):
    """It runs in the default callback group of the node, which is blocked meanwhile."""
    client = RestingAspectsClient(cell)
    started, results = [], []

    async def work():
        timer.cancel()
        for ask in (
            lambda: client.get_distribution_async('tetrahedron', drops=600, seed=71),
            client.list_parts_async,
            lambda: client.get_distribution_async('gizmo'),
            lambda: client.get_distribution_async('tetrahedron', drops=2_000_000, seed=79),
        ):
            started.append(ask)
            try:
                results.append(await ask())
            except RestingAspectsError as error:
                results.append(error)

    timer = cell.create_timer(0.01, work)
    wait(lambda: len(started) == 4, 'answers')
    client.close()
    found, parts, refused, closed = wait(lambda: len(results) == 4 and results, 'error')
    assert (found.drops, len(parts)) == (600, 4)
    assert isinstance(refused, UnknownPartError)
    assert isinstance(closed, ClientUseError)


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
        assert re.search(r'waited 600 s: \d+ drops are done$', str(answer.exception()))

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
