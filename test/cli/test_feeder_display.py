"""The live table and the sentences of the feeder demo."""

import io
from types import SimpleNamespace

import pytest
from rich.console import Console

from resting_aspects_ros.cli.feeder_display import (
    FeederView,
    feeder_line,
    feeder_sentence,
    feeder_table,
)

COUNTED = {'minutes': 10.05, 'on_tray': 12, 'picks': 270, 'missed': 3, 'images': 150}
COUNTED |= {'choices': {'flip': 149}, 'rate': 26.87, 'advice': SimpleNamespace(reason='Pick 2')}
FORECAST = SimpleNamespace(rate=26.0, prediction=(24.0, 28.0))


def view(**changed):
    return FeederView(SimpleNamespace(**{**COUNTED, **changed}), FORECAST, 10.0)


def test_table_shows_the_run_beside_its_forecast():
    console = Console(width=80, record=True, file=io.StringIO())
    console.print(feeder_table(view()))
    text = console.export_text()
    for words in ('10:03 of 10 min', '270 (3 missed)', '26.9', '26.0 (24.0 to 28.0)', 'Pick 2'):
        assert words in text
    assert max(map(len, text.splitlines())) <= 80
    assert '270 picks, 26.9 per minute (forecast 26.0' in feeder_line(view())


@pytest.mark.parametrize(
    ('changed', 'said'),
    [({}, 'within'), ({'rate': 28.4}, 'outside'), ({'minutes': 2.0}, 'shorter')],
)
def test_sentence_compares_the_run_with_the_interval(changed, said):
    text = feeder_sentence(view(**changed), 61.3)
    assert said in text.splitlines()[0].rpartition(';')[2]
    assert '61 s' in text
