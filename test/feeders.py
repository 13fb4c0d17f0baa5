"""Feeders for tests: with SimPy, with places by the density alone, and with a fixed cycle."""

import numpy as np
import simpy

from resting_aspects_ros.feeding.control import Advice, Choice, pickable_parts
from resting_aspects_ros.feeding.tray_simulation import SimulatedTray, simulate


class DensityPlaces:
    """Places by the share of free parts, without positions.

    A part in a new place is free with the probability of the table. If parts are added, some of
    the free ones become blocked. If parts are removed, no other part becomes free, because only
    free parts are picked, which block none.
    """

    def __init__(self, model, generator):
        self._model, self._generator = model, generator
        self._is_free = np.zeros(0, dtype=bool)

    def shake(self, classes):
        self._is_free = self._generator.random(len(classes)) < self._share(len(classes), classes)

    def add(self, classes):
        before, now = len(self._is_free), len(classes)
        old, new = self._share(before, classes), self._share(now, classes)
        chance = np.where(np.arange(now) < before, new / np.maximum(old, 1e-12), new)
        free = np.append(self._is_free, np.ones(now - before, dtype=bool))
        self._is_free = free & (self._generator.random(now) < chance)

    def keep(self, which):
        self._is_free = self._is_free[which]

    def clearance(self):
        return np.where(self._is_free, self._model.feeder.tray.clearance, -1.0)

    def _share(self, number, classes):
        return self._model.table.between(np.array(float(number)))[classes]


def density_run(controller, model, seconds, generator, moves=None):
    """Simulate a run on a tray with DensityPlaces; return the times of its picks and its end."""
    tray = SimulatedTray(model, DensityPlaces(model, generator), generator)
    if moves is not None:
        tray.use(moves)
    return simulate(controller, model, seconds, tray)


def fixed_cycle(model):
    """Return the controller that flips and refills after each image: the cycle of the forecast."""

    def decide(seen):
        chosen = pickable_parts(seen, model)
        left = len(seen) - len(chosen)
        supply = max(model.best_number - left, 0)
        action = Choice.FLIP if left else Choice.SUPPLY
        if chosen:
            return Advice(Choice.PICK, chosen, action, supply, {}, '')
        return Advice(action, (), None, supply, {}, '')

    return decide


def simulated_picks(moves, free, number, times, max_picks, seconds, seed):
    """Simulate feeder and robot as processes of SimPy; return the times of all picks, s.

    ``free`` (k,) is the probability that a part of each aspect can be picked. The tray is full of
    dropped parts at the start.
    """
    generator = np.random.default_rng(seed)
    tray = generator.choice(len(free), size=number, p=moves.drop)
    moved = np.column_stack([moves.transitions, moves.left])
    env = simpy.Environment()
    robot = simpy.Resource(env)
    found = []

    def place():
        with robot.request() as ready:
            yield ready
            yield env.timeout(times.place)

    def feeder():
        nonlocal tray
        while True:
            yield env.timeout(times.vibrate)
            yield env.timeout(times.settle + times.image)
            seen = np.flatnonzero(generator.random(number) < free[tray])
            seen = generator.permutation(seen)[:max_picks]
            with robot.request() as ready:
                yield ready
            for k in range(len(seen)):
                last = k == len(seen) - 1
                yield env.timeout(times.robot - times.place * last)
                found.append(env.now)
            if len(seen) and times.place:
                env.process(place())
            picked = np.zeros(number, dtype=bool)
            picked[seen] = True
            state = np.array([generator.choice(len(free) + 1, p=row) for row in moved[tray]])
            new = picked | (state == len(free))
            state[new] = generator.choice(len(free), size=new.sum(), p=moves.drop)
            tray = state
            yield env.timeout(times.supply * new.sum())

    env.process(feeder())
    env.run(until=seconds)
    return np.array(found)
