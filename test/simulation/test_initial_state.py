"""Initial states of drops, and the time to rest."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from scipy.stats import kstest

from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.rotations import down_in_part, random_orientations
from resting_aspects_ros.simulation.conditions import HeightOf
from resting_aspects_ros.simulation.job import MAX_IMPACT, make_job
from resting_aspects_ros.simulation.release import DropRandom, initial_states
from resting_aspects_ros.simulation.surroundings import Surroundings
from resting_aspects_ros.simulation.surroundings_kinds import Slope
from resting_aspects_ros.simulation.workers import drop_range

# A test of chance fails a right engine for one seed in a thousand; the seeds are fixed.
LEVEL = 1e-3


# -- Releases -------------------------------------------------------------------------------------


def test_speed_and_spin_have_the_declared_deviations(part, mat, assert_deviations):
    thrown = mat.changed(speed_horizontal=0.3, speed_vertical=0.1, spin=7.0)
    job = make_job(part('l_bracket'), thrown, 3)
    n = 20_000
    states = initial_states(job, 0, n)
    velocity, spin = states.velocity * job.radius / job.time_unit, states.spin / job.time_unit
    assert_deviations(velocity, 0, [0.3, 0.3, 0.1])
    assert_deviations(spin, 0, [7, 7, 7])
    together = np.corrcoef(np.hstack([velocity, spin]).T) - np.eye(6)
    assert np.abs(together).max() < 4.5 / math.sqrt(n)


@pytest.mark.parametrize('height_of', HeightOf)
def test_height_refers_to_the_selected_point(part, mat, height_of):
    shape = part('l_bracket')
    # With spin, so that no part of the fall is left out.
    job = make_job(shape, mat.changed(height=0.05, height_of=height_of, spin=1e-3), 3)
    states = initial_states(job, 0, 250)
    if height_of is HeightOf.CENTRE_OF_MASS:
        height = states.position[:, 2]
    else:
        turned = Rotation.from_quat(states.orientation).as_matrix() @ job.hull.T
        height = states.position[:, 2] + turned[:, 2].min(axis=1)
    np.testing.assert_allclose(height * job.radius, 0.05, rtol=1e-12)


def test_initial_orientations_are_uniform(part, mat):
    job = make_job(part('l_bracket'), mat, 3)
    body = Rotation.from_quat(initial_states(job, 0, 20_000).orientation)
    of_part = (body * Rotation.from_quat(job.axes).inv()).as_quat()
    for coordinate in down_in_part(of_part).T:
        assert kstest(coordinate, 'uniform', args=(-1, 2)).pvalue > LEVEL
    # The first numbers of a drop turn it, regardless of the part's axes.
    first = random_orientations(DropRandom(3, 0, 20_000), 20_000)
    np.testing.assert_allclose(np.abs((of_part * first).sum(axis=1)), 1, atol=1e-12)


@given(st.integers(0, 2**64 - 1), st.integers(0, 2**64 - 101), st.integers(0, 90))
def test_numbers_of_a_drop_depend_on_seed_and_index_only(seed, first, offset):
    many, few = (
        (random.random((n, 3)), random.standard_normal((n, 2)))
        for n, random in (
            (100, DropRandom(seed, first, first + 100)),
            (7, DropRandom(seed, first + offset, first + offset + 7)),
        )
    )
    for a, b in zip(many, few, strict=True):
        np.testing.assert_array_equal(a[offset : offset + 7], b[: 100 - offset])


def test_numbers_of_drops_and_seeds_are_independent_and_uniform():
    n = 5000
    each = [DropRandom(seed, 0, n).random((n, 8)) for seed in (3, 4)]
    numbers = np.hstack([*each, np.roll(each[0], 1, axis=0)])
    assert numbers.min() > 0
    assert numbers.max() < 1
    for column in numbers.T:
        assert kstest(column, 'uniform').pvalue > LEVEL
    # Of the 276 correlations, which have a standard error of 1 / sqrt(n), none is that large.
    together = np.corrcoef(numbers.T) - np.eye(24)
    assert np.abs(together).max() < 4.8 / math.sqrt(n)


@pytest.mark.parametrize(
    ('height_of', 'speed', 'angle'),
    [('LOWEST_POINT', 0.2, 0.0), ('CENTRE_OF_MASS', 0.2, 0.0), ('LOWEST_POINT', 0.0, 0.3)],
)
def test_omitted_fall_is_a_free_fall(part, mat, height_of, speed, angle):
    # The same generator without and with a spin too small to matter, which is not shortened.
    thrown = mat.changed(
        height=0.05,
        height_of=HeightOf[height_of],
        speed_horizontal=speed,
        speed_vertical=2 * speed,
        surroundings=Surroundings(Slope(angle)),
    )
    job, n = make_job(part('l_bracket'), thrown, 3), 500
    whole = dataclasses.replace(job, conditions=thrown.changed(spin=1e-12))
    short, full = (initial_states(each, 0, n) for each in (job, whole))
    np.testing.assert_array_equal(short.orientation, full.orientation)
    t, down = short.elapsed[:, None], job.scene.down
    assert (t >= 0).all()
    assert np.count_nonzero(t) > n / 4
    np.testing.assert_allclose(short.velocity, full.velocity + t * down, atol=1e-9)
    np.testing.assert_allclose(
        short.position, full.position + full.velocity * t + t**2 / 2 * down, atol=1e-9
    )


def test_height_below_hull_radius_is_rejected(part, mat):
    low = mat.changed(height=0.01, height_of=HeightOf.CENTRE_OF_MASS)
    with pytest.raises(InvalidValueError, match=r'invalid height of the centre of mass 0\.01 m'):
        make_job(part('l_bracket'), low, 1)


# -- Time -----------------------------------------------------------------------------------------


def test_time_to_rest_includes_the_fall(part, mat):
    job = make_job(part('box_10x20x30'), mat.changed(restitution=0.0), 1)
    fall = math.sqrt(2 * mat.height / mat.gravity)
    # Without bounces it is soon over: one that falls flat takes as long as the fall, and the
    # least steady of the others has tipped over and rocked within some T.
    late = drop_range(job, 0, 2000).time_to_rest - fall
    assert late.min() >= 0
    assert late.max() < 30 * job.time_unit


@pytest.mark.parametrize('changes', [{'spin': 5000.0}, {'gravity': 1e-6, 'spin': 1.0}])
def test_excessive_impact_speed_is_rejected(part, mat, changes):
    shape, conditions = part('l_bracket'), mat.changed(**changes)
    fastest = MAX_IMPACT * math.sqrt(conditions.gravity * shape.hull_radius)
    expected = f'^invalid impact speed .*expected at most {fastest:.4g} m/s for its size and'
    with pytest.raises(InvalidValueError, match=expected):
        make_job(shape, conditions, 1)
