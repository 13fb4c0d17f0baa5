"""Rows of pictures and pages: what looks alike has one, and one colour."""

import numpy as np
import pytest

from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.report.format import (
    COLOURS,
    GREY,
    aspect_colour,
    class_rows,
    outside_rows,
)
from resting_aspects_ros.statistics.distribution import Distribution


@pytest.mark.parametrize(
    ('name', 'named'),
    [
        ('hex_nut', ['aspects 1 and 2', 'aspects 3 to 8']),
        ('cylinder_d20_h20', ['aspect 1', 'aspects 2 and 3']),
    ],
)
def test_equivalent_aspects_share_a_row(part, name, named):
    aspects = find_aspects(part(name))
    counts = np.arange(len(aspects)) + 5
    rows = class_rows(Distribution(aspects, counts, 0, 0, 0))
    assert sorted(row.name for row in rows) == sorted(named)
    assert sum(row.count for row in rows) == counts.sum()
    for row in rows:
        assert {aspect_colour(aspect) for aspect in row.aspects} == {row.colour}
        assert row.count == sum(counts[aspect.id - 1] for aspect in row.aspects)
        assert row.interval.probability == row.count / counts.sum()
    assert [row.colour for row in rows] == list(COLOURS[: len(rows)])


def test_other_outcomes_have_a_grey_row_if_they_occurred(part):
    aspects = find_aspects(part('l_bracket'))
    rows = outside_rows(Distribution(aspects, np.full(5, 100), 20, 0, 3))
    assert [(row.name, row.count, row.colour) for row in rows] == [
        ('unclassified', 20, GREY),
        ('failed', 3, GREY),
    ]
