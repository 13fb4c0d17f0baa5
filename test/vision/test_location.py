"""6D poses from camera poses, for symmetric parts and symmetric outlines."""

import pytest
import shapely
from scipy.spatial.transform import Rotation
from shapely import affinity

from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.vision.outline import seen_outline

NAMES = ('box_10x20x30', 'hex_nut', 'l_bracket', 'washer')


@pytest.mark.parametrize('name', NAMES)
def test_every_pose_looks_like_the_outline(known, name):
    for placement in known(name).placements:
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


def test_turns_are_only_those_that_the_part_lacks(known):
    # The sides of l_bracket are rectangles, but it has no symmetry; those of a box are its own.
    assert [len(each.turns) for each in known('l_bracket').placements] == [1, 1, 2, 2, 2]
    assert [len(each.turns) for each in known('box_10x20x30').placements] == [1, 1, 1]
    assert [len(each.poses(0, 0, 0)) for each in known('hex_nut').placements] == [2, 6]
    # The outline of a washer is round, and so is the washer.
    assert all(each.yaw_known for each in known('washer').placements)


def test_wrong_yaw_is_refused(known):
    with pytest.raises(InvalidValueError, match='invalid yaw'):
        known('l_bracket').placements[0].poses(0, 0, float('nan'))
