"""Fixtures that run the command in an empty folder, in this process or in a new one."""

import contextlib
import csv
import io
import json
import os
import signal
import subprocess
import sys
import warnings
from pathlib import Path
from unittest import mock

import pytest

from resting_aspects_ros.cli import main
from resting_aspects_ros.system import SIGNALS

COMMAND = [sys.executable, '-m', 'resting_aspects_ros.cli']
# Variables of the environment that would change the output.
SETTINGS = ('PYTHONUNBUFFERED', 'NO_COLOR', 'FORCE_COLOR', 'COLUMNS', 'TTY_COMPATIBLE')
DEADLINE = 600.0


@pytest.fixture(scope='session')
def environment():
    kept = {name: value for name, value in os.environ.items() if name not in SETTINGS}
    return {**kept, 'TERM': 'xterm'}


@pytest.fixture(scope='session')
def run_in(environment):
    """Run the command in this process, in a folder; returns a CompletedProcess."""

    def run(folder, *words, env=None):
        words = [str(word) for word in words]
        out = io.TextIOWrapper(io.BytesIO(), encoding='utf-8')
        err = io.TextIOWrapper(io.BytesIO(), encoding='utf-8', errors='backslashreplace')
        with (
            pytest.MonkeyPatch.context() as patch,
            _handlers_restored(),
            warnings.catch_warnings(),
            mock.patch.dict(os.environ, env or environment, clear=True),
            contextlib.redirect_stdout(out),
            contextlib.redirect_stderr(err),
        ):
            patch.chdir(folder)
            # What Python ignores by default, and warnings of nodes of other tests.
            warnings.simplefilter('ignore', DeprecationWarning)
            warnings.filterwarnings('ignore', 'coroutine .* was never awaited', RuntimeWarning)
            try:
                code = main.main(words)
            except SystemExit as ended:  # by argparse
                code = ended.code
        for stream in (out, err):
            stream.flush()
        printed = [stream.buffer.getvalue().decode() for stream in (out, err)]
        return subprocess.CompletedProcess(words, code, *printed)

    return run


@contextlib.contextmanager
def _handlers_restored():
    """Restore signal handlers and the mask, which the command leaves blocked at its end."""
    before = {number: signal.getsignal(number) for number in SIGNALS}
    blocked = signal.pthread_sigmask(signal.SIG_BLOCK, ())
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        signal.pthread_sigmask(signal.SIG_SETMASK, blocked)
        signal.set_wakeup_fd(-1)


@pytest.fixture
def run(run_in, tmp_path):
    """Run the command in this process, in an empty folder."""
    return lambda *words, **options: run_in(tmp_path, *words, **options)


@pytest.fixture
def refused(run, tmp_path):
    """Run the command with wrong input; returns its one line of output."""

    def check(*words):
        before = sorted(tmp_path.rglob('*'))
        ended = run(*words)
        assert ended.returncode == 2, ended.stderr
        assert ended.stdout == ''
        (line,) = ended.stderr.splitlines()
        assert line.startswith('error: ')
        assert sorted(tmp_path.rglob('*')) == before
        return line

    return check


@pytest.fixture
def begin(environment, session, tmp_path):
    """Start the command in a new session, which is killed after the test."""
    started = []

    def start(*words, **options):
        options = {'stdout': subprocess.PIPE, 'stderr': subprocess.PIPE} | options
        process = subprocess.Popen(
            [*COMMAND, *(str(word) for word in words)],
            cwd=tmp_path,
            env=environment,
            text=True,
            start_new_session=True,
            **options,
        )
        started.append(process)
        return process

    yield start
    for process in started:
        for pid in session(process.pid):
            os.kill(pid, signal.SIGKILL)
        process.communicate()


@pytest.fixture(scope='session')
def session():
    """Return the command lines of the processes of a session, by pid."""
    return lambda leader: {pid: words for pid, of, words in _processes() if of == leader}


@pytest.fixture(scope='session')
def running():
    """Return the command lines of the processes that have an argument, by pid."""
    return lambda word: {pid: words for pid, _, words in _processes() if word in words}


def _processes():
    """Yield pid, session and command line of each process that has not ended."""
    for stat in Path('/proc').glob('[0-9]*/stat'):
        try:
            state, _, _, session = stat.read_text().rpartition(')')[2].split()[:4]
            words = (stat.parent / 'cmdline').read_text(errors='replace').split('\0')
        except (FileNotFoundError, ProcessLookupError):
            continue
        if state != 'Z':
            yield int(stat.parent.name), int(session), words


@pytest.fixture(scope='session')
def read_until():
    """Read lines until one matches; returns that line."""

    def read(file, wanted):
        for line in file:
            if wanted(line):
                return line
        raise AssertionError('it ended before')

    return read


@pytest.fixture
def saved(tmp_path):
    """Check the output of an interrupted command; returns its document and its lines."""

    def check(found, code):
        assert found.returncode == code, found.stderr
        assert 'Traceback' not in found.stderr
        document = json.loads(found.stdout)
        assert document['complete'] is False
        in_file = (tmp_path / 'o' / 'distribution.json').read_text(encoding='utf-8')
        assert in_file == found.stdout
        with (tmp_path / 'p.csv').open(newline='', encoding='utf-8') as file:
            rows = list(csv.reader(file))
        assert [row[0] for row in rows] == ['drop', *map(str, range(document['drops']))]
        outside = sum(document[name] for name in ('unclassified', 'unsettled', 'failed'))
        assert sum(a['count'] for a in document['aspects']) + outside == document['drops']
        return document, found.stderr.splitlines()

    return check


@pytest.fixture
def ended(session, wait, saved):
    """Wait for the end of a process; check its output with ``saved``, and its session."""

    def check(process, code):
        printed, errors = process.communicate(timeout=DEADLINE)
        wait(lambda: session(process.pid) == {}, 'the end of all processes')
        return saved(subprocess.CompletedProcess([], process.returncode, printed, errors), code)

    return check
