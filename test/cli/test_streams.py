"""Closed pipes, full disks, no memory: one line, no traceback."""

import json
import os
from pathlib import Path

import pytest

FULL = 'No space left on device'


@pytest.mark.slow
def test_closed_pipe_prints_no_error(begin):
    reader, writer = os.pipe()
    os.close(reader)
    process = begin('drop', 'tetrahedron', '--drops', 1, '--json', stdout=writer)
    os.close(writer)
    errors = process.communicate(timeout=600)[1]
    assert (process.returncode, 'Traceback' in errors, 'Broken' in errors) == (1, False, False)


@pytest.mark.slow
def test_full_disk_behind_stdout_prints_one_line(begin):
    with Path('/dev/full').open('w') as full:
        process = begin('aspects', 'tetrahedron', stdout=full)
        errors = process.communicate(timeout=600)[1]
    assert (process.returncode, errors) == (1, f'error: standard output: {FULL}\n')


@pytest.mark.slow
def test_full_disk_prints_one_line_and_keeps_the_result(run):
    ended = run('drop', 'tetrahedron', '--drops', 3, '--poses', '/dev/full', '--json')
    assert (ended.returncode, json.loads(ended.stdout)['drops']) == (1, 3)
    last = ended.stderr.splitlines()[-1]
    assert all(words in last for words in ("'/dev/full'", FULL, '3 of 3 drops'))


def test_refused_memory_is_reported_in_one_line(run, monkeypatch):
    def refuse(*_):
        raise MemoryError

    monkeypatch.setattr('resting_aspects_ros.cli.verbs.aspects.find_aspects', refuse)
    ended = run('aspects', 'tetrahedron')
    assert (ended.returncode, ended.stderr) == (1, 'error: there is not enough memory\n')


def test_invalid_ros_domain_is_refused(run, environment):
    ended = run('nodes', env={**environment, 'ROS_DOMAIN_ID': '\x1b[31m'})
    assert (ended.returncode, ended.stdout) == (2, '')
    (line,) = ended.stderr.splitlines()
    assert ('ROS_DOMAIN_ID' in line, line.isprintable()) == (True, True)


def test_names_with_control_characters_are_escaped_in_titles(run, tmp_path):
    odd = 'a\x1b[31m\x07b'
    (tmp_path / odd).write_text('qx,qy,qz,qw\n0,0,0,1\n0,0,0,1\n')
    shown = run('classify', odd).stdout
    assert r'\x1b[31m\x07' in shown
    assert '\x1b' not in shown
