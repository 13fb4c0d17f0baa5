"""Progress on standard error: a bar on a terminal, otherwise one line per second."""

import os
import re

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
def test_terminal_shows_a_bar_with_rate_on_stderr_only(begin, terminal):
    with terminal() as (theirs, shown):
        process = begin('drop', 'l_bracket', '--drops', 1500, '--workers', 2, stderr=theirs)
        os.close(theirs)
        printed = process.communicate(timeout=600)[0]
    assert process.returncode == 0
    text = shown.decode()
    assert re.search(r'1500/1500 \x1b\[0m ?[\d.]+ drops/s|1500/1500.*?[\d.]+ drops/s', text)
    assert '━' in text
    assert ' of 1500 drops' not in text
    assert printed.splitlines()[1].strip() == '1500 drops on rubber_mat, seed 1'
    assert '\x1b' not in printed
