"""Closed streams, full disks, little memory: one line, no traceback."""

import json
import os
import resource
import subprocess
from pathlib import Path

import pytest

CLOSED = 'error: standard output: Bad file descriptor\n'
FULL = 'No space left on device'


def closing(*numbers):
    return lambda: [os.close(number) for number in numbers]


@pytest.mark.slow
def test_files_are_written_when_standard_output_is_closed(run_process, tmp_path):
    words = ('drop', 'tetrahedron', '--drops', 20, '--out', 'o')
    ended = run_process(
        *words, capture_output=False, stderr=subprocess.PIPE, preexec_fn=closing(0, 1)
    )
    assert (ended.returncode, ended.stderr.endswith(CLOSED)) == (1, True)
    assert 'Traceback' not in ended.stderr
    assert (tmp_path / 'o' / 'distribution.json').read_text(encoding='utf-8').startswith('{')
    assert (tmp_path / 'o' / 'poses.csv').stat().st_size > 0


@pytest.mark.slow
def test_errors_do_not_go_to_stdout_when_stderr_is_closed(run_process):
    ended = run_process(
        'aspects', 'nope', capture_output=False, stdout=subprocess.PIPE, preexec_fn=closing(2)
    )
    assert (ended.returncode, ended.stdout) == (2, '')


@pytest.mark.slow
def test_closed_pipe_prints_no_error(begin):
    reader, writer = os.pipe()
    os.close(reader)
    process = begin('drop', 'tetrahedron', '--drops', 1, '--json', stdout=writer)
    os.close(writer)
    errors = process.communicate(timeout=600)[1]
    assert (process.returncode, 'Traceback' in errors, 'Broken' in errors) == (1, False, False)


@pytest.mark.slow
def test_full_disk_behind_stdout_prints_one_line(run_process):
    with Path('/dev/full').open('w') as full:
        ended = run_process(
            'aspects', 'tetrahedron', capture_output=False, stdout=full, stderr=subprocess.PIPE
        )
    assert (ended.returncode, ended.stderr) == (1, f'error: standard output: {FULL}\n')


@pytest.mark.slow
def test_full_disk_prints_one_line_and_keeps_the_result(run):
    ended = run('drop', 'tetrahedron', '--drops', 3, '--poses', '/dev/full', '--json')
    assert (ended.returncode, json.loads(ended.stdout)['drops']) == (1, 3)
    last = ended.stderr.splitlines()[-1]
    assert all(words in last for words in ("'/dev/full'", FULL, '3 of 3 drops'))


def test_little_memory_is_named(run_process):
    def limit():
        resource.setrlimit(resource.RLIMIT_AS, (200_000 << 10, 200_000 << 10))

    ended = run_process('drop', 'tetrahedron', '--drops', 5, preexec_fn=limit)
    assert (ended.returncode, ended.stdout) == (1, '')
    (line,) = ended.stderr.splitlines()
    assert '195 MiB' in line


@pytest.mark.parametrize(
    'error', [MemoryError(), OSError(12, ''), ImportError('x.so: failed to map segment')]
)
def test_refused_memory_is_reported_in_one_line(run, monkeypatch, error):
    def refuse(*_):
        try:
            raise error
        except type(error) as cause:
            raise ValueError('something else failed for it') from cause

    monkeypatch.setattr('resting_aspects_ros.cli.verbs.aspects.find_aspects', refuse)
    ended = run('aspects', 'tetrahedron')
    assert (ended.returncode, ended.stderr) == (1, 'error: there is not enough memory\n')


def test_invalid_ros_domain_is_refused(run, environment):
    ended = run('nodes', env={**environment, 'ROS_DOMAIN_ID': '\x1b[31m'})
    assert (ended.returncode, ended.stdout) == (2, '')
    (line,) = ended.stderr.splitlines()
    assert 'ROS_DOMAIN_ID' in line
    assert line.isprintable()


def test_names_with_control_characters_are_escaped_in_titles(run, tmp_path):
    odd = 'a\x1b[31m\x07b'
    (tmp_path / f'{odd}.csv').write_text('qx,qy,qz,qw\n0,0,0,1\n0,0,0,1\n')
    (tmp_path / f'{odd}.m').write_text('aspect,count\n1,5\n2,3\n')
    for words in (('classify', f'{odd}.csv'), ('compare', f'{odd}.m', f'{odd}.m')):
        ended = run(*words)
        assert ended.returncode == 0, ended.stderr
        assert r'\x1b[31m\x07' in ended.stdout
        assert '\x1b' not in ended.stdout + ended.stderr
