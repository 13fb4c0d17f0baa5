"""Which aspect a direction or a pose is in, on flat and on curved sides."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from solids import directions

from resting_aspects_ros.aspects.aspect_set import Sweep, unit_orientation
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.rotations import (
    orientation_with_down,
    random_orientations,
)


def around(azimuth, tilt=0.0):
    """Directions square to z, tilted out of that plane, degrees."""
    a, t = np.radians(azimuth), np.radians(tilt)
    z = np.full_like(a, np.sin(t))
    return np.stack([np.cos(a) * np.cos(t), np.sin(a) * np.cos(t), z], axis=1)


def classified(aspects, down):
    return aspects.classify(np.array([orientation_with_down(d) for d in down]))


@pytest.mark.slow
@pytest.mark.parametrize(('profile', 'n', 'rise'), [
    ([(10, -10), (10, 10)], 16, 0.0), ([(10, 0), (0, 20)], 64, np.degrees(np.arctan2(10, 20))),
])  # fmt: skip
def test_cylinder_or_cone_on_its_side_is_in_its_ring_at_any_roll(solids, solid, profile, n, rise):
    turn = solids.a_turn(1)
    aspects = find_aspects(solid(solids.turned(solids.revolved(profile, n), turn)))
    (ring,) = (a for a in aspects if a.rolls)
    assert ring.sweep is Sweep.RING
    assert abs(ring.axis @ turn[:, 2]) == pytest.approx(1, abs=1e-6)  # float32
    for tilt, inside in ((0, True), (2.9, True), (-2.9, True), (3.2, False)):
        down = around(np.arange(0, 360, 0.7), rise + tilt) @ turn.T
        assert (classified(aspects, down) == (ring.id if inside else 0)).all()


@pytest.mark.slow
def test_an_arc_ends_where_the_curved_side_does(solids, solid):
    aspects = find_aspects(solid(solids.d_shaft(64, 8)))
    (arc,) = (a for a in aspects if a.sweep is Sweep.ARC)
    (flat,) = (a for a in aspects if a.down_in_part[1] > 0.99)
    opening = 90 - np.degrees(np.arccos(0.8))  # of the flat's edges
    last = opening - 360 / 64  # the flat's edge is in the middle of the last step
    inner = around(np.arange(last - 360, 0, 0.5) + 180 - last)
    inner = inner[inner[:, 1] < np.sin(np.radians(last))]
    assert (classified(aspects, inner) == arc.id).all()
    assert classified(aspects, around(np.array([90.0, 92.5, 87.5]))).tolist() == [flat.id] * 3
    assert classified(aspects, around(np.array([75.0, 105.0]))).tolist() == [0, 0]


def test_every_direction_is_in_the_one_aspect_of_a_sphere(solids, solid):
    aspects = find_aspects(solid(solids.icosphere(1)))
    assert [a.sweep for a in aspects] == [Sweep.SPHERE]
    poses = random_orientations(np.random.default_rng(1), 20_000)
    assert (aspects.classify(poses) == 1).all()


@pytest.mark.slow
def test_the_poles_of_an_ellipsoid_are_domes(solids, solid):
    aspects = find_aspects(solid(solids.ellipsoid(14, 10, 7, 3)))
    assert [a.sweep for a in aspects] == [Sweep.DOME] * 2
    for aspect in aspects:
        assert abs(aspect.axis[2]) == pytest.approx(1, abs=0.01)
        assert classified(aspects, aspect.axis[None]).tolist() == [aspect.id]
        assert (classified(aspects, aspect.directions) == aspect.id).all()


def test_angles_are_to_the_nearest_direction_or_arc(solids, solid):
    aspects = find_aspects(solid(solids.prism(64)))
    down = directions(5, 5000)
    ids, angle = aspects.locate(down)
    ring = np.abs(np.arcsin(down[:, 2]))
    end = np.arccos(np.abs(down[:, 2]))
    nearest = np.minimum(ring, end)
    # The arc between flats 5.6 degrees apart is the circle itself; the nearest is sought by flats.
    clear = np.abs(ring - end) > 0.01
    np.testing.assert_allclose(angle[clear], nearest[clear], atol=1e-5)  # float32
    (rolling,) = (a.id for a in aspects if a.rolls)
    np.testing.assert_array_equal((ids == rolling)[clear], (ring < end)[clear])


@pytest.mark.slow
def test_flats_beside_a_flat_side_are_in_its_aspect_but_no_rest(solids, solid):
    """On the flats of a fillet only the mesh stops a part."""
    aspects = find_aspects(solid(solids.filleted_box((20, 20, 20), 8, 8)))
    assert [a.level for a in aspects] == [1] * 6
    beside = np.concatenate([a.directions[a.level :] for a in aspects])
    ids = np.concatenate([[a.id] * (len(a.directions) - a.level) for a in aspects])
    assert len(beside) > 0
    np.testing.assert_array_equal(classified(aspects, beside), ids)
    assert not classified(aspects.at_rest(), beside).any()
    rests = np.array([a.down_in_part for a in aspects])
    assert classified(aspects.at_rest(), rests).tolist() == [1, 2, 3, 4, 5, 6]


# -- One pose: which quaternions are orientations, and which aspect is nearest --------------------


# Half of its numbers negative, so that no order and no sign passes for another.
UNIT = np.array([0.1, -0.7, 0.5, -0.5])


@given(st.floats(-1e-3 + 1e-12, 1e-3 - 1e-12))
def test_quaternion_of_nearly_unit_length_is_normalized(off):
    unit = unit_orientation(UNIT * (1 + off))
    np.testing.assert_allclose(unit, -UNIT, rtol=0, atol=1e-15)


@pytest.mark.parametrize('wrong', [UNIT * 1.0011, np.zeros(4), [np.nan, 0, 0, 1]])
def test_error_for_quaternion_of_another_norm(wrong):
    with pytest.raises(InvalidValueError, match=r'of norm .*: expected .* 1 within'):
        unit_orientation(wrong)
