"""`resting_aspects demo`: three processes, a result, and no process left at the end."""

import os
import re
import signal
import subprocess

import pytest
from rosbags.highlevel import AnyReader


def test_the_demo_drops_a_part_over_ros_and_shows_it(run, running, tmp_path):
    ended = run('demo', '--out', 'o')
    assert ended.returncode == 0, ended.stderr
    assert not running(f'__ns:=/demo_{os.getpid()}')
    lines = ended.stdout.splitlines()
    assert lines[1].strip() == 'l_bracket, 40 x 30 x 20 mm'
    assert lines[2].strip() == '1000 drops on rubber_mat, seed 1'
    log, report = (re.fullmatch(r'(\w+): +(.+)', line)[2] for line in lines[-2:])
    assert (tmp_path / report).read_text(encoding='utf-8').count('data-row=') == 5
    assert ended.stderr.splitlines()[-1].startswith('l_bracket: 1000 of 1000 drops')
    with AnyReader([(tmp_path / log).parent]) as reader:
        batches = [
            reader.deserialize(data, connection.msgtype)
            for connection, _, data in reader.messages()
            if connection.topic.endswith('/resting_poses')
        ]
    assert sum(len(batch.status) for batch in batches) == 1000


@pytest.mark.slow
def test_repeated_ctrl_c_before_nodes_run(begin, running, wait):
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
    wait(lambda: not running(f'__ns:=/demo_{process.pid}'), 'the end of the nodes')


@pytest.mark.slow
def test_a_node_that_dies_is_named_with_its_log(begin, running, read_until, session, wait):
    process = begin('demo', '--out', 'o')
    read_until(process.stderr, lambda line: re.match(r'l_bracket: [1-9]\d* of 1000', line))
    nodes = running(f'__ns:=/demo_{process.pid}')
    (simulator,) = (pid for pid, words in nodes.items() if 'drop_simulator' in ' '.join(words))
    os.kill(simulator, signal.SIGKILL)
    errors = process.communicate(timeout=600)[1]
    assert process.returncode == 1
    assert errors.splitlines()[-1] == (
        "error: drop_simulator ended with exit code -9: see 'o/drop_simulator.log'"
    )
    # No process of the demo is left: each of them leads a session.
    wait(lambda: not any(session(pid) for pid in (process.pid, *nodes)), 'the end of all')
