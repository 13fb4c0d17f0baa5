"""Values in messages: one line, short, without control characters, for any value."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from resting_aspects_ros.errors import (
    MAX_SHOWN,
    EngineError,
    OutputError,
    RestingAspectsWarning,
    analysis,
    one_line,
    shown,
)


class Broken:
    def __repr__(self):
        raise RuntimeError


def bomb():
    nested = ['x'] * 9
    for _ in range(30):
        nested = [nested] * 9
    return nested


def test_repr_of_any_value_is_one_short_line():
    for value in ('x' * 1_000_000, '\x1b]0;\x07\n\u202e', 10**5000, bomb(), [Broken()]):
        text = shown(value)
        assert 0 < len(text) <= MAX_SHOWN
        assert text.isprintable()


def test_short_values_are_shown_whole_and_long_ones_by_their_ends():
    for value in ('bracket', 1e-9, {'a': [1, None]}):
        assert shown(value) == repr(value)
    assert shown([np.int64(3), np.float64(99)]) == '[3, 99.0]'
    text = shown('/data/' + 'x' * 500 + '/bracket.stl')
    assert text.startswith("'/data/")
    assert text.endswith("/bracket.stl'")


@given(text=st.text(max_size=400), length=st.integers(20, 200))
def test_external_text_becomes_one_printable_line(text, length):
    line = one_line(text, length)
    assert line.isprintable()
    assert len(line) <= length


def test_analysis_that_fails_is_a_warning_and_other_failures_pass():
    notes = []
    with (
        pytest.warns(RestingAspectsWarning, match='the G test .*ZeroDivisionError'),
        analysis('the G test', notes),
    ):
        raise ZeroDivisionError
    assert len(notes) == 1
    assert notes[0].startswith('The G test')
    for error in (EngineError('died'), OutputError('full'), OSError('full'), KeyboardInterrupt()):
        with pytest.raises(type(error)), analysis('the G test', notes):
            raise error
    assert len(notes) == 1
