"""Grasps of a part: the file, what is refused, and the area of the gripper."""

import math

import numpy as np
import pytest
import yaml

from resting_aspects_ros.api.identify import known_part
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.feeding.grasps import (
    Grasp,
    check_grasps,
    gripper_area,
    gripper_poses,
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
    check_grasps((cup, fingers), known.placements, [1])
    inches = load(tmp_path, {'unit': 'in', 'grasps': [grasp(position=[1, 0, 0])]})
    assert inches[0].position == pytest.approx([0.0254, 0, 0])


@pytest.mark.parametrize(
    ('content', 'words'),
    [
        (None, 'keys unit, grasps'),
        ({'grasps': [grasp(), {'aspect': 1}]}, 'grasp 2.*has no position'),
        ({'grasps': [grasp(force=3)]}, "invalid key 'force'.*grasp 1"),
        ({'grasps': [grasp(position=[1, 2, math.nan])]}, 'expected 3 numbers'),
        ({'grasps': [grasp(orientation=[0, 0, 0, 2])]}, 'unit quaternion xyzw'),
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


def test_area_of_a_gripper_is_that_of_its_footprint(known):
    placement = known.placements[0]
    for made, size in zip(load_grasps(FILE), (math.pi * 0.003**2, 0.02 * 0.006), strict=True):
        (pose,) = gripper_poses(made, placement.poses(0, 0, 0))
        area = gripper_area(made, pose)
        assert area.area == pytest.approx(size, rel=0.01)
        assert area.centroid.coords[0] == pytest.approx(pose.position[:2])
