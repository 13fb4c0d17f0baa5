"""6D poses from camera poses and back, for symmetric parts and symmetric outlines."""

import numpy as np
import pytest
import shapely
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from shapely import affinity

from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.vision.location import camera_pose
from resting_aspects_ros.vision.outline import seen_outline

NAMES = ('box_10x20x30', 'hex_nut', 'l_bracket', 'washer')


@pytest.fixture
def placements(known):
    """Give the placements of all classes of a part."""
    return lambda name: known(name).placements


@pytest.mark.parametrize('name', NAMES)
def test_every_pose_looks_like_the_outline(placements, name):
    for placement in placements(name):
        outline = placement.outline
        expected = affinity.rotate(outline.polygon, 0.7, origin=(0, 0), use_radians=True)
        expected = affinity.translate(expected, 0.1, -0.05)
        for pose in placement.poses(0.1, -0.05, 0.7):
            turn = Rotation.from_quat(pose.orientation).as_matrix()
            x, y, height = pose.position + turn @ placement.part.centre_of_mass
            seen = affinity.translate(seen_outline(placement.part, pose.orientation), x, y)
            assert shapely.symmetric_difference(seen, expected).area < 0.01 * outline.area
            assert height == pytest.approx(outline.com_height, rel=0.01)
            assert placement.aspects.classify(pose.orientation)[0] == pose.aspect


@pytest.mark.quick_cases(2)
@pytest.mark.parametrize('name', NAMES)
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(x=st.floats(-1, 1), y=st.floats(-1, 1), yaw=st.floats(-np.pi, np.pi))
def test_camera_pose_and_back(placements, name, x, y, yaw):
    for placement in placements(name):
        for pose in placement.poses(x, y, yaw)[: len(placement.outline.aspects)]:
            found = camera_pose(placements(name), pose.position, pose.orientation)
            assert found.aspect == pose.aspect
            assert found.symmetry_class == placement.outline.symmetry_class
            assert (found.x, found.y) == pytest.approx((x, y), abs=1e-9)
            assert abs(np.angle(np.exp(1j * (found.yaw - yaw)))) < 1e-6


def test_turns_are_only_those_that_the_part_lacks(placements):
    # The sides of l_bracket are rectangles, but it has no symmetry; those of a box are its own.
    assert [len(each.turns) for each in placements('l_bracket')] == [1, 1, 2, 2, 2]
    assert [len(each.turns) for each in placements('box_10x20x30')] == [1, 1, 1]
    assert [len(each.poses(0, 0, 0)) for each in placements('hex_nut')] == [2, 6]
    # The outline of a washer is round, and so is the washer.
    assert all(each.yaw_known for each in placements('washer'))


def test_rolled_part_keeps_its_yaw(placements, part):
    all_placements = placements('cylinder_d20_h20')
    (rolling,) = [each for each in all_placements if len(each.outline.aspects) == 1]
    (pose, *_) = rolling.poses(0.1, 0.2, 0.5)
    axis = rolling.aspects[0].axis
    for angle in (1.0, np.pi, -2.0):
        roll = Rotation.from_quat(pose.orientation) * Rotation.from_rotvec(angle * axis)
        centre = np.array([0.1, 0.2, rolling.outline.com_height])
        position = centre - roll.as_matrix() @ part('cylinder_d20_h20').centre_of_mass
        found = camera_pose(all_placements, position, roll.as_quat())
        assert (found.x, found.y) == pytest.approx((0.1, 0.2), abs=1e-9)
        assert np.sin(found.yaw - 0.5) == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize(
    ('position', 'orientation', 'words'),
    [
        ([0, 0, float('nan')], [0, 0, 0, 1], 'position'),
        ([0, 0, 0], [0, 0, 0, 2], 'unit quaternion'),
        ([0, 0, 0], [0.2, 0.1, 0, np.sqrt(0.95)], 'degrees from aspect'),
    ],
)
def test_wrong_poses_are_refused(placements, position, orientation, words):
    with pytest.raises(InvalidValueError, match=words):
        camera_pose(placements('l_bracket'), position, orientation)
    with pytest.raises(InvalidValueError, match='invalid yaw'):
        placements('l_bracket')[0].poses(0, 0, float('nan'))
