"""Which parts feeder_controller picks with the grasps of a robot, without a ROS graph."""

import dataclasses
import math

import numpy as np
import pytest
from rclpy.serialization import serialize_message

from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.feeding.evidence import Evidence, build_model
from resting_aspects_ros.feeding.grasps import Detection, gripper_poses
from resting_aspects_ros.feeding.tray_state import Image, advise_image
from resting_aspects_ros.nodes.feeder_controller.model_updates import (
    PARAMETERS,
    read_fed_part,
    settings_from,
)
from resting_aspects_ros.nodes.feeder_controller.node import pick_msgs
from resting_aspects_ros.ros.conversions import part_msg
from resting_aspects_ros.rotations import rotate
from resting_aspects_ros.statistics.distribution import Distribution
from resting_aspects_ros.statistics.transitions import TransitionMatrix

DEFAULTS = {parameter.name: parameter.default for parameter in PARAMETERS}
VALUES = {**DEFAULTS, 'grasps': 'config/grasps/l_bracket.yaml', 'clearance': 0.0, 'best_number': 6}


@pytest.fixture(scope='module')
def settings():
    return settings_from(VALUES)


@pytest.fixture(scope='module')
def fed(part, settings):
    data = serialize_message(part_msg(part('l_bracket')))
    return read_fed_part(data, 'l_bracket', settings.grasps)


@pytest.fixture(scope='module')
def evidence(fed):
    """Return a function that makes the evidence of drops, and of flips (k, k) if given."""
    aspects = fed.known.aspects

    def evidence(drops, flips=None):
        if flips is not None:
            flips = TransitionMatrix(aspects, np.hstack([flips, np.zeros((len(flips), 4), int)]))
        return Evidence(Distribution(aspects, np.array(drops), 0, 0, 0), flips)

    return evidence


@pytest.fixture(scope='module')
def advise(fed, evidence, settings):
    """Return a function that returns the advice for detections, with other grasps if given."""
    model = build_model(evidence([27, 27, 25, 13, 8]), fed.footprints, settings)

    def advise(*seen, grasps=fed.grasps):
        part = dataclasses.replace(fed, grasps=grasps)
        return advise_image(Image(1, 1, 'tray', seen), part, model)

    return advise


def seen(index, x, y, yaw=0.0, clearance=math.inf, **changes):
    values = {'part': 'l_bracket', 'class_id': '1', 'score': 0.99, **changes}
    return Detection(index, x=x, y=y, yaw=yaw, clearance=clearance, **values)


def beside(fed, distance):
    """A part of class 1, and an unknown outline at a distance along x of its first grasp."""
    (pose,) = gripper_poses(fed.grasps[0], fed.known.placements[0].poses(0.0, 0.0, 0.0))
    x, y, _ = pose.position
    return seen(0, 0.0, 0.0), seen(1, x + distance, y, class_id='')


def test_grasps_are_in_the_order_of_the_file(fed, advise):
    advice = advise(seen(0, 0.03, -0.02, yaw=0.6))
    (message,) = pick_msgs(advice.picks, fed.known)
    lying = fed.known.placements[0].poses(0.03, -0.02, 0.6)
    expected = [pose for grasp in fed.grasps for pose in gripper_poses(grasp, lying)]
    assert len(message.grasps) == len(expected) == 2
    for found, pose in zip(message.grasps, expected, strict=True):
        at, turned = found.position, found.orientation
        assert [at.x, at.y, at.z] == pytest.approx(pose.position.tolist())
        assert [turned.x, turned.y, turned.z, turned.w] == pytest.approx(pose.orientation.tolist())


def test_part_without_a_free_grasp_is_not_picked(fed, advise):
    """The fingers reach 5 mm beyond the long legs of two brackets, which are side by side."""
    (part,) = fed.known.placements[0].poses(0.0, 0.0, 0.0)
    for gap, picked in ((0.002, []), (0.006, [0, 1])):
        x, y, _ = rotate(part.orientation, np.array([[0.0, -0.02 - gap, 0.0]]))[0]
        found = advise(seen(0, 0.0, 0.0), seen(1, x, y, yaw=math.pi), grasps=fed.grasps[1:])
        assert sorted(pick.detection.index for pick in found.picks) == picked


def test_unknown_outline_near_the_gripper_blocks_it(fed, advise):
    length = max(outline.length for outline in fed.known.outlines)
    far = advise(*beside(fed, length + 0.02))
    assert [len(pick.grasps) for pick in far.picks] == [2]
    near = advise(*beside(fed, length - 0.002))
    # The cup is above the part itself.
    assert [len(pick.grasps) for pick in near.picks] == [1]
    # The fingers reach 5 mm beyond the part.
    for clearance, grasps in ((0.004, 1), (0.0051, 2)):
        first, near = beside(fed, length - 0.002)
        advice = advise(dataclasses.replace(first, clearance=clearance), near)
        assert [len(pick.grasps) for pick in advice.picks] == [grasps]


@pytest.mark.slow
def test_missing_flips_have_the_shares_of_the_drops(fed, evidence, settings):
    """A rare class keeps its share: 1 of 1000 drops is less than one of 20 flips."""
    drops = np.array([1, 499, 300, 150, 50])
    found = build_model(evidence(drops), fed.footprints, settings)
    np.testing.assert_allclose(
        found.feeder.moves.transitions, np.tile(drops / 1000, (5, 1)), rtol=1e-12
    )
    flips = np.diag([5, 20, 0, 0, 100])
    found = build_model(evidence(drops, flips), fed.footprints, settings)
    expected = np.tile(drops / 1000, (5, 1))
    expected[0] = (np.array([5, 0, 0, 0, 0]) + 15 * drops / 1000) / 20
    expected[[1, 4]] = np.eye(5)[[1, 4]]
    np.testing.assert_allclose(found.feeder.moves.transitions, expected, rtol=1e-12)


@pytest.mark.parametrize(
    ('name', 'value'),
    [
        ('part', 'a nut'),
        ('pickable_classes', [0, 2]),
        ('tray', [0.2, math.nan]),
        ('action', 'a b'),
    ],
)
def test_invalid_setting_is_rejected(name, value):
    with pytest.raises(InvalidValueError, match=f'invalid {name} '):
        settings_from({**DEFAULTS, name: value})
