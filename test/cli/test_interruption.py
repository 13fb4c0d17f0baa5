"""Ctrl-C, and workers that die: partial results are saved, and no process is left.

Signals come in this process, at a known place, but for one test of each kind with real processes.
"""

import os
import re
import signal
import time

import pytest

from resting_aspects_ros.api.runner import DropProgress
from resting_aspects_ros.errors import EngineError
from resting_aspects_ros.report.page import Page

QUICK = ('drop', 'tetrahedron', '--drops', 2_000_000, '--workers', 2)
BULLET = ('--engine', 'bullet')  # with worker processes
OUTPUTS = ('--json', '--poses', 'p.csv', '--out', 'o')


def some_done(line):
    return re.match(r'\w+: [1-9]\d* of \d+ drops  [\d.]+ drops/s$', line)


@pytest.fixture
def at_update(monkeypatch):
    """Call a function at each progress update, with the number of drops made."""

    def at_update(call):
        update = DropProgress.update
        monkeypatch.setattr(
            DropProgress, 'update', lambda shown, done: [update(shown, done), call(done)]
        )

    return at_update


@pytest.mark.slow
def test_repeated_ctrl_c_ends_a_process_and_its_workers(begin, ended, read_until):
    process = begin(*QUICK, *BULLET, *OUTPUTS)
    read_until(process.stderr, some_done)
    while process.poll() is None:
        os.killpg(process.pid, signal.SIGINT)  # all processes, like a terminal
        time.sleep(0.02)
    document, lines = ended(process, 130)
    assert document['drops'] > 0
    assert lines[-1] == f'interrupted; the result has {document["drops"]} of 2000000 drops'


@pytest.mark.slow
def test_termination_keeps_the_drops_and_their_contacts(run, saved, at_update):
    at_update(lambda done: done and signal.raise_signal(signal.SIGTERM))
    document, _ = saved(run(*QUICK, '--surroundings', 'l_chute', *OUTPUTS), 130)
    at_rest = sum(a['count'] for a in document['aspects']) + document['unclassified']
    assert at_rest > 0
    assert sum(row['count'] for row in document['contacts']) == at_rest


@pytest.mark.slow
def test_ctrl_c_ends_the_page_when_the_rest_is_saved(run, monkeypatch, tmp_path):
    draw = Page.files

    def interrupted(page):
        signal.raise_signal(signal.SIGINT)
        yield from draw(page)

    monkeypatch.setattr(Page, 'files', interrupted)
    words = ('drop', 'l_bracket', '--drops', 20, '--surroundings', 'l_chute')
    found = run(*words, '--report', '--out', 'o', '--table', 't.csv')
    assert (found.returncode, found.stderr.splitlines()[-1]) == (130, 'interrupted')
    assert (tmp_path / 't_2.csv').exists()  # of the contacts
    assert found.stdout.splitlines()[-1].startswith('Written: ')
    assert {file.name for file in (tmp_path / 'o').iterdir()} == {'distribution.json', 'poses.csv'}


def test_a_run_without_a_drop_keeps_earlier_files(run, at_update, monkeypatch, tmp_path):
    def files():
        return {path: path.read_bytes() for path in tmp_path.rglob('*') if path.is_file()}

    def fail(*_):
        raise EngineError('no device')

    assert run('drop', 'tetrahedron', '--drops', 5, *OUTPUTS).returncode == 0
    before = files()
    # The first chunk of Bullet takes longer than the time between two updates.
    at_update(lambda done: signal.raise_signal(signal.SIGINT))
    found = run(*QUICK, *BULLET, *OUTPUTS)
    assert (found.returncode, found.stdout) == (130, '')
    assert found.stderr.splitlines()[-1] == 'interrupted before the first drop'
    assert files() == before
    monkeypatch.setattr('resting_aspects_ros.api.runner.drop_chunks', fail)
    found = run('drop', 'tetrahedron', '--drops', 5, *OUTPUTS)
    assert (found.returncode, found.stdout) == (1, '')
    assert found.stderr.splitlines()[-1] == 'error: no device'
    assert files() == before
