"""A virtual feeder: its time, its picks by place, and its moves."""

import numpy as np
import pytest

from resting_aspects_ros.feeding.control import Choice, ControllerModel
from resting_aspects_ros.feeding.footprint import Footprint, FreeShares, Tray
from resting_aspects_ros.feeding.forecast import FeederModel
from resting_aspects_ros.feeding.steady_state import CycleTimes
from resting_aspects_ros.feeding.tray_simulation import REACH, VirtualFeeder

TIMES = CycleTimes(robot=1.0, vibrate=0.5, settle=0.25, image=0.125, supply=0.0625)


class Row:
    """Places in a row, 20 mm apart."""

    def __init__(self):
        self.centres = np.zeros((0, 2))

    def shake(self, classes):
        self.centres = self.centres[:0]
        self.add(classes)

    def add(self, classes):
        first = len(self.centres)
        new = [[0.02 * k, 0.0] for k in range(first, len(classes))]
        self.centres = np.vstack([self.centres, np.reshape(new, (-1, 2))])

    def keep(self, which):
        self.centres = self.centres[which]


@pytest.fixture
def feeder():
    """A feeder whose drops are all of class 1, and whose flips lead to class 2."""

    def make(place=0.0):
        model = FeederModel(
            np.array([9, 0]),
            np.array([[0, 9], [0, 9]]),
            np.array([True, False]),
            (Footprint(0.01, 0.01),) * 2,
            Tray((0.2, 0.2), 0.0),
            CycleTimes(**{**vars(TIMES), 'place': place}),
        )
        table = FreeShares(np.ones((12, 2)), False)
        known = ControllerModel(model, table, 4, spread=0.375)
        return VirtualFeeder(known, Row(), np.random.default_rng(1))

    return make


def test_each_step_takes_the_time_of_the_machine(feeder):
    cell = feeder()
    steps = [
        (lambda: cell.move(Choice.SUPPLY, 4), 0.25 + 4 * 0.0625),
        (cell.take_image, 0.125),
        (lambda: cell.pick(0.0, 0.0, 1), 1.0),
        (lambda: cell.move(Choice.FLIP, 1), 0.5 + 0.25 + 0.0625),
        (lambda: cell.move(Choice.SPREAD), 0.375 + 0.25),
        (lambda: cell.move(Choice.WAIT), 1.0),
    ]
    for step, seconds in steps:
        before = cell.seconds
        step()
        assert cell.seconds - before == pytest.approx(seconds)
    assert cell.supplied == 5
    # What was flipped is in class 2, and what was supplied after that in class 1.
    assert sorted(cell.tray.classes) == [0, 1, 1, 1]


@pytest.mark.parametrize('place', [0.25, 1.0])
def test_feeder_works_while_the_robot_places(feeder, place):
    cell = feeder(place)
    cell.move(Choice.SUPPLY, 4)
    begin = cell.seconds
    assert cell.pick(0.0, 0.0, 1)
    assert cell.seconds == begin + 1.0 - place  # the part has left the tray
    cell.move(Choice.FLIP)
    cell.take_image()
    assert cell.seconds == begin + 1.0 - place + 0.875
    cell.tray.classes[:] = 0
    assert cell.pick(0.02, 0.0, 1)
    # The next pick begins when the robot is back.
    assert cell.seconds == begin + 2.0 + max(0.875 - place, 0.0) - place


def test_part_is_found_by_its_place_and_class(feeder):
    cell = feeder()
    assert not cell.pick(0.0, 0.0, 1)  # an empty tray
    cell.move(Choice.SUPPLY, 3)
    assert not cell.pick(0.02 + 1.1 * REACH, 0.0, 1)
    assert not cell.pick(0.02, 0.0, 2)
    assert len(cell.tray.classes) == 3
    assert cell.pick(0.02, 0.9 * REACH, 1)
    assert not cell.pick(0.02, 0.0, 1)
    assert (cell.picks, len(cell.tray.classes)) == (1, 2)
