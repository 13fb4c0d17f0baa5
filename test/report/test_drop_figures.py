"""The figures of a report beside its pictures: all words can be read, in both widths."""

import numpy as np
import pytest

from resting_aspects_ros.report.drop_figures import (
    comparison_figure,
    convergence_figure,
    pie_figure,
)
from resting_aspects_ros.report.figure import NARROW, WIDE, labels_apart
from resting_aspects_ros.report.format import Row
from resting_aspects_ros.statistics.intervals import Interval

NAMES = ['aspect 1', 'aspects 2 and 3', 'aspects 4, 5, 6 and 12', 'aspects 10, 12, ... 30']
SHARES = [0.9, 0.06, 0.03, 0.01]
WIDTHS = pytest.mark.parametrize('width', [WIDE, NARROW])


@pytest.fixture
def rows():
    colours = ['#0072B2', '#E69F00', '#009E73', '#D55E00']
    return [
        Row(name, round(1e6 * p), Interval(p, 0.99 * p, 1.01 * p), colour)
        for name, p, colour in zip(NAMES, SHARES, colours, strict=True)
    ]


@WIDTHS
def test_lines_and_bands_of_the_convergence_are_inside_the_axes(rows, width):
    looks = np.array([1, 2, 5, 10, 20, 50, 100, 200, 500, 1000])
    bands = [
        [
            Interval(p, max(0.0, p - p / np.sqrt(n)), min(1.0, p + 1 / np.sqrt(n)))
            for p in (0.5, 0.2, 0.2, 0.1)
        ]
        for n in looks
    ]
    (axes,) = convergence_figure(rows, looks, bands, width).axes
    shapes = [line.get_xydata() for line in axes.lines if line.get_clip_on()]
    shapes += [path.vertices for band in axes.collections for path in band.get_paths()]
    assert len(shapes) == 2 * len(rows)
    for points in shapes:
        for values, (low, high) in zip(points.T, (axes.get_xlim(), axes.get_ylim()), strict=True):
            assert low <= values.min()
            assert values.max() <= high


@WIDTHS
def test_comparison_with_long_texts_is_readable(rows, texts, width):
    differences = [
        '-12.35 (-12.51 to -12.21)',
        '+0.12 (-0.02 to +0.15)',
        '0',
        '-0.015 (-0.021 to 0.000)',
    ]
    own = [row.interval for row in rows]
    words = 'manual_count_of_the_night_shift_2025-01-31.csv, 980 of 1000 drops in an aspect'
    sides = [('simulated', own), (words, own)]
    ranges = [[Interval(0.5, 0.4, 0.97)] * len(rows), [None] * len(rows)]
    figure = comparison_figure(rows, sides, differences, ranges, width)
    texts(figure)
    (axes,) = figure.axes
    # The longest bar with its interval ends inside, and takes a good part of the room.
    low, high = axes.get_xlim()
    assert low == 0
    assert 0.3 < 0.97 / high < 1


def test_labels_of_small_slices_at_the_bottom_are_inside(texts):
    shares = np.where(np.arange(24) == 11, 0.055, 0.945 / 23)
    rows = [
        Row(f'aspect {k}', round(1e3 * p), Interval(p, 0.9 * p, 1.1 * p), '#0072B2')
        for k, p in enumerate(shares.tolist(), 1)
    ]
    figure = pie_figure(rows, [np.ones((8, 8, 4))] * len(rows))
    texts(figure)
    assert 'aspect 12' in [text.get_text() for text in figure.axes[0].texts]


def test_labels_that_are_too_close_move_apart_by_little():
    moved = labels_apart(np.array([0.0, 1.0, 27.3, 27.5]), 2.0)
    np.testing.assert_allclose(moved, [0.0, 2.0, 26.4, 28.4])
    far = np.array([1.0, 5.0, 9.0])
    np.testing.assert_array_equal(labels_apart(far, 2.0), far)
