"""The figures of a distribution show its numbers, and all words can be read."""

import io
import itertools

import numpy as np
import pytest
from PIL import Image

from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.report.drop_figures import (
    MAX_SHOWN,
    _rows,
    distribution_figure,
    pie_figure,
)
from resting_aspects_ros.report.figure import labels_apart, png_bytes
from resting_aspects_ros.report.format import COLOURS, GREY, Row, class_rows, interval_text, rgb
from resting_aspects_ros.statistics.distribution import Distribution, no_drops
from resting_aspects_ros.statistics.intervals import Interval
from resting_aspects_ros.statistics.model_range import with_model_range


@pytest.fixture(scope='module')
def aspects(part):
    return find_aspects(part('l_bracket'))


def test_picture_has_both_widths_and_says_what_they_cover(aspects, texts):
    distribution = Distribution(aspects, np.array([400, 200, 150, 100, 0]), 120, 30, 0)
    ranged = with_model_range(distribution)
    figure = distribution_figure(ranged, None, 'title', 'Model range: all of it.')
    words = texts(figure)
    assert 'Model range: all of it.' in words
    bars = figure.axes[1].patches
    ends = {(round(b.get_x(), 6), round(b.get_x() + b.get_width(), 6)) for b in bars}
    for row in class_rows(ranged):
        assert (0, round(row.interval.probability, 6)) in ends
        assert (round(row.model.lower, 6), round(row.model.upper, 6)) in ends
        assert f'{interval_text(row.interval)}\nmodel range {interval_text(row.model)}' in words


@pytest.mark.filterwarnings('error')
def test_picture_without_drops_or_aspects(aspects, part):
    for each in (aspects, AspectSet(aspects.part_sha256, ())):
        data = png_bytes(distribution_figure(no_drops(each), part('l_bracket'), 'none'))
        with Image.open(io.BytesIO(data)) as image:
            assert image.width == 1240


def test_most_probable_classes_are_shown_and_others_summed(many_sided):
    aspects = find_aspects(many_sided)
    counts = np.arange(len(aspects))[::-1] % 50
    rows = _rows(Distribution(aspects, counts, 0, 7, 0))
    shown = [row.aspects[0].id - 1 for row in rows if row.aspects]
    assert (shown, len(shown)) == (sorted(shown), MAX_SHOWN)
    others = np.delete(counts, shown)
    assert counts[shown].min() >= others.max()
    names = [f'{len(aspects) - MAX_SHOWN} other aspects', 'unsettled']
    assert [(row.name, row.count) for row in rows[MAX_SHOWN:]] == [
        (names[0], others.sum()), (names[1], 7)
    ]  # fmt: skip


def test_colours_are_distinguishable_for_colour_blind_viewers():
    # Machado, Oliveira and Fernandes 2009, severity 1: no red, no green.
    sights = [
        np.eye(3),
        [
            [0.152286, 1.052583, -0.204868],
            [0.114503, 0.786281, 0.099216],
            [-0.003882, -0.048116, 1.051998],
        ],
        [
            [0.367322, 0.860646, -0.227968],
            [0.280085, 0.672501, 0.047413],
            [-0.011820, 0.042940, 0.968881],
        ],
    ]
    colours = np.array([rgb(colour) for colour in (*COLOURS, GREY)])
    linear = np.where(colours <= 0.04045, colours / 12.92, ((colours + 0.055) / 1.055) ** 2.4)
    for sight in sights:
        lab = cielab(np.clip(linear @ np.transpose(sight), 0, 1))
        assert min(np.linalg.norm(a - b) for a, b in itertools.combinations(lab, 2)) > 10


def cielab(linear):
    xyz = (
        linear
        @ np.array([[0.4124, 0.2126, 0.0193], [0.3576, 0.7152, 0.1192], [0.1805, 0.0722, 0.9505]])
        / [0.9505, 1.0, 1.089]
    )
    f = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16 / 116)
    x, y, z = f.T
    return np.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], axis=1)


def test_labels_of_small_slices_at_the_bottom_are_inside(texts):
    shares = np.where(np.arange(24) == 11, 0.055, 0.945 / 23)
    rows = [
        Row(f'aspect {k}', round(1e3 * p), Interval(p, 0.9 * p, 1.1 * p), '#0072B2')
        for k, p in enumerate(shares.tolist(), 1)
    ]
    assert 'aspect 12' in texts(pie_figure(rows, [np.ones((8, 8, 4))] * len(rows)))


def test_labels_that_are_too_close_move_apart_by_little():
    moved = labels_apart(np.array([0.0, 1.0, 27.3, 27.5]), 2.0)
    np.testing.assert_allclose(moved, [0.0, 2.0, 26.4, 28.4])
    far = np.array([1.0, 5.0, 9.0])
    np.testing.assert_array_equal(labels_apart(far, 2.0), far)
