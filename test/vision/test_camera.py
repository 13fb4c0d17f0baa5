"""Image to tray, the sign of yaw, the magnification of high parts, and the robot's frame."""

import numpy as np
import pytest
import shapely
from scipy.spatial.transform import Rotation

from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.vision.camera import (
    Pinhole,
    Telecentric,
    find_homography,
    transformed_pose,
)
from resting_aspects_ros.vision.location import Pose

# 10 px/mm, the origin of the tray in the centre of an image of 2000 x 1000 px.
SIMPLE = np.array([[1e-4, 0, -0.1], [0, -1e-4, 0.05], [0, 0, 1]])
CORNERS = np.array([[0, 0], [2000, 0], [2000, 1000], [0, 1000]])


def perspective(pixels):
    """Map pixels to the tray by an inclined camera."""
    x, y = np.asarray(pixels, float).T
    w = 1 + 1e-5 * x - 2e-5 * y
    return np.stack([(1e-4 * x + 2e-5 * y - 0.1) / w, (1e-5 * x - 1e-4 * y + 0.05) / w], axis=1)


def test_four_pairs_give_the_exact_homography():
    camera = Telecentric(find_homography(CORNERS, perspective(CORNERS)))
    inside = [[500, 300], [1200, 900], [1999, 1]]
    np.testing.assert_allclose(camera.to_tray(inside), perspective(inside), atol=1e-12)
    np.testing.assert_allclose(camera.to_image(perspective(inside)), inside, atol=1e-6)


def test_sum_of_squares_on_the_tray_is_at_its_minimum():
    generator = np.random.default_rng(1)
    pixels = generator.uniform(0, 1000, (400, 2)) * (2, 1)
    points = perspective(pixels) + generator.normal(0, 1e-4, (400, 2))
    camera = Telecentric(find_homography(pixels, points))
    assert np.abs(camera.to_tray(CORNERS) - perspective(CORNERS)).max() < 5e-5

    def loss(homography):
        return ((Telecentric(homography).to_tray(pixels) - points) ** 2).sum()

    for k in range(8):
        for factor in (0.999, 1.001):
            other = camera.homography.copy()
            other.flat[k] *= factor
            assert loss(other) > loss(camera.homography)


@pytest.mark.parametrize(
    ('pixels', 'points', 'words'),
    [
        (CORNERS[:3], CORNERS[:3] * 1e-4, 'expected'),
        (CORNERS, perspective(CORNERS)[[0, 2, 1, 3]], 'expected'),
        (CORNERS, np.full((4, 2), np.nan), 'expected'),
        (CORNERS, perspective(CORNERS) * 1000, 'probably in mm'),
    ],
)
def test_degenerate_pairs_are_refused(pixels, points, words):
    with pytest.raises(InvalidValueError, match=words):
        find_homography(pixels, points)


def oblique(tilt, distance=0.5, focal=2000.0):
    """The homography of a camera, degrees from straight down, that aims at the origin.

    Where v is small enough, its pixels show the sky.
    """
    t = np.radians(tilt)
    down, right = np.array([0, np.sin(t), -np.cos(t)]), np.array([1.0, 0, 0])
    axes = np.stack([right, np.cross(down, right), down])
    pixels = np.array([[focal, 0, 1000], [0, focal, 500], [0, 0, 1]])
    return np.linalg.inv(pixels @ np.column_stack([axes[:, :2], [0, 0, distance]]))


@pytest.mark.parametrize('tilt', [0, 45, 75, 85])
def test_oblique_cameras_are_not_mirrored(tilt):
    exact = oblique(tilt)
    marks = np.array([[-0.05, -0.05], [0.05, -0.05], [0.05, 0.05], [-0.05, 0.05], [0, 0]])
    seen = np.column_stack([marks, np.ones(5)]) @ np.linalg.inv(exact).T
    pixels = seen[:, :2] / seen[:, 2:]
    found = find_homography(pixels, marks)
    for homography in (found, -found, found / found[2, 2]):
        camera = Telecentric(homography)
        np.testing.assert_allclose(camera.to_tray(pixels), marks, atol=1e-9)
    with pytest.raises(InvalidValueError, match='mirrors'):
        find_homography(pixels, marks * [1, -1])
    if tilt >= 75:
        with pytest.raises(InvalidValueError, match='horizon'):
            camera.to_tray([[1000, -500], [1000, 500]])


def test_clockwise_in_the_image_is_negative_yaw():
    start = np.array([1000, 400])
    end = start + np.array([np.cos(np.radians(30)), np.sin(np.radians(30))])
    (x, y), (right, up) = Telecentric(SIMPLE).to_tray([start, end])
    yaw = np.degrees(np.arctan2(up - y, right - x))
    assert (x, y, yaw) == pytest.approx((0, 0.01, -30))


def test_pinhole_magnifies_high_edges_about_its_foot():
    camera = Pinhole(SIMPLE, np.array([0.05, 0.02, 0.5]))
    corners = np.array([[0.01, 0.01], [0.04, 0.01], [0.04, 0.03]])
    # The ray from the camera through a corner at the height 0.1 meets the surface here.
    ray = np.column_stack([corners, np.full(3, 0.1)]) - camera.position
    on_surface = (camera.position + ray * 0.5 / 0.4)[:, :2]
    high = np.column_stack([corners, np.full(3, 0.1)])
    np.testing.assert_allclose(camera.seen(high), on_surface, atol=1e-12)
    found = camera.projected(shapely.Polygon(on_surface), 0.1)
    assert found.equals_exact(shapely.Polygon(corners), 1e-12)


def test_pinhole_must_be_above_the_surface_and_the_part():
    for position in ([0, 0, 0], [0, 0, float('nan')], [0, 0, 10**400]):
        with pytest.raises(InvalidValueError, match='invalid position'):
            Pinhole(SIMPLE, position)
    camera = Pinhole(SIMPLE, np.array([0.0, 0.0, 0.5]))
    with pytest.raises(InvalidValueError, match='invalid height'):
        camera.projected(shapely.box(0, 0, 1, 1), 0.5)


def test_pose_in_the_frame_of_the_robot():
    turn = Rotation.from_rotvec([0, 0, np.pi / 2])
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = turn.as_matrix(), (1, 2, 3)
    seen = Pose(1, np.array([0.1, 0, 0]), np.array([0, 0, 0, 1.0]))
    pose = transformed_pose(matrix, seen)
    np.testing.assert_allclose(pose.position, (1, 2.1, 3))
    np.testing.assert_allclose(pose.orientation, turn.as_quat())
    for wrong in (np.eye(3), 2 * np.eye(4), np.diag([1, 1, -1, 1])):
        with pytest.raises(InvalidValueError, match='invalid transform'):
            transformed_pose(wrong, seen)
