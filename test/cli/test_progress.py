"""Progress on standard error: a bar on a terminal, otherwise one line per second."""

import contextlib
import fcntl
import os
import pty
import re
import struct
import termios

import pytest

from resting_aspects_ros.api import runner


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
def test_terminal_shows_a_bar_with_rate_on_stderr_only(begin):
    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack('4H', 24, 80, 0, 0))
    process = begin('drop', 'l_bracket', '--drops', 1500, '--workers', 2, stderr=theirs)
    os.close(theirs)
    shown = bytearray()
    with contextlib.suppress(OSError):  # the other end is closed
        while data := os.read(ours, 4096):
            shown += data
    os.close(ours)
    printed = process.communicate(timeout=600)[0]
    assert process.returncode == 0
    text = shown.decode()
    assert re.search(r'1500/1500.*?[\d.]+ drops/s', text)
    assert '━' in text
    assert ' of 1500 drops' not in text
    assert '\x1b' not in printed
