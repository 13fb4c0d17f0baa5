"""The service classify_pose: its implementation, and requests over DDS."""

import math

import numpy as np
import pytest
from geometry_msgs.msg import Quaternion
from resting_aspects_interfaces.msg import Status
from resting_aspects_interfaces.srv import ClassifyPose
from scipy.spatial.transform import Rotation

from resting_aspects_ros.aspects.find import find_aspects

BOX = 'box_10x20x30'


def quaternion(xyzw):
    return Quaternion(**dict(zip('xyzw', map(float, xyzw), strict=True)))


def tilted(aspect, degrees):
    """Return the pose of an aspect, rotated about the vertical and then tilted."""
    turn = Rotation.from_euler('zx', [77, degrees], degrees=True)
    return (turn * Rotation.from_quat(aspect.orientation)).as_quat()


@pytest.fixture(scope='module')
def box(part):
    return find_aspects(part(BOX))


@pytest.fixture(scope='module')
def classify(suite):
    """Return a function that sends a request to the suite."""
    suite.client.wait(lambda: len(suite.client.parts()) == 4, 'descriptions of the parts')
    client = suite.client.node.create_client(ClassifyPose, 'classify_pose')

    def ask(name, orientation):
        request = ClassifyPose.Request(part=name, orientation=quaternion(orientation))
        return suite.client.call(client, request)

    return ask


def test_pose_between_aspects(classify, box):
    found = classify(BOX, tilted(box.aspects[0], 20))
    assert found.status.code == Status.NOT_AVAILABLE
    assert 'the nearest is aspect 1 at 20 degrees, expected at most 3' in found.status.message
    assert found.aspect == 0
    assert found.angle == pytest.approx(np.radians(20), abs=1e-9)


@pytest.mark.parametrize(
    ('name', 'orientation', 'code', 'words'),
    [
        (BOX, (math.nan, 0, 0, 1), Status.INVALID, 'nan, 0, '),
        ('gizmo', (0, 0, 0, 1), Status.UNKNOWN_PART, 'box_10x20x30, '),
    ],
)
def test_invalid_request_is_rejected(classify, name, orientation, code, words):
    found = classify(name, orientation)
    assert (found.status.code, found.aspect) == (code, 0)
    assert words in found.status.message
    assert math.isnan(found.probability)
    assert math.isnan(found.angle)
