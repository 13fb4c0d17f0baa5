"""A sensor with an air jet: confusion of rows, and what it does to efficiency and rate."""

import numpy as np
import pytest

import resting_aspects_ros as ra
from resting_aspects_ros.tracks.description import read_track
from resting_aspects_ros.tracks.rate import pass_traps
from resting_aspects_ros.tracks.sensor import confusion
from resting_aspects_ros.tracks.traps import Sensor


def test_mirror_images_that_no_symmetric_trap_separates_are_told_apart(rows_of):
    known = ra.known_part('l_bracket', dict.fromkeys(range(1, 6), 1.0))
    pair = [
        row for row in rows_of(known.part) if row.yaw.distance == pytest.approx(0.01387, abs=1e-5)
    ]
    assert {row.aspects for row in pair} == {(1,), (2,)}
    matrix = confusion(known, pair, 1e-4, seed=1, views=3)
    np.testing.assert_allclose(matrix.sum(axis=1), 1)
    np.testing.assert_array_equal(matrix[:, :2], np.eye(2))


def test_a_sensor_keeps_what_it_takes_for_a_wanted_row(part, rows_of):
    nut = part('hex_nut')
    rows = rows_of(nut)
    sensor = {'kind': 'sensor', 'spacing': '20mm'}
    track = read_track({'width': 0.04, 'speed': 0.1, 'traps': [sensor]})
    (trap,) = track.traps
    assert trap == Sensor(0.02)
    matrix = np.array([[0.9, 0.1, 0, 0], [0.2, 0.8, 0, 0], [0, 0, 0.5, 0.5]])
    found = pass_traps(nut, rows, track, (1,), confusions={trap: matrix})
    share = found.probability
    assert found.good == pytest.approx((0.9 * share[0],) * 2)
    good, bad = 0.9 * share[0], 0.2 * share[1]
    assert found.purity == pytest.approx((good / (good + bad),) * 2)
    # The jet needs a distance between two parts.
    assert found.arrivals == pytest.approx(60 * 0.1 / (found.mean_length + 0.02))
