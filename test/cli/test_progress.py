"""Progress on standard error: a bar on a terminal, otherwise one line per second."""

import fcntl
import os
import pty
import re
import struct
import termios
import threading

import pytest

from resting_aspects_ros.api import runner

WORDS = ('drop', 'l_bracket', '--drops', 1500, '--workers', 2)


@pytest.fixture
def in_terminal(begin, environment):
    """Run the command with a terminal of 80 columns as stderr; returns all its output."""

    def show(*words, stdout=None):
        ours, theirs = pty.openpty()
        fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack('4H', 24, 80, 0, 0))
        shown = []
        reader = threading.Thread(target=_read, args=(ours, shown))
        reader.start()
        options = {} if stdout is None else {'stdout': theirs}
        process = begin(*words, stderr=theirs, **options)
        os.close(theirs)
        printed = process.communicate(timeout=600)[0]
        reader.join()
        os.close(ours)
        assert process.returncode == 0
        return printed, b''.join(shown).decode()

    return show


def _read(descriptor, shown):
    while True:
        try:
            data = os.read(descriptor, 4096)
        except OSError:  # the other end is closed
            return
        if not data:
            return
        shown.append(data)


def test_pipe_gets_no_line_twice(monkeypatch, capsys):
    monkeypatch.setattr(runner, 'LINE_PERIOD', 0.0)
    with runner.DropProgress('part', 10) as shown:
        for done in (0, 0, 3, 3, 7, 7):
            shown.update(done)
        shown.end(7)  # the precision was reached early
        shown.end(7)
    lines = [line.split('  ')[0] for line in capsys.readouterr().err.splitlines()]
    assert lines == [f'part: {said} drops' for said in ('0 of 10', '3 of 10', '7 of 10', '7 of 7')]


@pytest.mark.slow
def test_terminal_shows_a_bar_with_rate_on_stderr_only(in_terminal):
    printed, shown = in_terminal(*WORDS)
    assert re.search(r'1500/1500 \x1b\[0m ?[\d.]+ drops/s|1500/1500.*?[\d.]+ drops/s', shown)
    assert '━' in shown
    assert ' of 1500 drops' not in shown
    assert printed.splitlines()[1].strip() == '1500 drops on rubber_mat, seed 1'
    assert '\x1b' not in printed


@pytest.mark.slow
def test_no_color_is_respected(in_terminal, environment, monkeypatch):
    colour = re.compile(r'\x1b\[(?:\d+;)*(?:3[0-7]|38;[\d;]+|9[0-7])m')
    assert colour.search(in_terminal(*WORDS, stdout='same')[1])
    monkeypatch.setitem(environment, 'NO_COLOR', '1')
    _, shown = in_terminal(*WORDS, stdout='same')
    assert '1500/1500' in shown
    assert not colour.search(shown)
