"""A file that hangs, needs too much memory or crashes its reader affects no other file."""

import operator
import os
import subprocess
import sys
from multiprocessing.context import SpawnProcess
from pathlib import Path
from unittest.mock import Mock

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from resting_aspects_ros.core.errors import UnknownPartError
from resting_aspects_ros.nodes.drop_simulator.part_publisher import load
from resting_aspects_ros.ros.file_worker import FileLimitError, FileWorker

MEGABYTE = 1024**2


@pytest.fixture(scope='module')
def node():
    context = rclpy.Context()
    context.init([])
    node = Node('reader', context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    yield node
    executor.shutdown()
    node.destroy_node()
    context.try_shutdown()


@pytest.fixture
def make_worker(node):
    workers = []

    def make_worker(**limits):
        workers.append(FileWorker(node, **limits))
        return workers[-1]

    yield make_worker
    for worker in workers:
        worker.stop()


@pytest.fixture
def run(node):
    """Run a function in a worker while the node is spun; return its result."""

    def run(worker, *given):
        task = node.executor.create_task(worker.run, *given)
        node.executor.spin_until_future_complete(task, 600)
        assert task.done()
        return task.result()

    return run


def test_results_and_errors_are_returned(make_worker, run, tmp_path):
    worker = make_worker()
    assert run(worker, operator.add, 2, 3) == 5
    with pytest.raises(UnknownPartError, match=r"^part 'gizmo' is not known"):
        run(worker, load, tmp_path, 'gizmo')
    with pytest.raises(FileLimitError, match=r'^unexpected error ValueError\(.*abc'):
        run(worker, int, 'abc')


def test_next_function_runs_after_a_timeout(make_worker, run, tmp_path):
    worker = make_worker(seconds=1.0)
    assert run(worker, operator.add, 2, 3) == 5
    os.mkfifo(tmp_path / 'pipe')
    (tmp_path / 'file').write_bytes(b'good')
    pid = worker._process.pid
    with pytest.raises(FileLimitError, match='the time limit of 1 s was exceeded'):
        run(worker, Path.read_bytes, tmp_path / 'pipe')
    assert not Path(f'/proc/{pid}').exists()
    assert run(worker, Path.read_bytes, tmp_path / 'file') == b'good'


def test_next_function_runs_after_a_memory_limit(make_worker, run):
    worker = make_worker(memory=64 * MEGABYTE)
    with pytest.raises(FileLimitError, match='the memory limit of 64 MiB was exceeded'):
        run(worker, bytearray, 128 * MEGABYTE)
    assert len(run(worker, bytearray, MEGABYTE)) == MEGABYTE


def test_next_function_runs_after_a_crash(make_worker, run):
    worker = make_worker()
    with pytest.raises(FileLimitError, match='the worker process died'):
        run(worker, os.abort)
    assert run(worker, operator.add, 2, 3) == 5


def test_process_killed_between_files_is_replaced(make_worker, run):
    worker = make_worker()
    assert run(worker, operator.add, 2, 3) == 5
    worker._process.kill()
    worker._process.join()
    assert run(worker, operator.add, 2, 3) == 5


def test_failed_start_of_the_process_is_retried(make_worker, run, monkeypatch):
    worker = make_worker()
    with monkeypatch.context() as patch:
        patch.setattr(SpawnProcess, 'start', Mock(side_effect=OSError))
        with pytest.raises(FileLimitError):
            run(worker, operator.add, 2, 3)
    assert run(worker, operator.add, 2, 3) == 5


def test_node_is_not_blocked_while_a_file_is_read(make_worker, node, tmp_path):
    worker, ticks, errors = make_worker(), [], []
    timer = node.create_timer(0.01, lambda: ticks.append(1))
    os.mkfifo(tmp_path / 'pipe')

    async def read():
        try:
            await worker.run(Path.read_bytes, tmp_path / 'pipe')
        except FileLimitError as error:
            errors.append(error)

    node.executor.create_task(read)
    while worker._connection is None:
        node.executor.spin_once(0.1)
    ticks.clear()
    while len(ticks) < 10:
        node.executor.spin_once(0.1)
    assert errors == []
    worker.stop()
    while not errors:
        node.executor.spin_once(0.1)
    node.destroy_timer(timer)


ORPHAN = """
import sys, rclpy, time
from pathlib import Path
from rclpy.executors import SingleThreadedExecutor
from resting_aspects_ros.ros.file_worker import FileWorker
sys.path.insert(0, sys.argv[1])
import hanging
rclpy.init()
node = rclpy.create_node('parent')
executor = SingleThreadedExecutor()
executor.add_node(node)
executor.create_task(FileWorker(node).run, hanging.hang, Path(sys.argv[2]))
executor.spin()
"""


def test_process_ends_when_the_node_is_killed(tmp_path, wait):
    hanging = 'import os, time\ndef hang(p):\n p.write_text(str(os.getpid()))\n time.sleep(3600)'
    (tmp_path / 'hanging.py').write_text(hanging)
    pid = tmp_path / 'pid'
    with subprocess.Popen([sys.executable, '-c', ORPHAN, tmp_path, pid]) as parent:
        wait(lambda: pid.exists() and pid.read_text(), 'hanging process')
        parent.kill()
    wait(lambda: not Path(f'/proc/{pid.read_text()}').exists(), 'its end')
