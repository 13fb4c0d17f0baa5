"""The command `outlines` with a counting sheet."""

import pytest


@pytest.mark.slow
def test_counting_sheet_has_all_classes(run, tmp_path):
    ended = run('outlines', 'u_bracket', '--counting-sheet', 's.svg')
    assert 'Counting sheet: s.svg' in ended.stdout
    text = (tmp_path / 's.svg').read_text()
    for words in ('u_bracket, 30 x 25 x 20 mm', 'Class 2: aspects 2 and 3', 'Unclassified'):
        assert f'>{words}<' in text
    assert text.count('>total<') == 5
