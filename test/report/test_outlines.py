"""Texts about outlines: what distinguishes classes that look alike, and the counting sheet."""

import dataclasses
import re

import numpy as np
import pytest
import trimesh
from shapely import Polygon

from resting_aspects_ros.api.outlines import outlines
from resting_aspects_ros.report.outlines import (
    MAX_GROUPS,
    confused_class_texts,
    short_look_alike_text,
    yaw_symmetry_text,
)
from resting_aspects_ros.report.sheet import _pages, drawing_scale
from resting_aspects_ros.vision.outline import LookAlike


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
    (found,) = confused_class_texts(*pair(outline, verdict, resolution, height))
    assert text in found


def test_clear_differences_are_not_listed(outline):
    assert confused_class_texts(*pair(outline, 'distinct', 7e-4)) == []
    assert short_look_alike_text(outline, pair(outline, 'distinct', 7e-4)[1][1]) == ''


def entry_table(count, verdict_and_resolution):
    """Return the entries of classes 1 to count, as a function of two of them states."""
    return {
        k: tuple(
            LookAlike(j, 0.9, *verdict_and_resolution(min(j, k), max(j, k)))
            for j in range(1, count + 1)
            if j != k
        )
        for k in range(1, count + 1)
    }


def classes_named(text):
    """Return the numbers of the classes that a sentence names."""
    names = re.match(r'Classes ([0-9, and to]*\d)', text)[1].replace(' and ', ', ')
    ends = [list(map(int, each.split(' to '))) for each in names.split(', ')]
    return {number for each in ends for number in range(each[0], each[-1] + 1)}


def confused(outline, count, verdict_and_resolution):
    several = [dataclasses.replace(outline, symmetry_class=k) for k in range(1, count + 1)]
    return confused_class_texts(several, entry_table(count, verdict_and_resolution))


def test_classes_that_look_the_same_are_one_sentence(outline):
    (text,) = confused(outline, 9, lambda a, b: ('same', 1e-5))
    assert classes_named(text) == set(range(1, 10))
    (text,) = confused(outline, 9, lambda a, b: ('distinct', (a + b) * 1e-5))
    assert classes_named(text) == set(range(1, 10))
    assert '0.0300 to 0.170 mm' in text


def test_each_confused_pair_is_in_a_sentence_and_no_other(outline):
    # A chain: only neighbours are alike.
    texts = confused(outline, 5, lambda a, b: ('distinct', 1e-4 if b == a + 1 else 1e-2))
    assert [classes_named(text) for text in texts] == [{1, 2}, {2, 3}, {3, 4}, {4, 5}]
    # Two groups with the same outline each, which are mirror images of each other.
    texts = confused(outline, 6, lambda a, b: ('mirrored' if a < 4 <= b else 'same', 1e-4))
    assert [classes_named(text) for text in texts[:2]] == [{1, 2, 3}, {4, 5, 6}]
    assert len(texts) == 3
    assert 'Classes 1 to 3 and 4 to 6 show mirror images' in texts[2]


def test_worst_groups_are_first_and_their_number_is_limited(outline):
    # Only neighbours are alike, so that each pair is a group.
    count = MAX_GROUPS + 4
    texts = confused(
        outline, count, lambda a, b: ('distinct', (20 - a) * 1e-5 if b == a + 1 else 1e-2)
    )
    assert classes_named(texts[0]) == {count - 1, count}
    assert len(texts) == MAX_GROUPS + 1
    assert texts[-1].startswith('3 more groups')


def test_sides_that_are_almost_equal_do_not_multiply_the_sentences(solid):
    """Two ends and six sides of a nut differ by less than a camera resolves: 16 pairs."""
    corners = 6 * np.exp(1j * np.arange(6) * np.pi / 3)
    corners += 0.15 * np.exp(1j * np.array([0.3, 2.9, 4.0, 1.1, 5.0, 2.0]))
    end = Polygon(np.column_stack([corners.real, corners.imag]))
    result = outlines(solid(trimesh.creation.extrude_polygon(end, 5)))
    assert len(result.outlines) == 8
    groups = [
        classes_named(text) for text in confused_class_texts(result.outlines, result.look_alikes)
    ]
    assert len(groups) <= 4
    for one, others in result.look_alikes.items():
        for other in others:
            alike = other.verdict != 'distinct' or other.resolution < 2e-4
            assert alike == any({one, other.symmetry_class} <= group for group in groups)


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
