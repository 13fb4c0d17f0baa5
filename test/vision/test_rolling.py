"""Parts that roll: outlines at any roll are recognized, and the roll where they tell it."""

import numpy as np
import pytest
import shapely
from scipy.spatial.transform import Rotation
from shapely import affinity

from resting_aspects_ros.aspects.aspect_set import Sweep
from resting_aspects_ros.rotations import turned_about_vertical
from resting_aspects_ros.vision.identification import identify
from resting_aspects_ros.vision.outline import rolled, seen_outline


@pytest.mark.slow
def test_outline_at_any_roll_is_that_of_its_poses(pin):
    """Also where the hole is seen through, which tells the roll within 2 degrees."""
    (aspect,) = [a for a in pin.aspects if a.sweep is not Sweep.POINT]
    (rolling,) = [each for each in pin.views if len(each.shapes) > 1]
    holes = [sum(ring.length for ring in each.polygon.interiors) for each in rolling.shapes]
    middle = rolling.rolls[int(np.argmax(holes))]
    for k, roll in enumerate([*np.linspace(0.1, 6.2, 4), middle - 0.2, middle + 0.1]):
        orientation = turned_about_vertical(rolled(aspect, roll), 0.4 + k)
        seen = affinity.translate(seen_outline(pin.part, orientation), 0.03, 0.02)
        best = identify(seen, [pin]).best
        assert aspect.id in best.aspects
        pose = best.poses[0]
        turn = Rotation.from_quat(pose.orientation).as_matrix()
        x, y, height = pose.position + turn @ pin.part.centre_of_mass
        assert height == pytest.approx(4e-3, rel=0.01)
        again = affinity.translate(seen_outline(pin.part, pose.orientation), x, y)
        # The mean distance is less than 0.01 mm.
        assert shapely.symmetric_difference(again, seen).area < 1e-5 * seen.length
    turns = [
        Rotation.from_quat(pose.orientation) * Rotation.from_matrix(symmetry)
        for pose in best.poses
        for symmetry in pin.aspects.symmetry.rotations
    ]
    true = Rotation.from_quat(orientation)
    assert len(seen.interiors) == 1
    assert min(np.degrees((each * true.inv()).magnitude()) for each in turns) < 2.0
