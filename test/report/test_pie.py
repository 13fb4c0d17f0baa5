"""The pie: a picture for every slice, however small."""

import numpy as np
import pytest

from resting_aspects_ros.report.drop_figures import (
    DISTANCE,
    MAX_PICTURES,
    SIDE,
    pie_figure,
    spread,
)
from resting_aspects_ros.report.format import Row
from resting_aspects_ros.statistics.intervals import Interval

IMAGE = np.ones((4, 4, 4), dtype=np.float32)


@pytest.mark.parametrize(
    'shares', [[1.0], [0.99, 0.01], [0.9, 0.04, 0.02, 0.02, 0.01, 0.01], [0.1] * 10]
)
def test_largest_slices_have_separate_pictures(shares):
    rows = [Row(f'r{k}', 1, Interval(p, p, p), '#0072B2') for k, p in enumerate(shares)]
    (axes,) = pie_figure(rows, [IMAGE] * len(rows)).axes
    boxes = np.array([image.get_extent() for image in axes.images])
    assert len(boxes) == min(len(shares), MAX_PICTURES)
    centres = np.stack([boxes[:, :2].mean(axis=1), boxes[:, 2:].mean(axis=1)], axis=1)
    low, high = np.array([axes.get_xlim(), axes.get_ylim()]).T
    assert (centres - SIDE / 2 >= low).all()
    assert (centres + SIDE / 2 <= high).all()
    apart = np.linalg.norm(centres[:, None] - centres, axis=2)
    assert (apart[np.triu_indices(len(centres), 1)] >= 0.9 * SIDE).all()
    names = [text.get_text().split('\n')[0] for text in axes.texts if text.get_text()]
    assert sorted(names) == sorted(row.name for row in rows)


def test_spread_moves_only_close_angles():
    angles = np.array([1.5, 0.0, -2.0])
    assert spread(angles, 0.5).tolist() == angles.tolist()
    close = spread(np.array([1.0, 0.9, 0.8]), 2 * np.arcsin(SIDE / 2 / DISTANCE))
    assert close.mean() == pytest.approx(0.9)
    assert (np.diff(close) <= -0.42).all()
