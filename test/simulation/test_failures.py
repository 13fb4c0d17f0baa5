"""Drops that do not come to rest, and unphysical energy growth."""

import itertools
import math

import pybullet
import pytest

from resting_aspects_ros.simulation import job as drop_job
from resting_aspects_ros.simulation import release, settling
from resting_aspects_ros.simulation.conditions import BULLET
from resting_aspects_ros.simulation.job import make_job
from resting_aspects_ros.simulation.workers import drop_range
from resting_aspects_ros.statistics.poses import RestStatus


def test_parts_that_lose_no_energy_are_unsettled(part, mat, hull_in_tray):
    conditions = mat.changed(restitution=1.0, friction=0.0)
    job = make_job(part('l_bracket'), conditions, 1)
    poses = drop_range(job, 0, 2)
    assert (poses.status == RestStatus.UNSETTLED).all()
    # The time they were given, which goes on from the end of the first fall.
    given = release.TIME_LIMIT * job.time_unit
    assert poses.time_to_rest == pytest.approx(1.02 * given, rel=0.03)
    # Still bouncing, above the surface but for what an impact overlaps.
    lowest = hull_in_tray(part('l_bracket'), poses)[..., 2].min(axis=1)
    assert (lowest > -drop_job.TRAVEL_PER_STEP * job.radius).all()


# Newton's law adds up to a half. So much faster, what falls from 1 m, 44 R, has more of all its
# energy, which is 45 m g R with the height of the part itself.
@pytest.mark.quick_cases(1)
@pytest.mark.parametrize(
    ('growth', 'status'), [(math.inf, 'FAILED'), (0.56, 'FAILED'), (0.45, 'SETTLED')]
)
def test_excessive_energy_growth_fails_a_drop_only(
    part, mat, monkeypatch, assert_same_poses, growth, status
):
    # No input is known that does; here Bullet shows the first part faster at its first look, while
    # it still falls.
    job = make_job(part('l_bracket'), mat.changed(height=1.0), 1, engine=BULLET)
    monkeypatch.setattr(release, 'START_CLEARANCE', 20.0)
    sound = drop_range(job, 1, 3)
    fall = 1.0 / job.radius
    speed = math.sqrt(2 * (fall - 20)) + settling.CHECK_INTERVAL
    faster = math.sqrt(1 + growth * (fall + 1) / (speed**2 / 2))
    factors = itertools.chain([faster], itertools.repeat(1.0))
    whole = pybullet.getBaseVelocity

    def look(body, **where):
        velocity, spin = whole(body, **where)
        factor = next(factors)
        return tuple(factor * v for v in velocity), spin

    monkeypatch.setattr(pybullet, 'getBaseVelocity', look)
    poses = drop_range(job, 0, 3)
    assert RestStatus(poses.status[0]).name == status
    if growth < math.inf:
        assert poses.energy_growth[0] == pytest.approx(growth * (fall + 1), rel=0.02)
    if status == 'FAILED':
        assert math.isnan(poses.time_to_rest[0])
        assert poses.position[0].tolist() == [0, 0, 0]
    assert_same_poses(poses.between(1, 3), sound)
