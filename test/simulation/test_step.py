"""A step between two belts: the fall of a plate over the edge, and where parts come to rest."""

import dataclasses
import math

import numpy as np
import pytest
import trimesh
from scipy.integrate import solve_ivp

from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.rotations import rotate
from resting_aspects_ros.simulation.actions import Step
from resting_aspects_ros.simulation.bullet_engine import CLEARANCE, GROUP, MIN_RADIUS, EdgeWorld
from resting_aspects_ros.simulation.job import EDGE_CHECKS_PER_T, STEPS_PER_T, make_job
from resting_aspects_ros.simulation.release import (
    REST_MARGIN,
    InitialState,
)
from resting_aspects_ros.simulation.scene import depth_of
from resting_aspects_ros.simulation.starts import rest_starts
from resting_aspects_ros.simulation.workers import drop_range
from resting_aspects_ros.statistics.poses import DecidedBy, RestStatus

# All parts are at the same place along the edge.
ALONG = 0.0, 0.0
LOW = Step(belt_speed=0.2, step_height=0.02, lower_speed=0.3)


def step_job(part, conditions, step, seed=1, **options):
    aspects = find_aspects(part).aspects
    starts = rest_starts(part, aspects, step, conditions)
    return make_job(part, conditions, seed, starts=starts, **options)


# -- A plate that falls over the edge -------------------------------------------------------------
#
# In a vertical plane, in units of R and T. The plate has the length L and the thickness h, and its
# squared radius of gyration is k2. It lies on a roller with radius r, at the angle th below the
# horizontal; s is the distance along the plate from the contact to its middle. With e along the
# plate and n normal to it, its centre is at s e + (r + h / 2) n from the axis of the roller.


def plate_motion(length, h, r, start, friction, belt):
    """Return th, s, dth/dt, ds/dt where the plate leaves the roller, on which it slips last."""
    k2, b = (length**2 + h**2) / 12, r + h / 2

    def forces(y, sticks):
        """Return d2s/dt2, d2th/dt2, the normal force and the friction along the plate."""
        th, s, w, v = y
        # Friction prevents the slip ds + r dth - belt, or is opposite to it.
        last = [1, r, 0, 0] if sticks else [0, 0, friction, 1]
        left = np.array([[1, b, 0, -1], [0, -s, -1, 0], [0, k2, -s, h / 2], last], dtype=float)
        along = math.sin(th) + s * w**2
        return np.linalg.solve(left, [along, 2 * v * w + b * w**2 - math.cos(th), 0, 0])

    def motion(sticks):
        return lambda _, y: [y[2], y[3], *forces(y, sticks)[1::-1]]

    def slips(_, y):
        return friction * forces(y, True)[2] + forces(y, True)[3]

    def leaves(_, y):
        return forces(y, False)[2]

    slips.terminal = leaves.terminal = True
    slips.direction = leaves.direction = -1
    options = {'rtol': 1e-8, 'atol': 1e-10}
    first = solve_ivp(motion(True), (0, 100), [0, start, 0, belt], events=slips, **options)
    span = (first.t[-1], first.t[-1] + 100)
    second = solve_ivp(motion(False), span, first.y[:, -1], events=leaves, **options)
    return second.y[:, -1]


@pytest.fixture(scope='module')
def plate(solid):
    return solid(trimesh.creation.box((18, 8, 0.5)))


def simulated_plate(job, belt):
    """The rows th, dth/dt and normal force of a plate that moves over the edge."""
    world, top = EdgeWorld(job, ALONG, STEPS_PER_T), job.edge.step_height / job.radius
    centre = [0, 0, top + job.min_height + REST_MARGIN]
    state = (centre, (0, 0, 0, 1), (belt, 0, 0), (0, 0, 0))
    start = InitialState(*(np.array([v], dtype=float) for v in state), elapsed=np.zeros(1))
    (body,) = world._add(start)
    rows, angle = [], 0.0
    while angle < 1.3:
        world._advance_renewed(1)
        now = world._states([body], np.zeros(1, dtype=int))
        along = rotate(now.orientation, np.array([1.0, 0, 0]))[0]
        angle = math.atan2(-along[2], along[0])
        normal = sum(contact[9] for contact in world._bullet.getContactPoints(body))
        rows.append((angle, now.spin[0, 1], normal))
        # It stays in its plane, although Bullet finds only one contact with the belt in a step.
        assert abs(now.spin[0, [0, 2]]).max() < 0.05
    return np.array(rows).T


@pytest.mark.parametrize(('friction', 'belt', 'radius'), [(0.5, 0.1, 0.0), (0.3, 0.3, 0.1)])
def test_plate_falls_over_the_edge_as_computed(plate, mat, friction, belt, radius):
    still = mat.changed(friction=friction, restitution=0.0, rolling_friction=0.0)
    size = plate.hull_radius
    speed = belt * math.sqrt(size * still.gravity)
    job = step_job(plate, still, Step(speed, 4 * size, edge_radius=radius * size))
    angle, spin, normal = simulated_plate(job, belt)

    # Bullet's hulls have a margin, which makes the plate thicker.
    length, h = 18e-3 / size, 0.5e-3 / size + 2 * REST_MARGIN
    r = max(radius, MIN_RADIUS)
    expected = plate_motion(length, h, r, r, friction, belt)
    # The last of the contact forces are small, so that the angle is less certain than the spin.
    assert angle[normal > 0][-1] == pytest.approx(expected[0], rel=0.06)
    assert spin[-1] == pytest.approx(expected[2], rel=0.01)


