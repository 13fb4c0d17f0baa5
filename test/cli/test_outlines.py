"""`resting_aspects outlines`: its table, its document and its files."""

import pytest


@pytest.fixture
def done(run):
    """Run the command; returns what it printed."""

    def text(*words):
        ended = run('outlines', *words)
        assert ended.returncode == 0, ended.stderr
        return ended.stdout

    return text


@pytest.mark.slow
def test_counting_sheet_has_all_classes(done, tmp_path):
    assert 'Counting sheet: s.svg' in done('u_bracket', '--counting-sheet', 's.svg')
    text = (tmp_path / 's.svg').read_text()
    for words in (
        *('u_bracket, 30 x 25 x 20 mm', 'page 1 of 1', 'date', 'surface', 'counted by'),
        *('Class 2: aspects 2 and 3', 'From above it looks like class 4 (same).', 'Unclassified'),
    ):
        assert f'>{words}<' in text
    assert text.count('>total<') == 5
