"""The live table and the sentences of the feeder demo."""

import io

import pytest
from rich.console import Console

from resting_aspects_ros.cli.feeder_display import (
    FeederView,
    feeder_line,
    feeder_sentence,
    feeder_table,
)


def view(**changed):
    fields = {
        'minutes': 10.05,
        'total': 10.0,
        'on_tray': 12,
        'picks': 270,
        'missed': 0,
        'images': 150,
        'flips': 149,
        'supplied': 282,
        'reason': 'Pick 2 parts; a flip is expected to bring 1.4 more picks.',
        'rate': 26.87,
        'forecast': 26.0,
        'lower': 24.0,
        'upper': 28.0,
    }
    return FeederView(**{**fields, **changed})


def test_table_shows_the_run_beside_its_forecast():
    console = Console(width=80, record=True, file=io.StringIO())
    console.print(feeder_table(view(missed=3)))
    text = console.export_text()
    for words in ('10:03 of 10 min', '270 (3 missed)', '26.9', '26.0 (24.0 to 28.0)', 'Pick 2'):
        assert words in text
    assert max(map(len, text.splitlines())) <= 80
    assert '270 picks, 26.9 per minute (forecast 26.0' in feeder_line(view())


@pytest.mark.parametrize(
    ('changed', 'end'),
    [
        ({}, 'this run lies within that interval.'),
        ({'rate': 28.4}, 'this run lies outside that interval.'),
        ({'minutes': 2.0}, 'this run was shorter.'),
    ],
)
def test_sentence_compares_the_run_with_the_interval(changed, end):
    text = feeder_sentence(view(**changed), 61.3)
    assert text.splitlines()[0].endswith(end)
    assert 'which took 61 s' in text
