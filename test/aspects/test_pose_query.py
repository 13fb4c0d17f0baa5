"""One pose: which quaternions are orientations, and which aspect is nearest."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from resting_aspects_ros.aspects.aspect_set import (
    POSE_ANGLE,
    AspectSet,
    nearest_aspect,
    unit_orientation,
)
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.rotations import canonical, random_orientations

# Half of its numbers negative, so that no order and no sign passes for another.
UNIT = np.array([0.1, -0.7, 0.5, -0.5])


@pytest.fixture(scope='module')
def box(part):
    return find_aspects(part('box_10x20x30'))


def tilted(aspect, angle, yaw=0.0):
    """A pose of the aspect turned about the vertical, then about the tray's x."""
    turn = Rotation.from_euler('x', angle) * Rotation.from_euler('z', yaw)
    return canonical((turn * Rotation.from_quat(aspect.orientation)).as_quat())


@given(st.floats(-1e-3 + 1e-12, 1e-3 - 1e-12))
def test_quaternion_of_nearly_unit_length_is_normalized(off):
    unit = unit_orientation(UNIT * (1 + off))
    np.testing.assert_allclose(unit, -UNIT, rtol=0, atol=1e-15)


@pytest.mark.parametrize(
    ('wrong', 'norm'),
    [
        (UNIT * 1.0011, '1.0011'),
        (UNIT * 0.9989, '0.9989'),
        (np.zeros(4), '0'),
        ([np.nan, 0, 0, 1], 'nan'),
        ([1e200, 1e200, 0, 0], 'inf'),
    ],
)
def test_error_for_quaternion_of_another_norm(wrong, norm):
    with pytest.raises(InvalidValueError, match=f'of norm {norm}: expected .* 1 within 0.001'):
        unit_orientation(wrong)


@pytest.mark.parametrize('degrees', [0.0, 1.0, 2.999, 3.001, 20.0])
def test_angle_is_the_tilt_for_any_yaw(box, degrees):
    for aspect in box.aspects:
        nearest = nearest_aspect(box, tilted(aspect, np.radians(degrees), yaw=aspect.id))
        assert nearest.aspect is aspect
        assert nearest.angle == pytest.approx(np.radians(degrees), abs=1e-12)
        assert nearest.fits == (degrees < 3)


def test_nearest_aspect_agrees_with_classify(box, part):
    for aspects in (box, find_aspects(part('cylinder_d20_h20'))):
        orientation = random_orientations(np.random.default_rng(5), 400)
        # Half of them as steep as at rest, nearly.
        steep = [tilted(aspects.aspects[k % 3], 2.4 * POSE_ANGLE * k / 400) for k in range(400)]
        orientation = np.concatenate([orientation, steep])
        nearest = [nearest_aspect(aspects, xyzw) for xyzw in orientation]
        ids = [each.aspect.id if each.fits else 0 for each in nearest]
        assert ids == aspects.classify(orientation).tolist()
        assert 0 in ids
        assert {1, 2, 3} <= set(ids)


def test_no_nearest_aspect_without_aspects():
    assert nearest_aspect(AspectSet('', ()), np.array([0, 0, 0, 1.0])) is None
