"""The command `optimise`."""

import pytest

from resting_aspects_ros.system import Interruption


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize(('checks', 'text'), [(60, 'The search ended early'), (0, '')])
def test_interrupted_search_shows_what_is_known(run, monkeypatch, checks, text):
    asked = []
    stopping = property(lambda _: len(asked.append(1) or asked) > checks, lambda *_: None)
    monkeypatch.setattr(Interruption, 'asked', stopping, raising=False)
    words = ('--vary', 'height=10mm:20mm', '--budget', 1920, '--workers', 1, '--wanted', '1')
    ended = run('optimise', 'tetrahedron', *words)
    assert ended.returncode == 130
    assert text in ended.stdout
    assert 'interrupted; ' in ended.stderr.splitlines()[-1]
