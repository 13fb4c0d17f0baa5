"""The command `optimise`."""

import json

import pytest

from resting_aspects_ros.errors import OutputError
from resting_aspects_ros.studies.optimum import OptimiseResult
from resting_aspects_ros.system import Interruption

FEW = ('--budget', 1920, '--workers', 1)
WORDS = ('optimise', 'tetrahedron', '--vary', 'height=10mm:20mm', *FEW)


@pytest.mark.slow
def test_full_disk_does_not_lose_the_result(run, monkeypatch):
    def full(*_):
        raise OutputError('points.csv cannot be written: No space left on device')

    monkeypatch.setattr(OptimiseResult, 'save_csv', full)
    ended = run(*WORDS, '--wanted', '1', '--out', 'o', '--json')
    assert ended.returncode == 1
    assert 'No space left on device' in ended.stderr
    assert json.loads(ended.stdout)['complete']


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize(('checks', 'text'), [(60, 'The search ended early'), (0, '')])
def test_interrupted_search_shows_what_is_known(run, monkeypatch, checks, text):
    asked = []
    stopping = property(lambda _: len(asked.append(1) or asked) > checks, lambda *_: None)
    monkeypatch.setattr(Interruption, 'asked', stopping, raising=False)
    ended = run(*WORDS, '--wanted', '1')
    assert ended.returncode == 130
    assert text in ended.stdout
    assert 'interrupted; ' in ended.stderr.splitlines()[-1]
