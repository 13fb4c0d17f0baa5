"""Rotations held to scipy's, to explicit matrices, and to what Haar uniformity means."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from scipy.stats import kstest

from resting_aspects_ros.rotations import (
    canonical,
    down_in_part,
    orientation_with_down,
    random_orientations,
    rotate,
    rotation_between,
)

# A test at this level fails a right generator for one seed in a thousand; the seeds are fixed.
LEVEL = 1e-3

components = st.floats(-1, 1)
quaternions = st.tuples(components, components, components, components).filter(
    lambda q: np.linalg.norm(q) > 1e-3
)
directions = st.tuples(components, components, components).filter(
    lambda d: np.linalg.norm(d) > 1e-3
)


def unit(vector):
    return np.array(vector) / np.linalg.norm(vector)


def test_rotated_points_agree_with_scipy():
    # No two of the components of this turn are alike.
    turn = Rotation.from_euler('xz', [70, 40], degrees=True)
    points = np.array([[1.0, 2.0, 3.0], [0.0, -1.0, 0.5]])
    points.setflags(write=False)  # as a part's arrays are
    quaternion = turn.as_quat()
    expected = points @ turn.as_matrix().T
    np.testing.assert_allclose(rotate(quaternion, points), expected, atol=1e-15)
    np.testing.assert_allclose(
        rotate(np.stack([quaternion, [0, 0, 0, 1]]), points), [expected[0], points[1]], atol=1e-15
    )


@pytest.mark.slow
@given(quaternions)
@example((0.0, 0.0, 1.0, 0.0))
@example((0.0, 0.0, 0.0, -1.0))
def test_canonical_quaternion_is_the_same_rotation(q):
    given = np.array([q])
    found = canonical(given)
    np.testing.assert_array_equal(given, [q])
    assert found[0, 3] >= 0
    assert np.linalg.norm(found) == pytest.approx(1, abs=1e-15)
    np.testing.assert_allclose(
        Rotation.from_quat(found[0]).as_matrix(), Rotation.from_quat(q).as_matrix(), atol=1e-14
    )


@given(st.lists(quaternions, max_size=4), st.floats(-np.pi, np.pi))
def test_down_in_part_is_that_of_scipy_for_any_yaw(list_of_q, yaw):
    q = np.array([unit(each) for each in list_of_q]).reshape(-1, 4)
    down = down_in_part(q)
    assert down.shape == (len(q), 3)
    if len(q):
        part_from_tray = Rotation.from_quat(q).as_matrix().transpose(0, 2, 1)
        np.testing.assert_allclose(down, part_from_tray @ [0, 0, -1], atol=1e-14)
        turned = (Rotation.from_rotvec([0, 0, yaw]) * Rotation.from_quat(q)).as_quat()
        np.testing.assert_allclose(down_in_part(turned), down, atol=1e-14)


@given(directions)
@example((0.0, 0.0, 1.0))  # straight up: half a turn, about no axis in particular
@example((0.0, 0.0, -1.0))  # already down
@example((1e-9, 0.0, 1.0))
@example((1e-5, -1e-7, 1.0))
def test_any_direction_is_turned_down_by_the_shortest_rotation(direction):
    down = unit(direction)
    q = orientation_with_down(down)
    assert q[3] >= 0
    assert np.linalg.norm(q) == pytest.approx(1, abs=1e-14)
    np.testing.assert_allclose(down_in_part(q), down, atol=1e-12)
    shortest = np.arctan2(np.hypot(down[0], down[1]), -down[2])
    assert Rotation.from_quat(q).magnitude() == pytest.approx(shortest, abs=1e-7)


def test_random_orientations_have_the_angles_of_haar_measure():
    q = random_orientations(np.random.default_rng(7), 20_000)
    turns = Rotation.from_quat(q)
    # A turn from one to the next is uniform again, as these are independent.
    for turn in (turns, turns[1::2] * turns[::2].inv()):
        # Density (1 - cos t) / pi on [0, pi].
        assert kstest(turn.magnitude(), lambda t: (t - np.sin(t)) / np.pi).pvalue > LEVEL


@pytest.mark.parametrize('axis', range(3))
def test_random_orientations_distribute_axes_uniformly(axis):
    q = random_orientations(np.random.default_rng(8), 20_000)
    image = rotate(q, np.eye(3)[axis])
    # Uniform on the sphere: every coordinate is uniform (Archimedes), and so is the longitude.
    for coordinate in image.T:
        assert kstest(coordinate, 'uniform', args=(-1, 2)).pvalue > LEVEL
    longitude = np.arctan2(image[:, 1], image[:, 0])
    assert kstest(longitude, 'uniform', args=(-np.pi, 2 * np.pi)).pvalue > LEVEL


def test_random_orientations_depend_only_on_the_generator():
    q = random_orientations(np.random.default_rng(7), 100)
    assert q.shape == (100, 4)
    assert (q[:, 3] >= 0).all()
    np.testing.assert_allclose(np.linalg.norm(q, axis=1), 1, atol=1e-15)
    np.random.seed(0)  # noqa: NPY002
    np.testing.assert_array_equal(random_orientations(np.random.default_rng(7), 100), q)
    assert (random_orientations(np.random.default_rng(8), 100) != q).any(axis=1).all()


@pytest.mark.parametrize('broken', [False, True])
@pytest.mark.parametrize(
    ('one', 'other'),
    [((0, 0, 1), (0, 0, -1)), ((1, 0, 0), (-1, 0, 0)), ((0.6, 0, 0.8), (0, 1, 0))],
)
def test_shortest_rotation_between_two_directions(monkeypatch, broken, one, other):
    """Broken: SciPy before 1.13 does not turn a vector into its opposite."""
    if broken:
        unchanged = SimpleNamespace(align_vectors=lambda *_: (Rotation.identity(), 0.0))
        monkeypatch.setattr('scipy.spatial.transform.Rotation', unchanged)
    one, other = np.array(one, dtype=float), np.array(other, dtype=float)
    turn = Rotation.from_quat(rotation_between(one, other))
    np.testing.assert_allclose(turn.apply(one), other, atol=1e-12)
    assert turn.magnitude() == pytest.approx(np.arccos(one @ other))
