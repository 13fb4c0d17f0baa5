"""Discrete-event simulation of a feeder and a robot with SimPy: outside truth of the forecast."""

import numpy as np
import numpy.typing as npt
import simpy

from resting_aspects_ros.feeding.steady_state import CycleTimes, Moves

Array = npt.NDArray[np.float64]


def simulated_picks(
    moves: Moves,
    free: Array,
    number: int,
    times: CycleTimes,
    max_picks: int | None,
    seconds: float,
    seed: int,
) -> Array:
    """Simulate feeder and robot as processes; returns the times of all picks, s.

    ``free`` is the probability that a part of each aspect can be picked. The tray is full of
    dropped parts at the start.
    """
    generator = np.random.default_rng(seed)
    tray = generator.choice(len(free), size=number, p=moves.drop)
    moved = np.column_stack([moves.transitions, moves.left])
    env = simpy.Environment()
    robot = simpy.Resource(env)
    found: list[float] = []

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
