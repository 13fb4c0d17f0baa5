"""The rows of broken assumptions, against a simulation of single parts on a tray.

The simulation shares no code with the forecast: discs on a rectangle, cycle by cycle.
"""

import math

import numpy as np
import pytest

from resting_aspects_ros.feeding import forecast as forecast_module
from resting_aspects_ros.feeding.footprint import Footprint, Tray, free_shares
from resting_aspects_ros.feeding.forecast import (
    FeederModel,
    broken_assumptions,
    forecast,
    places_rate,
)
from resting_aspects_ros.feeding.steady_state import CycleTimes

SIDE, RADIUS, CLEARANCE, NUMBER = 0.2, 0.009, 0.006, 16
DROP = np.array([600, 300, 100])
TRANSITIONS = np.array([[300, 80, 20], [150, 200, 50], [60, 50, 290]])
PICKABLE = np.array([False, True, True])
TIMES = CycleTimes(robot=1.2, vibrate=0.8, settle=0.5, image=0.2, supply=0.05)
CYCLES = 2000


class Tray2D:
    """Discs on a tray; parts are dictionaries of arrays, and nothing is precomputed."""

    def __init__(self, rng, *, staying=0.0, clumped=0.0, missed=0.0, failed=0.0, overlaps=False):
        self.rng, self.staying, self.clumped = rng, staying, clumped
        self.missed, self.failed, self.overlaps = missed, failed, overlaps
        self.places, self.classes = np.zeros((0, 2)), np.zeros(0, dtype=int)
        self.rows = np.cumsum(TRANSITIONS / TRANSITIONS.sum(axis=1, keepdims=True), axis=1)

    def free_place(self, others, near=None):
        """Return a place for a disc that touches none of the others, perhaps near a point."""
        half = SIDE / 2 - RADIUS
        while True:
            place = self.rng.uniform(-half, half, 2)
            if near is not None:
                turn = self.rng.uniform(0, 2 * math.pi)
                apart = 2 * RADIUS + self.rng.uniform(0, CLEARANCE)
                place = near + apart * np.array([math.cos(turn), math.sin(turn)])
                if np.abs(place).max() > half:
                    continue
            if self.overlaps or not len(others):
                return place
            if (np.linalg.norm(others - place, axis=1) >= 2 * RADIUS).all():
                return place

    def vibrate(self):
        """Flip all parts, and give those that do not stay a new place."""
        rolled = self.rng.random(len(self.classes))
        self.classes = (rolled[:, None] >= self.rows[self.classes]).sum(axis=1)
        stays = self.rng.random(len(self.classes)) < self.staying
        places = self.places[stays]
        for _ in range((~stays).sum()):
            places = np.vstack([places, self.free_place(places)])
        self.classes = np.concatenate([self.classes[stays], self.classes[~stays]])
        self.places = places

    def supply(self, number):
        """Drop parts; the second of a pair in a clump lies near the first."""
        for _ in range(number):
            # Of a pair, both are blocked, so half as many parts are added to others.
            near = None
            if len(self.new) and self.rng.random() < self.clumped / (2 - self.clumped):
                near = self.new.pop()
            place = self.free_place(self.places, near)
            if near is None:
                self.new.append(place)
            self.places = np.vstack([self.places, place])
            self.classes = np.append(self.classes, self.rng.choice(3, p=DROP / DROP.sum()))

    def pick(self):
        """Return the number of picks that succeed, and of those that are tried."""
        apart = np.linalg.norm(self.places[:, None] - self.places[None], axis=2)
        np.fill_diagonal(apart, np.inf)
        free = (apart >= 2 * RADIUS + CLEARANCE).all(axis=1) & PICKABLE[self.classes]
        seen = np.flatnonzero(free & (self.rng.random(len(free)) >= self.missed))
        picked = seen[self.rng.random(len(seen)) >= self.failed]
        keep = np.ones(len(free), dtype=bool)
        keep[picked] = False
        self.places, self.classes = self.places[keep], self.classes[keep]
        return len(picked), len(seen)

    def rate(self):
        """Return parts per minute of CYCLES cycles, and the standard error."""
        picks, seconds = np.zeros(CYCLES), np.zeros(CYCLES)
        for k in range(-50, CYCLES):
            self.vibrate()
            missing, self.new = NUMBER - len(self.classes), []
            self.supply(missing)
            picked, tried = self.pick()
            if k >= 0:
                picks[k] = picked
                seconds[k] = 1.5 + 0.05 * missing + 1.2 * tried
        rate = 60 * picks.sum() / seconds.sum()
        batches = (60 * picks - rate * seconds).reshape(20, -1).sum(axis=1)
        return rate, batches.std(ddof=1) * math.sqrt(20) / seconds.sum()


DISCS = [Footprint(0, 0, RADIUS)] * 3
MODEL = FeederModel(DROP, TRANSITIONS, PICKABLE, DISCS, Tray((SIDE, SIDE), CLEARANCE), TIMES)


@pytest.fixture(scope='module')
def forecasts():
    """The rate of this tray, and its rates with each assumption broken."""
    free, over = (
        free_shares(MODEL.tray, MODEL.footprints, DROP, 1, NUMBER, separated=each).at(NUMBER)
        for each in (True, False)
    )
    return places_rate(MODEL, NUMBER, free), broken_assumptions(MODEL, NUMBER, free, over)


@pytest.mark.slow
@pytest.mark.parametrize(
    ('row', 'broken'),
    [
        (None, {}),
        (0, {'staying': forecast_module.STAYING}),
        (1, {'clumped': forecast_module.CLUMPED}),
        (2, {'missed': forecast_module.MISSED, 'failed': forecast_module.FAILED}),
        (3, {'overlaps': True}),
    ],
)
def test_rate_is_that_of_single_parts_on_a_tray(forecasts, row, broken):
    base, rows = forecasts
    expected = base if row is None else rows[row].rate
    rate, error = Tray2D(np.random.default_rng(1), **broken).rate()
    assert expected == pytest.approx(rate, abs=4 * error + 0.015 * rate)


@pytest.mark.slow
def test_without_a_broken_assumption_the_rate_is_that_of_the_forecast(forecasts):
    found = forecast(MODEL, NUMBER)
    for each in found.broken:
        assert each.rate == pytest.approx(found.rate * (1 + each.change), rel=0.01)
    # The shares of free parts are found with two mixes.
    assert forecasts[0] == pytest.approx(found.rate, rel=0.01)
    low, high = found.wide
    assert low < found.lower
    assert high == found.upper
