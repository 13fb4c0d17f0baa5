"""Closed streams, little memory, a deleted working folder, signals: one line, no traceback."""

import os
import resource
import signal
import subprocess
import sys

import pytest

LINE = 'error: standard output: Bad file descriptor\n'


def closing(*numbers):
    return lambda: [os.close(number) for number in numbers]


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize(
    'words', [['aspects', 'tetrahedron'], ['aspects', 'tetrahedron', '--json'], ['--help']]
)
def test_a_closed_standard_output_is_an_error_in_one_line(run_process, words):
    ended = run_process(
        *words, capture_output=False, stderr=subprocess.PIPE, preexec_fn=closing(1)
    )
    assert (ended.returncode, ended.stderr) == (1, LINE)


def test_files_are_written_when_standard_output_is_closed(run_process, tmp_path):
    words = ('drop', 'tetrahedron', '--drops', 20, '--out', 'o')
    ended = run_process(
        *words, capture_output=False, stderr=subprocess.PIPE, preexec_fn=closing(0, 1)
    )
    assert (ended.returncode, ended.stderr.endswith(LINE)) == (1, True)
    assert 'Traceback' not in ended.stderr
    assert (tmp_path / 'o' / 'distribution.json').read_text(encoding='utf-8').startswith('{')
    assert (tmp_path / 'o' / 'poses.csv').stat().st_size > 0


def test_errors_do_not_go_to_stdout_when_stderr_is_closed(run_process):
    ended = run_process(
        'aspects', 'nope', capture_output=False, stdout=subprocess.PIPE, preexec_fn=closing(2)
    )
    assert (ended.returncode, ended.stdout) == (2, '')


def test_little_memory_is_named(run_process):
    def limit():
        resource.setrlimit(resource.RLIMIT_AS, (200_000 << 10, 200_000 << 10))

    for words in (('aspects', 'tetrahedron'), ('drop', 'tetrahedron', '--drops', 5)):
        ended = run_process(*words, preexec_fn=limit)
        assert (ended.returncode, ended.stdout) == (1, '')
        assert ended.stderr == (
            'error: memory is limited to 195 MiB (ulimit -v): expected at least 512 MiB\n'
        )


@pytest.mark.parametrize(
    'error',
    [
        MemoryError(),
        OSError(12, 'Cannot allocate memory'),
        RuntimeError("can't start new thread"),
        ImportError('libx.so: failed to map segment from shared object'),
    ],
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


def test_a_deleted_working_folder(environment, tmp_path):
    def here(*words):
        folder = tmp_path / 'gone'
        folder.mkdir()
        code = f'import os; os.rmdir({str(folder)!r}); from resting_aspects_ros.cli import main; '
        call = f'raise SystemExit(main.main({list(words)!r}))'
        return subprocess.run(
            [sys.executable, '-P', '-c', code + call] if sys.version_info >= (3, 11)
            else [sys.executable, '-c', code + call],
            cwd=folder, env=environment, capture_output=True, text=True, check=False,
        )  # fmt: skip

    found = here('aspects', 'tetrahedron')
    assert (found.returncode, found.stderr) == (0, '')
    for words in (('drop', 'tetrahedron', '--drops', '5', '--out', 'o'), ('demo',)):
        ended = here(*words)
        assert ended.returncode in (1, 2)
        (line,) = ended.stderr.splitlines()
        assert 'standard output' not in line
        assert 'folder' in line


def test_sighup_ends_a_command_as_ctrl_c_does(begin, read_until):
    process = begin('drop', 'tetrahedron', '--drops', 2_000_000, '--workers', 1)
    read_until(process.stderr, lambda line: True)
    process.send_signal(signal.SIGHUP)
    _, errors = process.communicate(timeout=600)
    assert process.returncode == 130
    assert 'Traceback' not in errors


@pytest.mark.parametrize(
    'domain', ['999999', '233', '-1', 'abc', '9' * 5000, '0' * 20 + '999', '\x1b[31m']
)
def test_invalid_ros_domain_is_refused(run, environment, domain):
    for words in (['nodes'], ['request', 'tetrahedron']):
        ended = run(*words, env={**environment, 'ROS_DOMAIN_ID': domain})
        assert (ended.returncode, ended.stdout) == (2, '')
        (line,) = ended.stderr.splitlines()
        assert line.startswith('error: invalid ROS_DOMAIN_ID ')
        assert line.endswith(': expected an integer from 0 to 232')
        assert line.isprintable()
        assert len(line) < 200


LONG = 'x' * 1_000_000
ODD = 'a\x1b[31m\x07b'


@pytest.mark.parametrize('value', [LONG, ODD, 'a b ' * 200_000], ids=['long', 'odd', 'words'])
@pytest.mark.parametrize(
    'words',
    [
        ['{}'],
        ['aspects', '{}'],
        ['aspects', 'tetrahedron', '--unit', '{}'],
        ['aspects', 'tetrahedron', '--{}'],
        ['aspects', 'tetrahedron', '{}'],
        ['aspects', 'tetrahedron', '--parts', '{}'],
        ['drop', 'tetrahedron', '--drops', '{}'],
        ['drop', 'tetrahedron', '--seed', '{}'],
        ['drop', 'tetrahedron', '--friction', '{}'],
        ['drop', 'tetrahedron', '--surface', '{}'],
        ['drop', 'tetrahedron', '--height-of', '{}'],
        ['drop', 'tetrahedron', '--confidence', '{}'],
        ['drop', 'tetrahedron', '--interval', '{}'],
        ['classify', '{}'],
        ['classify', 'p.csv', '--unit', '{}'],
        ['compare', '{}', '{}'],
        ['report', '{}'],
        ['estimate', 'tetrahedron', '--method', '{}'],
        ['request', 'tetrahedron', '--precision', '{}'],
        ['request', 'tetrahedron', '--method', 'rolling', '--surface', '{}'],
    ],
    ids=lambda words: '_'.join(words).replace('{}', ''),
)
def test_errors_are_short_and_printable_for_any_input(run, value, words):
    ended = run(*(word.format(value) for word in words))
    assert ended.returncode in (1, 2)
    (line,) = ended.stderr.splitlines()
    assert line.startswith('error: ')
    assert line.isprintable()
    assert len(line) <= 2100


def test_names_with_control_characters_are_escaped_in_titles(run, tmp_path):
    (tmp_path / f'{ODD}.csv').write_text('qx,qy,qz,qw\n0,0,0,1\n0,0,0,1\n')
    (tmp_path / f'{ODD}.m').write_text('aspect,count\n1,5\n2,3\n')
    for words in (('classify', f'{ODD}.csv'), ('compare', f'{ODD}.m', f'{ODD}.m')):
        ended = run(*words)
        assert ended.returncode == 0, ended.stderr
        assert r'\x1b[31m\x07' in ended.stdout
        assert '\x1b' not in ended.stdout + ended.stderr
