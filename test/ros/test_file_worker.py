"""A file that hangs, needs too much memory or crashes its reader affects no other file."""

import importlib
import itertools
import operator
import os
import signal
import subprocess
import sys
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from ros_processes import FORKSERVER

from resting_aspects_ros.errors import UnknownPartError
from resting_aspects_ros.nodes.drop_simulator.node import load
from resting_aspects_ros.ros import file_worker
from resting_aspects_ros.ros.file_worker import FileLimitError, FileWorker

MEGABYTE = 1024**2

# That of the tests of nodes runs in a thread of this process.
CALL = FileWorker._call
ATTEMPTS = 2

FUNCTIONS = """
import os, signal

def note(pids):
    with open(pids, 'a') as file:
        print(os.getpid(), file=file)

def wait_if_first(pids):
    note(pids)
    if len(open(pids).readlines()) == 1:
        signal.pause()
    return 'answer'

def die(pids):
    note(pids)
    os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.fixture(autouse=True)
def own_process(monkeypatch):
    """Run functions in a process, which is forked from one that has imported the nodes."""
    monkeypatch.setattr(FileWorker, '_call', CALL)
    monkeypatch.setattr(file_worker, 'get_context', lambda _: FORKSERVER)
    monkeypatch.setattr(file_worker, 'ATTEMPTS', ATTEMPTS)
    monkeypatch.setattr(file_worker, 'MAX_WAIT', 1000)


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


@pytest.mark.slow
def test_results_and_errors_are_returned(make_worker, run, tmp_path, monkeypatch):
    monkeypatch.setattr(file_worker, 'get_context', get_context)
    worker = make_worker()
    assert run(worker, operator.add, 2, 3) == 5
    with pytest.raises(UnknownPartError, match=r"^part 'gizmo' is not known"):
        run(worker, load, tmp_path, 'gizmo')
    with pytest.raises(FileLimitError, match=r'^unexpected error ValueError\(.*abc'):
        run(worker, int, 'abc')
    # It was killed between two functions.
    worker._process.kill()
    worker._process.join()
    assert run(worker, operator.add, 2, 3) == 5


@pytest.fixture
def functions(tmp_path, monkeypatch):
    """A module with functions that the process of a worker can import."""
    (tmp_path / 'run_by_worker.py').write_text(FUNCTIONS, encoding='utf-8')
    monkeypatch.syspath_prepend(tmp_path)
    yield importlib.import_module('run_by_worker')
    del sys.modules['run_by_worker']


@pytest.mark.slow
def test_work_of_a_killed_process_is_repeated(make_worker, node, functions, tmp_path, wait):
    worker, pids = make_worker(), tmp_path / 'pids'
    task = node.executor.create_task(worker.run, functions.wait_if_first, pids)
    step = partial(node.executor.spin_once, 0.02)
    wait(lambda: pids.exists() and pids.read_text().endswith('\n'), 'the work', step=step)
    os.kill(int(pids.read_text()), signal.SIGKILL)
    node.executor.spin_until_future_complete(task, 600)
    assert task.result() == 'answer'
    assert len(set(pids.read_text().split())) == 2


@pytest.mark.slow
def test_function_that_kills_each_process_fails_alone(make_worker, node, run, functions, tmp_path):
    worker, pids = make_worker(), tmp_path / 'pids'
    other = node.executor.create_task(worker.run, operator.add, 2, 3)
    with pytest.raises(FileLimitError, match=f'died {ATTEMPTS} times'):
        run(worker, functions.die, pids)
    node.executor.spin_until_future_complete(other, 600)
    assert other.result() == 5
    assert len(set(pids.read_text().split())) == ATTEMPTS


@pytest.mark.slow
def test_next_function_runs_after_one_that_hangs(make_worker, run, tmp_path, monkeypatch):
    monkeypatch.setattr(file_worker, 'MAX_WAIT', 1)
    worker = make_worker(seconds=0.5)
    assert run(worker, operator.add, 2, 3) == 5
    os.mkfifo(tmp_path / 'pipe')
    (tmp_path / 'file').write_bytes(b'good')
    pid = worker._process.pid
    with pytest.raises(FileLimitError, match=f'hung {ATTEMPTS} times'):
        run(worker, Path.read_bytes, tmp_path / 'pipe')
    assert not Path(f'/proc/{pid}').exists()
    assert run(worker, Path.read_bytes, tmp_path / 'file') == b'good'


def test_next_function_runs_after_a_limit(make_worker, run):
    worker = make_worker(memory=64 * MEGABYTE, seconds=0.5)
    with pytest.raises(FileLimitError, match='the memory limit of 64 MiB was exceeded'):
        run(worker, bytearray, 128 * MEGABYTE)
    assert len(run(worker, bytearray, MEGABYTE)) == MEGABYTE
    with pytest.raises(FileLimitError, match=r'0\.5 s of processor time'):
        run(worker, sum, itertools.repeat(0))
    assert run(worker, operator.add, 2, 3) == 5


ORPHAN = """
import sys, rclpy
from rclpy.executors import SingleThreadedExecutor
from resting_aspects_ros.ros.file_worker import FileWorker
sys.path.insert(0, sys.argv[1])
from run_by_worker import wait_if_first
rclpy.init()
node = rclpy.create_node('parent')
executor = SingleThreadedExecutor()
executor.add_node(node)
executor.create_task(FileWorker(node).run, wait_if_first, sys.argv[2])
executor.spin()
"""


@pytest.mark.slow
def test_process_ends_when_the_node_is_killed(functions, tmp_path, wait):
    pid = tmp_path / 'pid'
    with subprocess.Popen([sys.executable, '-c', ORPHAN, tmp_path, pid]) as parent:
        wait(lambda: pid.exists() and pid.read_text().endswith('\n'), 'hanging process')
        parent.kill()
    wait(lambda: not Path(f'/proc/{pid.read_text().strip()}').exists(), 'its end')
