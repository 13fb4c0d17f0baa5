"""`resting_aspects demo`: three processes, a result, and no process left at the end."""

import os
import re
import signal
import subprocess
from pathlib import Path

import pytest
from PIL import Image
from rosbags.highlevel import AnyReader

NODES = {'drop_simulator', 'aspect_classifier', 'drop_recorder'}
# Much longer than the demo needs, for a busy machine.
ENOUGH = 600.0  # s; it only finds hangs


@pytest.fixture(scope='module')
def processes_of():
    """Return the processes of a demo: nodes in its namespace, and their workers."""

    def find(demo):
        of = {}
        for status in Path('/proc').glob('[0-9]*/status'):
            try:
                parent = int(re.search(r'^PPid:\t(\d+)', status.read_text(), re.MULTILINE)[1])
                words = (
                    (status.parent / 'cmdline').read_bytes().decode(errors='replace').split('\0')
                )
            except (FileNotFoundError, ProcessLookupError):
                continue
            of[int(status.parent.name)] = (parent, words)
        found = {pid for pid, (_, words) in of.items() if f'__ns:=/demo_{demo}' in words}
        found |= {pid for pid, (parent, words) in of.items() if parent in found and any(words)}
        return {pid: of[pid][1] for pid in found}

    return find


@pytest.fixture
def nodes_of(processes_of, wait_until):
    """Wait until the three nodes run; returns their pids by name."""

    def wait(demo):
        def named():
            of = {}
            for pid, words in processes_of(demo).items():
                for node in NODES & {
                    word.removesuffix('.node').rpartition('.')[2] for word in words
                }:
                    of[node] = pid
            return of if of.keys() == NODES else None

        return wait_until(named)

    return wait


@pytest.fixture
def left(processes_of, session, wait_until):
    """Check that no process of an ended demo is left."""

    def check(demo, nodes):
        wait_until(lambda: not processes_of(demo), 5)
        for pid in (demo, *nodes.values()):  # each leads a session
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
    assert len(set(nodes.values())) == 3
    printed, errors = process.communicate(timeout=ENOUGH)
    assert process.returncode == 0, errors
    left(process.pid, nodes)

    first, title, words, *lines = printed.splitlines()
    assert re.fullmatch(r'Starting \w+, \w+, \w+ as three processes \.\.\.', first)
    assert all(node in first for node in NODES)
    assert [title.rstrip(), words.rstrip()] == [
        'l_bracket, 40 x 30 x 20 mm',
        '1000 drops on rubber_mat, seed 1',
    ]
    aspects = [line.split()[0] for line in lines if re.match(r' +\d+ .* % ', line)]
    assert aspects == ['1', '2', '3', '4', '5']
    log, report = (re.fullmatch(r'(\w+): +(.+)', line) for line in lines[-2:])
    assert (log[1], report[1]) == ('Log', 'Report')
    page = (tmp_path / report[2]).read_text(encoding='utf-8')
    assert page.count('data-row=') == 5
    with Image.open(tmp_path / 'o' / 'distribution.png') as image:
        image.load()
    for line in errors.splitlines():
        waits = line.startswith('[WARN]') and 'yet, waiting up to' in line  # on a busy machine
        assert waits or re.fullmatch(r'l_bracket: \d+ of 1000 drops(  [\d.]+ drops/s)?', line)
    assert errors.splitlines()[-1].startswith('l_bracket: 1000 of 1000 drops')
    assert no_tracebacks(tmp_path / 'o') == NODES

    log_file = tmp_path / log[2]
    assert log_file.suffix == '.mcap'
    with AnyReader([log_file.parent]) as reader:
        batches = [
            reader.deserialize(data, connection.msgtype)
            for connection, _, data in reader.messages()
            if connection.topic.endswith('/resting_poses')
        ]
    assert sum(len(batch.status) for batch in batches) == 1000


@pytest.mark.slow
def test_ctrl_c_in_the_middle(begin, nodes_of, left, read_until, tmp_path):
    process = begin('demo', '--out', 'o')
    nodes = nodes_of(process.pid)
    read_until(process.stderr, lambda line: re.match(r'l_bracket: [1-9]\d* of 1000', line))
    os.killpg(process.pid, signal.SIGINT)
    _, errors = process.communicate(timeout=600)
    assert process.returncode == 130, errors
    assert errors.splitlines()[-1] == 'interrupted'
    left(process.pid, nodes)
    assert no_tracebacks(tmp_path / 'o') == NODES


@pytest.mark.slow
def test_ctrl_c_as_it_starts(begin, nodes_of, left, tmp_path):
    process = begin('demo', '--out', 'o')
    assert process.stdout.readline().startswith('Starting ')
    nodes = nodes_of(process.pid)
    os.killpg(process.pid, signal.SIGINT)
    _, errors = process.communicate(timeout=600)
    assert process.returncode == 130
    assert errors == 'interrupted\n'
    left(process.pid, nodes)
    assert no_tracebacks(tmp_path / 'o') == NODES


@pytest.mark.slow
def test_repeated_ctrl_c_before_nodes_run(begin, processes_of, left):
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
    left(process.pid, {})


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


@pytest.mark.parametrize('out', ['file', 'file/below'])
def test_folder_that_cannot_be_created_is_refused(run, tmp_path, out):
    (tmp_path / 'file').write_text('', encoding='utf-8')
    ended = run('demo', '--out', out)
    assert (ended.returncode, ended.stdout) == (2, '')
    (line,) = ended.stderr.splitlines()
    assert line.startswith(f"error: invalid --out '{out}': expected a folder")
