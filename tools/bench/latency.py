"""Latency of get_distribution for a known part, compared with plain services."""

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from rclpy.action import ActionClient
from rclpy.executors import SingleThreadedExecutor
from rclpy.serialization import serialize_message
from rclpy.task import Future
from resting_aspects_interfaces.action import DropPart
from resting_aspects_interfaces.msg import Status
from resting_aspects_interfaces.srv import GetDistribution
from rich.progress import track
from std_srvs.srv import Trigger
from validation.document import paragraphs, table

from bench.case import EXAMPLE

CALLS = 1000
DROPS = 1000
# More drops than the run can simulate during the measurement.
MANY_DROPS = 2_000_000
TIMEOUT = 60.0
# DDS can lose a call on a very busy machine; more lost calls than this indicate a defect.
MAX_LOST = 10
# Services that do nothing, and send a response from a file.
PLAIN = """
import sys
import rclpy
from rclpy.serialization import deserialize_message
from resting_aspects_interfaces.srv import GetDistribution
from std_srvs.srv import Trigger

rclpy.init()
with open(sys.argv[1], 'rb') as file:
    known = deserialize_message(file.read(), GetDistribution.Response)
node = rclpy.create_node('plain')
node.create_service(Trigger, 'trigger', lambda _, response: response)
node.create_service(GetDistribution, 'same', lambda *_: known)
try:
    rclpy.spin(node)
except rclpy.executors.ExternalShutdownException:
    pass
"""


def latency() -> Iterator[str]:
    """Measure median and 99th percentile of many calls, idle and during a run."""
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    ros = ['--ros-args', '-r', f'__ns:=/bench_{os.getpid()}']
    rows = []
    with ExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory())
        suite = ['-m', 'resting_aspects_ros.cli', 'nodes', *ros, '-p', f'log_folder:={folder}']
        stack.enter_context(_process(suite))
        rclpy.init(args=ros)
        stack.callback(rclpy.try_shutdown)
        client = _Client()
        stack.callback(client.destroy)
        known = Path(folder) / 'known'
        known.write_bytes(serialize_message(client.meet()))
        stack.enter_context(_process(['-c', PLAIN, str(known), *ros]))
        for load in ('idle', 'during a run'):
            if load != 'idle':
                client.begin_run()
            times = client.measure(load)
            found = {name: np.percentile(each, [50, 99]) for name, each in times.items()}
            for name, (median, p99) in found.items():
                ratios = found[name] / found['the same response']
                cells = [f'{median:.3f}', f'{ratios[0]:.2f}', f'{p99:.3f}', f'{ratios[1]:.2f}']
                rows.append([load, name, *cells])
    yield from paragraphs(
        '## Latency',
        f'{CALLS} calls of `get_distribution` for {DROPS} known drops of {EXAMPLE}, alternating '
        'with the same number of calls of a plain `std_srvs/Trigger` service and of a service '
        'that only sends the same response. One process calls services in two other processes. '
        'Ratios are relative to the service that only sends the response. *During a run*: while '
        'a run with another seed uses all cores. Aim: ratios of at most 1.5. '
        f'{client.lost} calls had no response within {TIMEOUT:g} s and were repeated.',
    )
    columns = ['', 'service', 'median (ms)', 'ratio', 'p99 (ms)', 'ratio']
    yield from table(columns, rows, numbers=True)


class _Client:
    """Client of the services."""

    def __init__(self) -> None:
        self.lost = 0  # calls without an answer
        self._node = rclpy.create_node('bench')
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._trigger = self._node.create_client(Trigger, 'trigger')
        self._ask = self._node.create_client(GetDistribution, 'get_distribution')
        self._same = self._node.create_client(GetDistribution, 'same')
        self._drop = ActionClient(self._node, DropPart, 'drop_part')

    def meet(self) -> GetDistribution.Response:
        """Wait for the services, and return a distribution when it is available."""
        for wait in (self._ask.wait_for_service, self._drop.wait_for_server):
            if not wait(timeout_sec=TIMEOUT):
                raise SystemExit(f'the suite did not respond within {TIMEOUT:g} s')
        while True:
            answer, _ = self._timed(self._ask, _request())
            if answer.status.code != Status.NOT_AVAILABLE:  # it is still reading logs and parts
                return answer
            time.sleep(0.1)

    def begin_run(self) -> None:
        """Start a run that uses all cores for the rest of the measurement."""
        goal = DropPart.Goal(part=EXAMPLE, drops=MANY_DROPS, seed=2)
        feedback: list[object] = []
        self._drop.send_goal_async(goal, feedback.append)

        def has_begun() -> bool:
            self._executor.spin_once(timeout_sec=0.1)
            return bool(feedback)

        self._until(has_begun)

    def measure(self, what: str) -> dict[str, list[float]]:
        """Return the times of the calls of each service, ms."""
        calls = {
            'Trigger': (self._trigger, Trigger.Request()),
            'the same response': (self._same, _request()),
            'get_distribution': (self._ask, _request()),
        }
        # Responses are lost until a service has discovered this client.
        for service, request in calls.values():
            self._until(partial(self._answers, service, request))
        times: dict[str, list[float]] = {name: [] for name in calls}
        for _ in track(range(CALLS), f'latency, {what}', transient=True):
            for name, (service, request) in calls.items():
                answer, time_taken = self._timed(service, request)
                if service is self._ask and answer.status.code != Status.OK:
                    raise SystemExit(f'get_distribution: {answer.status.message}')
                times[name].append(time_taken)
        return times

    def _timed(self, client: Any, request: Any) -> tuple[Any, float]:
        """Return the response and its latency, ms; repeats the call if there is none."""
        while True:
            started = time.perf_counter()
            answer = self._call(client, request)
            if answer is not None:
                return answer, 1e3 * (time.perf_counter() - started)
            self.lost += 1
            if self.lost > MAX_LOST:
                raise SystemExit(f'{self.lost} calls had no response within {TIMEOUT:g} s')

    def _call(self, client: Any, request: Any, timeout: float = TIMEOUT) -> Any:
        """Return the response, or None after the timeout, s."""
        answer: Future = client.call_async(request)
        end = time.monotonic() + timeout
        # spin_until_future_complete would leave tasks in the executor, more with each call.
        while not answer.done() and time.monotonic() < end:
            self._executor.spin_once(timeout_sec=timeout)
        if not answer.done():
            client.remove_pending_request(answer)
        return answer.result()

    def _answers(self, client: Any, request: Any) -> bool:
        return self._call(client, request, 1.0) is not None

    def _until(self, holds: Callable[[], bool]) -> None:
        end = time.monotonic() + TIMEOUT
        while not holds():
            if time.monotonic() > end:
                raise SystemExit(f'the suite did not respond within {TIMEOUT:g} s')

    def destroy(self) -> None:
        self._drop.destroy()
        self._executor.shutdown()
        self._node.destroy_node()


def _request() -> GetDistribution.Request:
    return GetDistribution.Request(part=EXAMPLE, drops=DROPS, seed=[1])


@contextmanager
def _process(words: list[str]) -> Iterator[None]:
    process = subprocess.Popen(
        [sys.executable, *words], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    try:
        yield
    finally:
        process.terminate()
        try:
            process.wait(TIMEOUT)
        except subprocess.TimeoutExpired:
            process.kill()  # rclpy.spin occasionally misses a SIGTERM
