"""The command `optimise`."""

import json

import pytest

from resting_aspects_ros.errors import OutputError
from resting_aspects_ros.simulation.interruption import Interruption
from resting_aspects_ros.studies.optimum import OptimiseResult

FEW = ('--budget', 1920, '--workers', 1)
WORDS = ('optimise', 'tetrahedron', '--vary', 'height=10mm:20mm', *FEW)


def test_full_disk_does_not_lose_the_result(run, monkeypatch):
    def full(*_):
        raise OutputError('optimum.json cannot be written: No space left on device')

    monkeypatch.setattr(OptimiseResult, 'save_json', full)
    ended = run(*WORDS, '--wanted', '1', '--out', 'o', '--json')
    assert ended.returncode == 1
    assert 'No space left on device' in ended.stderr
    assert json.loads(ended.stdout)['complete']


@pytest.mark.parametrize(('checks', 'text'), [(60, 'The search ended early'), (0, '')])
def test_interrupted_search_shows_what_is_known(run, monkeypatch, checks, text):
    asked = []
    stopping = property(lambda _: len(asked.append(1) or asked) > checks, lambda *_: None)
    monkeypatch.setattr(Interruption, 'asked', stopping, raising=False)
    ended = run(*WORDS, '--wanted', '1')
    assert ended.returncode == 130
    assert text in ended.stdout
    assert 'interrupted; ' in ended.stderr.splitlines()[-1]


@pytest.mark.parametrize(
    ('words', 'message'),
    [
        (('--wanted', '1', '--vary', 'colour=1:2'), "invalid factor 'colour'"),
        (('--wanted', '1', '--vary', 'friction=0.9:0.3'), 'expected a lower and a higher value'),
        (('--wanted', 'all'), 'expected numbers separated by commas'),
        ((), 'expected one of wanted aspects'),
        (('--wanted', '9', '--minimise-entropy'), 'expected one of wanted aspects'),
        (('--wanted', '9'), 'invalid wanted aspect 9: expected 1 to 4'),
        (('--wanted', '1', '--vary', 'height=1mm:3mm'), 'expected height only once'),
        (('--wanted', '1', '--actions', 'mine.yaml'), 'expected only with --action'),
        (('--wanted', '1', '--budget', '100'), 'expected at least 1920 drops'),
        (('--wanted', '1', '--vary', 'surroundings.angle=1:2'), 'expected surroundings'),
    ],
)
def test_wrong_values_are_named(run, words, message):
    ended = run(*WORDS, *words)
    assert ended.returncode == 2
    assert message in ended.stderr
