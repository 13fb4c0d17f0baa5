"""Texts about outlines: what distinguishes classes that look alike, and the counting sheet."""

import dataclasses

import pytest

from resting_aspects_ros.api.outlines import outlines
from resting_aspects_ros.core.vision.look_alikes import LookAlike
from resting_aspects_ros.report.counting_sheet import _pages, drawing_scale
from resting_aspects_ros.report.outline_table import (
    MAX_PAIRS,
    confused_pair_texts,
    family_texts,
    short_look_alike_text,
    yaw_symmetry_text,
)


@pytest.fixture(scope='module')
def outline(part):
    """The outline of a box, 30 x 20 mm and 10 mm high."""
    return outlines(part('box_10x20x30')).outlines[0]


def pair(outline, verdict, resolution, height=10e-3):
    """Return two outlines that look alike, as far as an entry says."""
    other = dataclasses.replace(outline, symmetry_class=2, height=height)
    entry = LookAlike(2, 0.99, verdict, resolution)
    back = dataclasses.replace(entry, symmetry_class=1)
    return [outline, other], {1: (entry,), 2: (back,)}


@pytest.mark.parametrize(
    ('verdict', 'resolution', 'height', 'text'),
    [
        ('same', 1e-5, 10e-3, 'No resolution distinguishes them; grey values of the upper side'),
        ('same', 1e-5, 15e-3, 'them; a measured height does: 10.0 and 15.0 mm.'),
        (
            'mirrored',
            3e-3,
            10e-3,
            'mirrored outlines distinguishes them; it needs a resolution of 3',
        ),
        ('distinct', 3e-4, 10e-3, 'Classes 1 and 2 differ by at most 0.300 mm: the camera must'),
    ],
)
def test_text_says_what_distinguishes_a_pair(outline, verdict, resolution, height, text):
    (found,) = confused_pair_texts(*pair(outline, verdict, resolution, height))
    assert text in found


def test_clear_differences_are_not_listed(outline):
    assert confused_pair_texts(*pair(outline, 'distinct', 7e-4)) == []
    assert short_look_alike_text(outline, pair(outline, 'distinct', 7e-4)[1][1]) == ''


def test_worst_pairs_are_first_and_their_number_is_limited(outline):
    count = 7
    several = [dataclasses.replace(outline, symmetry_class=k) for k in range(count)]
    entries = {
        k: tuple(
            LookAlike(j, 0.9, 'same' if {j, k} == {3, 5} else 'distinct', (j + k) * 1e-5)
            for j in range(count)
            if j != k
        )
        for k in range(count)
    }
    texts = confused_pair_texts(several, entries)
    assert texts[0].startswith('Classes 3 and 5 have the same outline')
    assert texts[1].startswith('Classes 0 and 1 differ by at most 0.0100 mm')
    assert len(texts) == MAX_PAIRS + 1
    assert texts[-1].startswith(f'{count * (count - 1) // 2 - MAX_PAIRS} more pairs')
    expected = 'class 3 (same), 0 (within 0.0500 mm), 1 (within 0.0600 mm), 3 more'
    assert short_look_alike_text(several[5], entries[5]) == expected


def test_a_family_is_mentioned(outline):
    rolling = dataclasses.replace(outline, family=(outline.polygon,) * 3)
    (text,) = family_texts([outline, rolling])
    assert 'changes while the part rolls or rocks' in text
    assert 'contains 3 more' in text


def test_yaw_symmetry_is_a_turn():
    texts = [yaw_symmetry_text(order) for order in (0, 1, 2, 3, 6, 7)]
    assert texts == ['any turn', 'none', '180 deg', '120 deg', '60 deg', '51.43 deg']


@pytest.mark.parametrize('count', [0, 1, 5, 6, 10, 11, 40])
def test_every_class_is_on_one_page_with_room_for_the_rest(count):
    pages = list(_pages(list(range(count))))
    assert [row for page in pages for row in page] == list(range(count))
    assert all(1 <= len(page) <= 5 for page in pages) or count == 0
    assert len(pages) == max(-(-count // 5), 1)


@pytest.mark.parametrize(
    ('side', 'scale'),
    [(36, 1), (9, 1), (8.9, 2), (37, 0.5), (72.1, 0.2), (3.5, 10), (0.035, 1000), (4e3, 5e-3)],
)
def test_drawings_fit_at_a_simple_scale(side, scale):
    assert drawing_scale(side) == pytest.approx(scale)
    assert drawing_scale(side) * side <= 36
