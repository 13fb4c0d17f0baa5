"""`resting_aspects demo`: three processes, a result, and no process left at the end."""

import os
import re
import signal
import subprocess

import pytest
from rosbags.highlevel import AnyReader

NODES = {'drop_simulator', 'aspect_classifier', 'drop_recorder'}
# Much longer than the demo needs, for a busy machine.
ENOUGH = 600.0  # s; it only finds hangs


@pytest.fixture
def nodes_of(running, wait_until):
    """Wait until the three nodes run; returns their pids by name."""

    def wait(demo):
        def named():
            of = {}
            for pid, words in running(f'__ns:=/demo_{demo}').items():
                for node in NODES & {w.removesuffix('.node').rpartition('.')[2] for w in words}:
                    of[node] = pid
            return of if of.keys() == NODES else None

        return wait_until(named)

    return wait


@pytest.fixture
def left(session, wait_until):
    """Check that no process of an ended demo is left: each leads a session."""

    def check(demo, nodes):
        for pid in (demo, *nodes.values()):
            wait_until(lambda pid=pid: not session(pid), 5)

    return check


def no_tracebacks(folder):
    logs = list(folder.glob('*.log'))
    for log in logs:
        text = log.read_text(encoding='utf-8')
        assert 'Traceback' not in text, text
        assert 'rror' not in text, text
    return {log.stem for log in logs}


def test_the_demo_drops_a_part_over_ros_and_shows_it(begin, nodes_of, left, tmp_path):
    process = begin('demo', '--out', 'o')
    nodes = nodes_of(process.pid)
    printed, errors = process.communicate(timeout=ENOUGH)
    assert process.returncode == 0, errors
    left(process.pid, nodes)
    lines = printed.splitlines()
    assert lines[1].strip() == 'l_bracket, 40 x 30 x 20 mm'
    assert lines[2].strip() == '1000 drops on rubber_mat, seed 1'
    aspects = [line.split()[0] for line in lines if re.match(r' +\d+ .* % ', line)]
    assert aspects == ['1', '2', '3', '4', '5']
    log, report = (re.fullmatch(r'(\w+): +(.+)', line)[2] for line in lines[-2:])
    page = (tmp_path / report).read_text(encoding='utf-8')
    assert page.count('data-row=') == 5
    assert errors.splitlines()[-1].startswith('l_bracket: 1000 of 1000 drops')
    assert no_tracebacks(tmp_path / 'o') == NODES
    with AnyReader([(tmp_path / log).parent]) as reader:
        batches = [
            reader.deserialize(data, connection.msgtype)
            for connection, _, data in reader.messages()
            if connection.topic.endswith('/resting_poses')
        ]
    assert sum(len(batch.status) for batch in batches) == 1000


@pytest.mark.slow
def test_repeated_ctrl_c_before_nodes_run(begin, running, wait_until):
    process = begin('demo')
    assert process.stdout.readline().startswith('Starting ')
    while process.poll() is None:
        os.killpg(process.pid, signal.SIGINT)
        try:
            process.wait(0.02)
        except subprocess.TimeoutExpired:
            continue
    assert process.communicate() == ('', 'interrupted\n')
    assert process.returncode == 130
    wait_until(lambda: not running(f'__ns:=/demo_{process.pid}'))


@pytest.mark.slow
def test_a_node_that_dies_is_named_with_its_log(begin, nodes_of, left, read_until, tmp_path):
    process = begin('demo', '--out', 'o')
    nodes = nodes_of(process.pid)
    read_until(process.stderr, lambda line: re.match(r'l_bracket: [1-9]\d* of 1000', line))
    os.kill(nodes['drop_simulator'], signal.SIGKILL)
    printed, errors = process.communicate(timeout=600)
    assert process.returncode == 1
    assert errors.splitlines()[-1] == (
        "error: drop_simulator ended by signal SIGKILL: see 'o/drop_simulator.log'"
    )
    assert len(printed.splitlines()) == 1
    assert (tmp_path / 'o' / 'drop_simulator.log').is_file()
    left(process.pid, nodes)
