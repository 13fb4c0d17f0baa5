"""How long get_distribution of a known part takes, beside a service that does nothing."""

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from bench_case import EXAMPLE
from bench_report import Section, Table
from rclpy.action import ActionClient
from rclpy.executors import SingleThreadedExecutor
from rclpy.serialization import serialize_message
from rclpy.task import Future
from resting_aspects_interfaces.action import DropPart
from resting_aspects_interfaces.msg import Status
from resting_aspects_interfaces.srv import GetDistribution
from rich.progress import track
from std_srvs.srv import Trigger

CALLS = 1000
DROPS = 1000
# More than are made while it is measured.
MANY_DROPS = 2_000_000
DEADLINE = 60.0
# DDS can lose a call on a machine that is very busy; more than this are no accident.
MAX_LOST = 10
# A service that does nothing.
TRIGGER = """
import rclpy
from std_srvs.srv import Trigger

rclpy.init()
node = rclpy.create_node('nothing')
node.create_service(Trigger, 'trigger', lambda _, response: response)
try:
    rclpy.spin(node)
except rclpy.executors.ExternalShutdownException:
    pass
"""
# A service that has the whole answer at hand.
READY = """
import sys
from pathlib import Path
import rclpy
from rclpy.serialization import deserialize_message
from resting_aspects_interfaces.srv import GetDistribution

rclpy.init()
answer = deserialize_message(Path(sys.argv[1]).read_bytes(), GetDistribution.Response)
node = rclpy.create_node('ready')
node.create_service(GetDistribution, 'ready', lambda _, response: answer)
try:
    rclpy.spin(node)
except rclpy.executors.ExternalShutdownException:
    pass
"""


def latency() -> Section:
    """Median and 99th percentile of many calls, idle and while a run goes on."""
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    ros = ['--ros-args', '-r', f'__ns:=/bench_{os.getpid()}']
    table = Table(['', 'service', 'median (ms)', 'ratio', 'p99 (ms)', 'ratio'])
    found: dict[str, float] = {}
    with ExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory())
        suite = ['-m', 'resting_aspects_ros.cli', 'nodes', *ros, '-p', f'log_folder:={folder}']
        stack.enter_context(_process(suite))
        stack.enter_context(_process(['-c', TRIGGER, *ros]))
        client = stack.enter_context(_client(ros))
        ready = Path(folder) / 'answer'
        ready.write_bytes(serialize_message(client.meet()))
        stack.enter_context(_process(['-c', READY, str(ready), *ros]))
        client.meet_ready()
        for load, begin in (('idle', lambda: None), ('during_a_run', client.begin_run)):
            begin()
            times = client.measure(load.replace('_', ' '))
            base = np.percentile(times['Trigger'], [50, 99])
            for name, each in times.items():
                median, p99 = np.percentile(each, [50, 99])
                ratios = median / base[0], p99 / base[1]
                cells = [f'{median:.3f}', f'{ratios[0]:.2f}', f'{p99:.3f}', f'{ratios[1]:.2f}']
                table.rows.append([load.replace('_', ' '), name, *cells])
            found |= {
                f'{load}_median_ms': float(median),
                f'{load}_median_ratio': float(ratios[0]),
                f'{load}_p99_ms': float(p99),
                f'{load}_p99_ratio': float(ratios[1]),
            }
    note = (
        f'{CALLS} calls of `get_distribution` for {EXAMPLE}, of which {DROPS} drops are known, '
        'and as many of a bare `std_srvs/Trigger` and of a service that sends the same answer '
        'and does nothing else, in turn, from one process to three others; ratios are to the '
        'Trigger. *During a run*: of another seed, on all cores. Aim: ratios of at most 1.5.'
    )
    if client.lost:
        note += f' {client.lost} calls had no answer in {DEADLINE:g} s and were repeated.'
    return Section('Latency', note, [table], {'latency': found})


