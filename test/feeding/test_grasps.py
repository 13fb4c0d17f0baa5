"""Grasps of a part: the file, what is refused, and the footprints on the tray."""

import math

import numpy as np
import pytest
import shapely
import yaml
from shapely import affinity

from resting_aspects_ros.api.identify import known_part
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.feeding import footprint
from resting_aspects_ros.feeding.footprint import Footprint, Grip, Tray, free_shares
from resting_aspects_ros.feeding.grasps import (
    Grasp,
    check_grasps,
    gripper_area,
    gripper_poses,
    grips_of,
    load_grasps,
)

FILE = 'config/grasps/l_bracket.yaml'
DOWN = (0.0, 0.0, 0.0, 1.0)  # z of the part points down in aspect 1


@pytest.fixture(scope='module')
def known(part):
    return known_part(part('l_bracket'), dict.fromkeys(range(1, 6), 1.0))


def load(folder, content):
    path = folder / 'grasps.yaml'
    path.write_text(yaml.safe_dump(content), encoding='utf-8')
    return load_grasps(path)


def grasp(**changes):
    values = {'aspect': 1, 'position': [15, 5, 0], 'orientation': list(DOWN), 'footprint': 6}
    return {**values, **changes}


def test_file_states_grasps_in_si_units(known, tmp_path):
    cup, fingers = load_grasps(FILE)
    assert cup.position == pytest.approx([0.015, 0.005, 0])
    assert (cup.length, cup.width, cup.radius) == (0, 0, pytest.approx(0.003))
    assert (fingers.length, fingers.width, fingers.radius) == pytest.approx((0.02, 0.006, 0))
    check_grasps((cup, fingers), known.placements, [1])
    inches = load(tmp_path, {'unit': 'in', 'grasps': [grasp(position=[1, 0, 0])]})
    assert inches[0].position == pytest.approx([0.0254, 0, 0])


@pytest.mark.parametrize(
    ('content', 'words'),
    [
        (None, 'keys unit, grasps'),
        ({'grasps': [grasp()], 'unit': 'px'}, "invalid unit 'px'"),
        ({'grasps': [grasp(), {'aspect': 1}]}, 'grasp 2.*has no position'),
        ({'grasps': [grasp(force=3)]}, "invalid key 'force'.*grasp 1"),
        ({'grasps': [grasp(position=[1, 2, math.nan])]}, 'expected 3 numbers'),
        ({'grasps': [grasp(orientation=[0, 0, 0, 2])]}, 'unit quaternion xyzw'),
        ({'grasps': [grasp(footprint='6 mm')]}, "invalid footprint '6 mm' in"),
    ],
)
def test_invalid_file_is_refused_with_the_number_of_the_grasp(tmp_path, content, words):
    with pytest.raises(InvalidValueError, match=words):
        load(tmp_path, content)


@pytest.mark.parametrize(
    ('made', 'pickable', 'words'),
    [
        (Grasp(9, np.zeros(3), DOWN, radius=0.01), [1], 'invalid aspect 9 of grasp 1: expected 1'),
        (Grasp(1, np.array([15.0, 5, 0]), DOWN, radius=0.01), [1], 'is the unit right'),
        (Grasp(1, np.zeros(3), (1, 0, 0, 0), radius=0.01), [1], 'it is 180 degrees from that'),
        (Grasp(1, np.zeros(3), DOWN, radius=0.01), [1, 3], 'expected one for pickable aspect 3'),
    ],
)
def test_grasp_that_does_not_fit_the_part_is_refused(known, made, pickable, words):
    with pytest.raises(InvalidValueError, match=words):
        check_grasps([made], known.placements, pickable)


def test_grip_covers_the_area_of_the_gripper(known):
    """Beside the rectangle around the outline, and as a polygon beside the outline itself."""
    placement = known.placements[0]
    grasps = load_grasps(FILE)
    rectangle = shapely.minimum_rotated_rectangle(placement.outline.polygon)
    for made, grip in zip(grasps, grips_of(grasps, placement), strict=True):
        shape = grip.footprint
        box = shapely.box(-shape.length / 2, -shape.width / 2, shape.length / 2, shape.width / 2)
        box = box if box.area else shapely.Point(0, 0)
        box = affinity.rotate(box, grip.yaw, origin=(0, 0), use_radians=True)
        box = affinity.translate(box, grip.x, grip.y).buffer(shape.radius)
        box = affinity.rotate(box, placement.outline.long_axis, origin=(0, 0), use_radians=True)
        box = affinity.translate(box, *rectangle.centroid.coords[0])
        (pose,) = gripper_poses(made, placement.poses(0, 0, 0))
        area = gripper_area(made, pose)
        assert area.symmetric_difference(box).area < 1e-3 * area.area
        assert area.area == pytest.approx(shape.area, rel=0.01)


@pytest.mark.slow
def test_any_free_grip_is_sufficient(monkeypatch):
    """The share of free parts grows with each grip, and is 1 if the gripper is within the part."""
    monkeypatch.setattr(footprint, 'PLACED', 3000)
    tray = Tray((0.2, 0.2), 0.0)
    wide, beside = Grip(Footprint(0.06, 0.06)), Grip(Footprint(0.02, 0.02), 0.03)

    def free(*grips):
        footprints = [Footprint(0.03, 0.02, 0.0, grips), Footprint(0.03, 0.03)]
        return free_shares(tray, footprints, np.array([0.5, 0.5]), 1).at(10)

    both, one, other = free(wide, beside), free(wide), free(beside)
    assert max(one[0], other[0]) < both[0] < 1
    assert free(Grip(Footprint(0.01, 0.01)))[0] == 1
    # A class without grips only needs the clearance, which is 0 here.
    assert both[1] == 1
    # A grip in the middle is the gripper of the tray.
    gripped = Tray((0.2, 0.2), 0.0, wide.footprint)
    alone = free_shares(gripped, [Footprint(0.03, 0.02)], np.ones(1), 1)
    same = free_shares(tray, [Footprint(0.03, 0.02, 0.0, (wide,))], np.ones(1), 1)
    np.testing.assert_array_equal(alone.free, same.free)
