"""Round trips between the types of the suite and ROS messages, through real CDR."""

import dataclasses
import math
import re

import numpy as np
import pytest
from scipy.stats import binomtest
from wire import over_the_wire

from resting_aspects_ros.api.conditions import surroundings
from resting_aspects_ros.aspects.estimate import RestingShape, estimate
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.ros import conversions
from resting_aspects_ros.ros.distribution_conversions import (
    distribution_from,
    distribution_msg,
    estimate_msg,
    probability_of,
)
from resting_aspects_ros.simulation.conditions import MAX_SEED, DropConditions, HeightOf
from resting_aspects_ros.simulation.job import RunDescription
from resting_aspects_ros.statistics.distribution import Distribution
from resting_aspects_ros.statistics.model_range import Draws, with_model_range
from resting_aspects_ros.statistics.poses import DecidedBy, RestStatus
from resting_aspects_ros.statistics.poses import RestingPoses as Poses

# Each field has a distinct value, so that swapped fields are detected.
CONDITIONS = DropConditions(
    height=0.11,
    restitution=0.12,
    friction=0.13,
    rolling_friction=0.014,
    spinning_friction=0.15,
    gravity=0.16,
    speed_horizontal=0.17,
    speed_vertical=0.18,
    spin=0.19,
    height_of=HeightOf.CENTRE_OF_MASS,
    surface='felt',
    surroundings=surroundings('l_chute', roll=0.7, belt={'speed': 0.2}),
)
RUN = RunDescription(
    *('4f1c', 'l_bracket', 'ab' * 32, CONDITIONS),
    *(MAX_SEED, 3, 2_000_000, 0.01),
    *('bullet', '3.2.7', '0.9.1', 1e-4, 1_795_233_147_000_000_023),
)
POSES = Poses(
    first_drop=2**40,
    position=np.arange(1.0, 16.0).reshape(5, 3) / 10,
    orientation=np.tile([0.1, -0.3, 0.5, 0.65**0.5], (5, 1)),
    status=np.array(list(RestStatus), dtype=np.uint8),
    decided_by=np.array([DecidedBy.ENERGY, *[DecidedBy.STILLNESS] * 4], dtype=np.uint8),
    time_to_rest=np.array([0.7, 1.9, math.nan, 0.3, 2.0]),
    energy_growth=np.array([0.0, 0.02, 0.4, 0.01, 0.03]),
)


def test_run_description_round_trip():
    message = over_the_wire(conversions.run_msg(RUN))
    assert (message.started.sec, message.started.nanosec) == (1_795_233_147, 23)
    assert conversions.run_from(message) == RUN


def test_poses_round_trip(assert_same_poses):
    stamp = conversions.time_msg(17)
    (message,) = conversions.poses_msgs(POSES, RUN, stamp, last=True)
    message = over_the_wire(message)
    assert (message.last, message.header.stamp, message.header.frame_id) == (True, stamp, 'tray')
    assert message.run == conversions.run_msg(RUN)
    assert_same_poses(conversions.poses_from(message), POSES)


