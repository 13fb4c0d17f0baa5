"""A file that hangs, needs too much memory or crashes its reader affects no other file.

The functions run without a node, which only waits for them.
"""

import importlib
import itertools
import operator
import os
import signal
import subprocess
import sys
from multiprocessing import get_context
from pathlib import Path

import pytest

from resting_aspects_ros.errors import UnknownPartError
from resting_aspects_ros.nodes.drop_simulator.node import load
from resting_aspects_ros.ros import file_worker
from resting_aspects_ros.ros.file_worker import FileLimitError, FileWorker

MEGABYTE = 1024**2

# That of the tests of nodes runs in a thread of this process.
CALL = FileWorker._call
# It has imported what the functions need, which takes a second for each process.
FORKSERVER = get_context('forkserver')
FORKSERVER.set_forkserver_preload([file_worker.__name__])
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


@pytest.fixture
def make_worker():
    workers = []

    def make_worker(**limits):
        workers.append(FileWorker(None, **limits))
        return workers[-1]

    yield make_worker
    for worker in workers:
        worker.stop()


def begin(worker, function, *arguments):
    """Run a function in the process of a worker, without a node; return a future."""
    return worker._thread.submit(worker._call, function, arguments)


def run(*given):
    return begin(*given).result(600)


@pytest.mark.slow
def test_results_and_errors_are_returned(make_worker, tmp_path, monkeypatch):
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
def test_work_of_a_killed_process_is_repeated(make_worker, functions, tmp_path, wait):
    worker, pids = make_worker(), tmp_path / 'pids'
    work = begin(worker, functions.wait_if_first, pids)
    wait(lambda: pids.exists() and pids.read_text().endswith('\n'), 'the work')
    os.kill(int(pids.read_text()), signal.SIGKILL)
    assert work.result(600) == 'answer'
    assert len(set(pids.read_text().split())) == 2


@pytest.mark.slow
def test_function_that_kills_each_process_fails_alone(make_worker, functions, tmp_path):
    worker, pids = make_worker(), tmp_path / 'pids'
    work, other = begin(worker, functions.die, pids), begin(worker, operator.add, 2, 3)
    with pytest.raises(FileLimitError, match=f'died {ATTEMPTS} times'):
        work.result(600)
    assert other.result(600) == 5
    assert len(set(pids.read_text().split())) == ATTEMPTS


@pytest.mark.slow
def test_next_function_runs_after_one_that_hangs(make_worker, tmp_path, monkeypatch):
    monkeypatch.setattr(file_worker, 'MAX_WAIT', 1)
    worker = make_worker(seconds=0.5)
    assert run(worker, operator.add, 2, 3) == 5
    os.mkfifo(tmp_path / 'pipe')
    pid = worker._process.pid
    with pytest.raises(FileLimitError, match=f'hung {ATTEMPTS} times'):
        run(worker, Path.read_bytes, tmp_path / 'pipe')
    assert not Path(f'/proc/{pid}').exists()
    assert run(worker, operator.add, 2, 3) == 5


def test_next_function_runs_after_a_limit(make_worker):
    worker = make_worker(memory=64 * MEGABYTE, seconds=0.5)
    with pytest.raises(FileLimitError, match='the memory limit of 64 MiB was exceeded'):
        run(worker, bytearray, 128 * MEGABYTE)
    assert len(run(worker, bytearray, MEGABYTE)) == MEGABYTE
    with pytest.raises(FileLimitError, match=r'0\.5 s of processor time'):
        run(worker, sum, itertools.repeat(0))
    assert run(worker, operator.add, 2, 3) == 5


ORPHAN = """
import sys
from resting_aspects_ros.ros.file_worker import FileWorker
sys.path.insert(0, sys.argv[1])
from run_by_worker import wait_if_first
FileWorker(None)._call(wait_if_first, (sys.argv[2],))
"""


@pytest.mark.slow
def test_process_ends_when_the_node_is_killed(functions, tmp_path, wait):
    pid = tmp_path / 'pid'
    with subprocess.Popen([sys.executable, '-c', ORPHAN, tmp_path, pid]) as parent:
        wait(lambda: pid.exists() and pid.read_text().endswith('\n'), 'hanging process')
        parent.kill()
    wait(lambda: not Path(f'/proc/{pid.read_text().strip()}').exists(), 'its end')
