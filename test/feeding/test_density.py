"""The share of free parts against closed forms and against shapely."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.feeding import footprint
from resting_aspects_ros.feeding.footprint import (
    Footprint,
    Tray,
    blocking_area,
    free_shares,
    gap,
)

ALONE = np.ones(1)
PART = Footprint(0.03, 0.02)
TRAY = Tray((0.2, 0.2), 0.005)
# About four standard errors of the table; see PLACED.
TOLERANCE = 0.02


@pytest.fixture
def low_density(monkeypatch):
    """End the tables where the density is no longer low."""
    monkeypatch.setattr(footprint, 'MIN_FREE', 0.6)


def corners(pose, size):
    turn = np.array([[pose[2], -pose[3]], [pose[3], pose[2]]])
    local = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * size[:2]
    return shapely.Polygon(local @ turn.T + pose[:2])


@given(st.integers(0, 2**32 - 1))
def test_gap_is_the_distance_of_the_shapes(seed):
    generator = np.random.default_rng(seed)
    yaw = generator.uniform(0, 2 * math.pi, (2, 50, 1))
    poses = np.dstack([generator.uniform(-1, 1, (2, 50, 2)), np.cos(yaw), np.sin(yaw)])
    sizes = generator.uniform(0, 0.6, (2, 50, 3)) * [1, 1, 0.2]
    found = gap(poses[0], sizes[0], poses[1], sizes[1])
    for k in range(50):
        shapes = [corners(pose[k], size[k]) for pose, size in zip(poses, sizes, strict=True)]
        distance = shapes[0].distance(shapes[1])
        if distance > 0:
            assert found[k] == pytest.approx(distance - sizes[0][k, 2] - sizes[1][k, 2], abs=1e-12)
        else:
            assert found[k] < 0


@pytest.mark.quick_cases(1)
@pytest.mark.usefixtures('low_density')
@pytest.mark.parametrize('part', [Footprint(0.03, 0.02), Footprint(0, 0, 0.01)])
def test_free_share_is_that_of_the_blocking_area_at_low_density(part):
    tray = Tray((1.0, 1.0), 0.02)
    found = free_shares(tray, [part], ALONE, 1, 30).at(30)[0]
    assert found == pytest.approx(math.exp(-29 * blocking_area(tray, part, part)), abs=TOLERANCE)


def test_two_points_on_a_square_have_their_closed_form():
    """P(distance <= d) = pi d^2 - 8 d^3 / 3 + d^4 / 2 for d <= 1 on the unit square."""
    for d in (0.2, 0.5, 0.8):
        found = free_shares(Tray((1.0, 1.0), d), [Footprint(0, 0)], ALONE, 1, 8).at(2)[0]
        near = math.pi * d**2 - 8 / 3 * d**3 + d**4 / 2
        assert found == pytest.approx(1 - near, abs=2 * TOLERANCE)


@pytest.mark.slow
def test_number_that_does_not_fit_is_refused():
    table = free_shares(TRAY, [PART], ALONE, 1, 60)
    assert table.full
    # 60 parts would cover 90 % of the tray; random placement fills about half of it.
    assert 18 <= len(table.free) <= 36
    with pytest.raises(InvalidValueError, match='no more fit'):
        table.at(60)


@pytest.mark.parametrize(
    ('size', 'sides'), [((0.1, 0.01), (0.0999, 0.0099)), ((0.1, 0.1), (0.141, 1e-4))]
)
def test_a_part_that_only_fits_in_few_directions_is_free_alone(size, sides):
    tray, only = Tray(size, 1e-3), Footprint(*sides)
    assert free_shares(tray, [only], np.ones(1), 1).free[0] == 1
    assert free_shares(tray, [only], np.ones(1), 1, separated=False).free[0] == 1


def test_wrong_tray_and_too_large_part_are_refused():
    with pytest.raises(InvalidValueError, match='invalid tray'):
        Tray((0.2, math.nan), 0.0)
    for part in (Footprint(0.19, 0.19, 0.02), Footprint(0, 0, 0.11)):
        with pytest.raises(InvalidValueError, match='into which the part fits'):
            free_shares(TRAY, [part], ALONE, 1)