@pytest.mark.parametrize('count', [0, 2 * conversions.MAX_POSES + 1])
def test_many_poses_are_several_messages(assert_same_poses, count):
    codes, values = np.zeros(count, dtype=np.uint8), np.arange(count, dtype=float)
    orientation = np.tile([0.0, 0.0, 0.0, 1.0], (count, 1))
    poses = Poses(7, np.zeros((count, 3)), orientation, codes, codes, values, values)
    messages = conversions.poses_msgs(poses, RUN, conversions.time_msg(0), last=True)
    assert len(messages) == max(1, -(-count // conversions.MAX_POSES))
    assert [each.last for each in messages] == [False] * (len(messages) - 1) + [True]
    found = Poses.join([conversions.poses_from(over_the_wire(each)) for each in messages])
    assert_same_poses(found, poses)


@pytest.mark.parametrize(
    ('field', 'change', 'expected'),
    [
        ('position', lambda found: found.append(0), 'invalid number of values'),
        ('orientation', lambda found: found.__setitem__(3, 1.01), 'of drop 1099511627776'),
        ('position', lambda found: found.__setitem__(2, math.inf), 'invalid position'),
        ('status', lambda found: found.__setitem__(0, 77), 'invalid status 77 of drop 10995'),
    ],
)
def test_invalid_poses_are_rejected(field, change, expected):
    (message,) = conversions.poses_msgs(POSES, RUN, conversions.time_msg(0), last=True)
    message.status[0] = RestStatus.SETTLED
    change(getattr(message, field))
    with pytest.raises(InvalidValueError, match=re.escape(expected)):
        conversions.poses_from(message)


@pytest.mark.parametrize(
    ('field', 'value'),
    [
        ('run_id', '../../tmp/evil'),
        ('part', '../../etc/x'),
        ('drops', 0),
        ('first_drop', MAX_SEED),
    ],
)
def test_invalid_run_description_is_rejected(field, value):
    message = conversions.run_msg(RUN)
    setattr(message, field, value)
    with pytest.raises(InvalidValueError, match=': expected '):
        conversions.run_from(message)


@pytest.mark.parametrize(
    ('field', 'value', 'expected'),
    [
        ('confidence', 7.0, 'invalid confidence 7.0: expected'),
        ('failed', 1, 'expected 1010 drops in aspects numbered from 1'),
        ('aspects', [], '0 drops in aspects []'),
    ],
)
def test_inconsistent_distribution_is_rejected(part, field, value, expected):
    aspects = find_aspects(part('tetrahedron'))
    counted = Distribution(aspects, np.array([1010, 0, 0, 0]), 0, 0, 0)
    message = distribution_msg(counted, RUN, conversions.time_msg(0), complete=True)
    setattr(message, field, value)
    with pytest.raises(InvalidValueError, match=re.escape(expected)):
        distribution_from(message)


def test_part_round_trip(part):
    original = part('l_bracket')
    message = over_the_wire(conversions.part_msg(original))
    again = conversions.part_from(message)
    assert again.part_sha256 == original.part_sha256 == message.part_sha256
    for name in ('centre_of_mass', 'inertia', 'hull_vertices'):
        np.testing.assert_array_equal(getattr(again, name), getattr(original, name))
    (ixx, ixy, ixz), (_, iyy, iyz), (_, _, izz) = original.inertia.tolist()
    sent = [getattr(message.inertia, name) for name in conversions.INERTIA]
    assert sent == [ixx, ixy, ixz, iyy, iyz, izz]


def test_distribution_round_trip(part):
    aspects = find_aspects(part('l_bracket'))
    counts = np.arange(10, 10 + len(aspects))
    without = Distribution(
        aspects, counts, unclassified=1, unsettled=2, failed=3, lost=4, sliding=5
    )
    draws = Draws(np.tile(np.arange(len(aspects) + 1), (8, 9)), ('friction',))
    original = with_model_range(without, draws)
    stamp = conversions.time_msg(17)
    message = over_the_wire(distribution_msg(original, RUN, stamp, complete=True))
    assert (message.header.stamp, message.header.frame_id) == (stamp, 'tray')
    assert (message.complete, message.drops) == (True, counts.sum() + 15)
    assert message.run == conversions.run_msg(RUN)
    again = distribution_from(message)
    assert again.model.uncertain == ('friction',)
    np.testing.assert_array_equal(again.model.by_aspect, original.model.by_aspect)
    np.testing.assert_array_equal(again.model.by_class, original.model.by_class)
    message = over_the_wire(distribution_msg(without, RUN, stamp, complete=True))
    assert distribution_from(message).model is None
    assert again.counts.tolist() == counts.tolist()
    assert (again.unclassified, again.unsettled, again.failed) == (1, 2, 3)
    assert (again.lost, again.sliding, again.contacts) == (4, 5, None)
    for one, other in zip(again.aspects, aspects, strict=True):
        for field in dataclasses.fields(other):
            expected = getattr(other, field.name)
            if field.name == 'support':  # a geometry_msgs/Polygon: float32
                expected = expected.astype(np.float32)
            np.testing.assert_array_equal(getattr(one, field.name), expected)


def test_probability_of_several_aspects(part):
    shape = part('l_bracket')
    aspects = find_aspects(shape)
    counted = Distribution(aspects, np.array([70, 60, 50, 40, 30]), 0, 0, 0)
    run = dataclasses.replace(RUN, precision=0.0)
    found = distribution_msg(counted, run, conversions.time_msg(1), complete=True)
    share = probability_of(found, [1, 4, 4])
    of_sum = binomtest(110, 250)
    wilson = of_sum.proportion_ci(method='wilson')
    expected = pytest.approx((of_sum.statistic, wilson.low, wilson.high), abs=1e-12)
    assert (share.probability, share.lower, share.upper) == expected
    prediction = estimate(RestingShape(shape, aspects), 'rolling')
    predicted = estimate_msg(prediction, shape, conversions.time_msg(1))
    share = probability_of(predicted, (4, 1))
    assert share.probability == pytest.approx(prediction.probabilities[[0, 3]].sum())
    with pytest.raises(InvalidValueError, match='invalid aspect 6: expected 1 to 5'):
        probability_of(predicted, [1, 6])