# -- Parts that fall from a belt ------------------------------------------------------------------


@pytest.mark.slow
def test_subsets_of_drops_are_bit_identical(part, mat, assert_same_poses):
    job = step_job(part('box_10x20x30'), mat, LOW)
    whole = drop_range(job, GROUP - 6, GROUP + 2)
    assert_same_poses(drop_range(job, GROUP - 1, GROUP + 1), whole.between(GROUP - 1, GROUP + 1))


@pytest.mark.slow
def test_parts_start_in_their_aspects_with_the_speed_of_the_belt(part, mat):
    shape = part('u_bracket')
    aspects = find_aspects(shape)
    starts = step_job(shape, mat, LOW).starts
    states = starts.states(np.arange(GROUP), np.random.default_rng(1))
    rows = np.arange(GROUP) % len(aspects)
    np.testing.assert_array_equal(aspects.classify(states.orientation), rows + 1)
    np.testing.assert_array_equal(states.velocity, np.tile([0.2, 0, 0], (GROUP, 1)))
    heights = 0.02 + np.array([aspect.com_height for aspect in aspects])[rows]
    np.testing.assert_allclose(states.position[:, 2], heights, atol=1e-3 * shape.hull_radius)
    # On its back it tips when its middle is beyond the edge; on its legs, whose middle is in the
    # air, when the first leg is.
    front = states.position[:, 0] / shape.hull_radius
    assert (front < 0).all()
    assert {aspect.id for aspect in aspects} > {*(rows[front < -0.1] + 1)} != set()


def stays_at_edge(job, poses):
    """Which parts ended at the edge, without a simulation of the belt below."""
    unsettled = poses.status == RestStatus.UNSETTLED
    return unsettled & (poses.time_to_rest < 100 * job.time_unit)


@pytest.mark.slow
def test_part_that_hooks_over_the_edge_is_unsettled(part, mat):
    # An L bracket that stands on its long leg can hook over a low step; its hull cannot.
    shape, n = part('l_bracket'), 10
    step = dataclasses.replace(LOW, lower_speed=0.0)
    starts = rest_starts(shape, find_aspects(shape).aspects[3:4], step, mat)
    job = make_job(shape, mat, 1, starts=starts)
    poses = drop_range(job, 0, n)
    stays = stays_at_edge(job, poses)
    assert 0 < stays.sum() < n
    # 20 T, 4 R of belt, the fall.
    fall = math.sqrt(2 * job.edge.step_height / job.radius)
    limit = (20 + 4 * job.radius / job.time_unit / 0.2 + fall) * job.time_unit
    assert poses.time_to_rest[stays] == pytest.approx(limit, abs=job.time_unit)
    hull = rotate(job.axes, job.hull) * job.radius
    convex = dataclasses.replace(job, starts=dataclasses.replace(starts, pieces=(hull,)))
    assert not stays_at_edge(convex, drop_range(convex, 0, n)).any()


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize('height', [0.05, 20.0])  # the second falls for longer than 20 T
def test_part_that_falls_from_the_edge_keeps_its_energy_until_it_lands(part, mat, height):
    job = step_job(part('box_10x20x30'), mat, dataclasses.replace(LOW, step_height=height))
    top = height / job.radius + 1.0
    state = ([2.0, 0, top], (0, 0, 0, 1), (0, 0, 0), (0, 0, 0))
    at = InitialState(*(np.array([v], dtype=float) for v in state), elapsed=np.zeros(1))
    status = np.full(1, RestStatus.UNSETTLED, dtype=np.uint8)
    assert not len(
        EdgeWorld(job, ALONG, STEPS_PER_T).pass_over(at, status, np.arange(1), landed=False)
    )
    assert status[0] == RestStatus.SETTLED
    # Bullet's velocity is that half a time step earlier, here of the steps of first impacts.
    velocity = at.velocity[0] + job.scene.down / job.steps_per_t / 2
    energy = velocity @ velocity / 2 + at.position[0, 2]
    assert energy == pytest.approx(top, abs=1 / STEPS_PER_T**2)  # of the second order in the step
    gap = at.position[0, 2] - depth_of(at.orientation, job.hull)[0]
    assert 0 < gap < CLEARANCE - at.velocity[0, 2] / EDGE_CHECKS_PER_T


@pytest.mark.slow
def test_energy_decides_only_far_from_the_wall(part, mat):
    shape = part('box_10x20x30')
    far = step_job(shape, mat, dataclasses.replace(LOW, lower_speed=1.0))
    assert (drop_range(far, 0, 6).decided_by == DecidedBy.ENERGY).all()
    # The belt moves backwards, so that parts come to rest against the wall, which pushes them.
    near = drop_range(step_job(shape, mat, dataclasses.replace(LOW, lower_speed=-0.2)), 0, 6)
    assert (near.decided_by == DecidedBy.STILLNESS).any()
    assert (near.status == RestStatus.SETTLED).all()


# -- Refused values -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ('values', 'says'),
    [
        ({'edge_radius': 0.03}, 'invalid edge radius 0.03: expected at most the step height'),
        ({'belt_speed': 0.001}, 'invalid belt speed 0.001 m/s: expected at'),
    ],
)
def test_step_out_of_bounds_of_a_part_or_surface_is_refused(part, mat, values, says):
    with pytest.raises(InvalidValueError, match=says):
        step_job(part('box_10x20x30'), mat, dataclasses.replace(LOW, **values))
