"""Bookkeeping of images, picks and epochs, without ROS."""

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.feeding.control import Choice
from resting_aspects_ros.feeding.grasps import Detection
from resting_aspects_ros.feeding.tray_state import (
    CLOCK_TOLERANCE,
    MAX_AGE,
    SECOND,
    ChosenPart,
    CurrentAdvice,
    Image,
    PickOutcome,
    TrayState,
    known_class,
)

NOW = 1000 * SECOND


DETECTION = Detection(0, 'nut', '1', 1.0, 0.0, 0.0, 0.0, math.inf)


def image(number=1, time=NOW, frame='tray'):
    return Image(number, time, frame, tuple(replace(DETECTION, index=k) for k in range(3)))


def left(tray):
    return [each.index for each in tray.image.detections] if tray.image is not None else None


@pytest.fixture
def tray():
    """A tray with an image of three parts, one second ago."""
    tray = TrayState()
    assert tray.add_image(image(time=NOW - SECOND), NOW)
    return tray


def test_picked_part_leaves_the_others(tray):
    assert tray.add_result(PickOutcome.PICKED, 1, 1, NOW, NOW) == ''
    assert not tray.add_image(image(time=NOW - SECOND), NOW)  # it arrives twice
    assert tray.add_result(PickOutcome.PICKED, 1, 0, NOW, NOW) == ''
    assert (tray.epoch, left(tray)) == (2, [2])
    # A second pick of a part is not understood.
    assert 'invalid detection 1 of image 1' in tray.add_result(PickOutcome.PICKED, 1, 1, NOW, NOW)
    assert left(tray) is None


def test_advice_says_how_many_parts_are_left_to_pick(tray):
    chosen = tuple(ChosenPart(each, 1) for each in tray.image.detections)
    advice = CurrentAdvice(Choice.PICK, 'Pick 3 parts.', chosen, Choice.FLIP, image=1)
    for index, words in enumerate(('2 parts that are left', 'the part that is left', 'flip')):
        tray.add_result(PickOutcome.PICKED, 1, index, NOW, NOW)
        advice = advice.after_picks(tray.image)
        assert words in advice.reason
        assert len(advice.picks) == 2 - index


@pytest.mark.parametrize(
    ('outcome', 'number', 'problem'),
    [(PickOutcome.MISSED, 1, ''), (PickOutcome.PICKED, 2, 'of image 1'), (None, 1, 'PICKED')],
)
def test_other_results_make_everything_stale(tray, outcome, number, problem):
    found = tray.add_result(outcome, number, 1, NOW, NOW)
    assert problem in found
    assert bool(found) == bool(problem)
    assert (tray.epoch, left(tray), tray.newest.number) == (1, None, 1)


def test_late_report_does_not_touch_a_newer_image(tray):
    assert tray.add_image(image(0, NOW), NOW)  # a camera may number from 0 again
    for epoch, outcome in enumerate((PickOutcome.PICKED, PickOutcome.MISSED, PickOutcome.MOVED)):
        assert tray.add_result(outcome, 1, 0, NOW, NOW) == ''
        assert (tray.epoch, left(tray)) == (epoch + 1, [0, 1, 2])
    # It was over after the exposure.
    assert tray.add_result(PickOutcome.PICKED, 1, 0, NOW + 1, NOW + 1) == ''
    assert left(tray) is None


def test_result_from_the_future_is_over_now(tray):
    problem = tray.add_result(PickOutcome.PICKED, 1, 1, NOW + 90 * SECOND, NOW)
    assert 'expected none in the future; it is 90.0 s ahead' in problem
    assert left(tray) is None
    assert tray.add_image(image(2, NOW), NOW)


@pytest.mark.parametrize(
    ('changes', 'message'),
    [
        ({'number': 2, 'time': NOW - 2 * SECOND}, 'a later one than that of image 1'),
        ({'number': 1, 'time': NOW}, 'another one than that of the previous image'),
        ({'number': 2, 'time': NOW + CLOCK_TOLERANCE + 1}, 'expected none in the future'),
        ({'number': 2, 'time': NOW - MAX_AGE - 1}, 'it is 10.0 s ago'),
        ({'number': 2, 'frame': '/tray'}, 'expected the name of a frame'),
    ],
)
def test_invalid_image_changes_nothing(tray, changes, message):
    with pytest.raises(InvalidValueError, match=message):
        tray.add_image(image(**changes), NOW)
    assert (tray.newest.number, left(tray)) == (1, [0, 1, 2])


def test_clock_that_is_set_back_is_followed(tray):
    tray.add_result(PickOutcome.MOVED, 0, 0, NOW, NOW)
    assert tray.add_image(image(1, 5 * SECOND), 5 * SECOND)
    assert left(tray) == [0, 1, 2]


@given(
    st.lists(
        st.one_of(
            st.tuples(st.just('image'), st.integers(-3, 3)),
            st.tuples(st.sampled_from([*PickOutcome, None]), st.integers(0, 3)),
        ),
        max_size=30,
    )
)
def test_no_detection_is_older_than_what_moved_the_tray(events):
    tray, now, moved, picked, number = TrayState(), NOW, 0, set(), 0
    for kind, value in events:
        now += SECOND
        if kind == 'image':
            number += 1
            try:
                is_used = tray.add_image(image(number, now + value * SECOND // 4), now)
            except InvalidValueError:
                is_used = False
            picked = set() if is_used else picked
        else:
            known = tray.newest.number if tray.newest is not None else 0
            now += SECOND  # after the exposure of all images
            problem = tray.add_result(kind, known, value, now, now)
            if kind is PickOutcome.PICKED and not problem:
                picked.add(value)
            else:
                moved = now
        if tray.image is not None:
            assert tray.image.time >= moved
            assert not picked.intersection(left(tray))


@pytest.mark.parametrize(
    ('field', 'value'),
    [('x', math.nan), ('y', 10.5), ('score', 1.1), ('clearance', -1e-9), ('class_id', '١')],
)
def test_invalid_detection_has_no_class(field, value):
    with pytest.raises(InvalidValueError, match=f'invalid {field} .* of detection 0: expected'):
        known_class(replace(DETECTION, **{field: value}), 3)
    assert known_class(replace(DETECTION, class_id='3'), 3) == 3
    assert known_class(replace(DETECTION, class_id=''), 3) == 0