class _Client:
    """Calls both services."""

    def __init__(self) -> None:
        self.lost = 0  # calls without an answer
        self._node = rclpy.create_node('bench')
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._trigger = self._node.create_client(Trigger, 'trigger')
        self._ask = self._node.create_client(GetDistribution, 'get_distribution')
        self._ready = self._node.create_client(GetDistribution, 'ready')
        self._drop = ActionClient(self._node, DropPart, 'drop_part')

    def meet(self) -> GetDistribution.Response:
        """Wait for everybody, and have the part dropped."""
        waits = (
            self._trigger.wait_for_service,
            self._ask.wait_for_service,
            self._drop.wait_for_server,
        )
        for wait in waits:
            if not wait(timeout_sec=DEADLINE):
                raise SystemExit(f'the suite did not answer in {DEADLINE:g} s')
        # Before both have found this client their answers are lost.
        self._until(lambda: self._call(self._trigger, Trigger.Request()) is not None)
        while True:
            answer, _ = self._timed(self._ask, _request())
            if answer.status.code != Status.NOT_AVAILABLE:  # else it still reads logs and parts
                return answer
            time.sleep(0.1)

    def meet_ready(self) -> None:
        """Wait for the service that has the answer at hand."""
        self._until(lambda: self._ready.wait_for_service(timeout_sec=DEADLINE))
        self._until(lambda: self._call(self._ready, _request()) is not None)

    def begin_run(self) -> None:
        """Have all cores drop, until the end."""
        goal = DropPart.Goal(part=EXAMPLE, drops=MANY_DROPS, seed=2)
        begun: list[object] = []
        self._drop.send_goal_async(goal, begun.append)  # the first feedback

        def has_begun() -> bool:
            self._executor.spin_once(timeout_sec=0.1)
            return bool(begun)

        self._until(has_begun)

    def measure(self, what: str) -> dict[str, list[float]]:
        """The times of the calls of each, ms."""
        calls = {
            'Trigger': (self._trigger, Trigger.Request()),
            'the same answer': (self._ready, _request()),
            'get_distribution': (self._ask, _request()),
        }
        times: dict[str, list[float]] = {name: [] for name in calls}
        for _ in track(range(CALLS), f'latency, {what}', transient=True):
            for name, (service, request) in calls.items():
                answer, time_taken = self._timed(service, request)
                if service is self._ask and answer.status.code != Status.OK:
                    raise SystemExit(f'get_distribution: {answer.status.message}')
                times[name].append(time_taken)
        return times

    def _timed(self, client: Any, request: Any) -> tuple[Any, float]:
        """The response and how long it took, ms; asked again if there is none."""
        while True:
            begun = time.perf_counter()
            answer = self._call(client, request)
            if answer is not None:
                return answer, 1e3 * (time.perf_counter() - begun)
            self._count_lost()

    def _count_lost(self) -> None:
        self.lost += 1
        if self.lost > MAX_LOST:
            raise SystemExit(f'{self.lost} calls had no answer in {DEADLINE:g} s')

    def _call(self, client: Any, request: Any) -> Any:
        """The response, or None if there is none in time."""
        answer: Future = client.call_async(request)
        end = time.monotonic() + DEADLINE
        # spin_until_future_complete leaves tasks behind, more with each call.
        while not answer.done() and time.monotonic() < end:
            self._executor.spin_once(timeout_sec=DEADLINE)
        if not answer.done():
            client.remove_pending_request(answer)
        return answer.result()

    def _until(self, holds: Callable[[], bool]) -> None:
        end = time.monotonic() + DEADLINE
        while not holds():
            if time.monotonic() > end:
                raise SystemExit(f'the suite did not answer in {DEADLINE:g} s')

    def destroy(self) -> None:
        self._drop.destroy()
        self._executor.shutdown()
        self._node.destroy_node()


def _request() -> GetDistribution.Request:
    return GetDistribution.Request(part=EXAMPLE, drops=DROPS, seed=[1])


@contextmanager
def _client(ros: list[str]) -> Iterator[_Client]:
    rclpy.init(args=ros)
    client = _Client()
    try:
        yield client
    finally:
        client.destroy()
        rclpy.try_shutdown()


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
            process.wait(DEADLINE)
        except subprocess.TimeoutExpired:
            process.kill()  # rclpy.spin misses a SIGTERM now and then
