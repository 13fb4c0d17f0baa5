"""A pose belongs to an aspect if the direction that is down is one of the aspect's."""

import numpy as np
import pytest
from fuzz import part_families
from scipy.spatial.transform import Rotation
from trimesh.convex import convex_hull

from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.statistics.poses import RestStatus

DROPS = 40
TOLERANCE = np.radians(3.0)


def rounded_box():
    signs = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    corner = part_families.ball(24, 'ico', None)
    return np.concatenate([corner + [0.8, 1.2, 1.6] * np.array(sign) for sign in signs])


def lens():
    angles = part_families.arc(np.arcsin(0.8), 48)
    profile = [(np.sin(t), end * (np.cos(t) - 0.6)) for t in angles for end in (-1, 1)]
    return part_families.revolved(profile, 32)


def ball_with_flat():
    return part_families.cut(part_families.ball(40, 'ico', None), -0.9)


PARTS = {
    'ball with a flat': ball_with_flat,
    'D shaft': lambda: part_families.d_shaft(64, 0.9, 4.0),
    'rounded box': rounded_box,
    'lens': lens,
    'needle': lambda: part_families.extruded(part_families.circle(24, 0.05), 10.0),
    'cone': lambda: part_families.revolved([(1, 0), (0, 2)], 48),
}


def angles_to_aspects(aspects, down):
    """Angles (n, a) from directions to each aspect, beyond half a step of its mesh."""
    found = []
    for aspect in aspects.aspects:
        a, b = np.moveaxis(aspect.directions[aspect.links], 1, 0)
        steps = np.arccos(np.clip((a * b).sum(axis=1), -1, 1))
        nearest = np.arccos(np.clip(down @ aspect.directions.T, -1, 1)).min(axis=1)
        found.append(nearest - steps.max(initial=0) / 2)
    return np.array(found).T


@pytest.mark.parametrize('name', PARTS)
def test_a_pose_is_in_an_aspect_if_a_direction_of_it_is_down(solid, drop, name):
    part = solid(convex_hull(10 * PARTS[name]()))
    aspects = find_aspects(part)
    poses = drop(part, DROPS)
    settled = poses.status == RestStatus.SETTLED
    assert settled.sum() > DROPS / 2
    turn = Rotation.from_quat(poses.orientation[settled])
    down = turn.inv().apply([0, 0, -1])
    ids = aspects.classify(poses.orientation[settled])
    angles = angles_to_aspects(aspects, down)
    for k, angle in zip(ids, angles, strict=True):
        if k > 0:
            assert angle[k - 1] <= TOLERANCE
        if angle.min() > TOLERANCE:
            assert k == 0
    assert (ids > 0).any()


def test_a_pose_with_no_direction_of_an_aspect_down_is_in_none(solid):
    part = solid(convex_hull(10 * PARTS['cone']()))
    aspects = find_aspects(part)
    turns = Rotation.random(1000, random_state=1)
    ids = aspects.classify(turns.as_quat())
    angles = angles_to_aspects(aspects, turns.inv().apply([0, 0, -1])).min(axis=1)
    step = 2 * np.pi / 48
    assert (ids[angles > TOLERANCE] == 0).all()
    assert (ids[angles < TOLERANCE - step / 2] > 0).all()
    assert 0 < (ids > 0).sum() < 500
