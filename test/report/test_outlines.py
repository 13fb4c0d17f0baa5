"""Texts about outlines: what distinguishes classes that look alike, and the counting sheet."""

import pytest

from resting_aspects_ros.report.outlines import yaw_symmetry_text
from resting_aspects_ros.report.sheet import _pages, drawing_scale


def test_yaw_symmetry_is_a_turn():
    texts = [yaw_symmetry_text(order) for order in (0, 1, 2, 7)]
    assert texts == ['any turn', 'none', '180 deg', '51.43 deg']


@pytest.mark.parametrize('count', [0, 5, 6, 40])
def test_every_class_is_on_one_page_with_room_for_the_rest(count):
    pages = list(_pages(list(range(count))))
    assert [row for page in pages for row in page] == list(range(count))
    assert all(1 <= len(page) <= 5 for page in pages) or count == 0
    assert len(pages) == max(-(-count // 5), 1)


@pytest.mark.parametrize(
    ('side', 'scale'),
    [(36, 1), (9, 1), (8.9, 2), (37, 0.5), (72.1, 0.2), (0.035, 1000)],
)
def test_drawings_fit_at_a_simple_scale(side, scale):
    assert drawing_scale(side) == pytest.approx(scale)
    assert drawing_scale(side) * side <= 36
