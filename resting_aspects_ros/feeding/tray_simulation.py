"""Simulation of the parts on a tray, for controllers: parts per minute of their runs."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from resting_aspects_ros.arrays import Array, Counts
from resting_aspects_ros.feeding.control import (
    Advice,
    Choice,
    ControllerModel,
    SeenPart,
    advise,
)
from resting_aspects_ros.feeding.forecast import (
    DRAWS,
    RUNS,
    check_minutes,
    drawn_rates,
)
from resting_aspects_ros.feeding.steady_state import (
    Moves,
    cycle_time,
    drawn_moves,
    parts_per_minute,
)
from resting_aspects_ros.statistics.intervals import CONFIDENCE, check_confidence, containing
from resting_aspects_ros.vision.tray_image import OutlinePlaces

Controller = Callable[[Sequence[SeenPart]], Advice]

# -- Tray -----------------------------------------------------------------------------------------


WAITING = 1.0  # s, until a feeder that waits takes the next image


class SimulatedTray:
    """Parts on a tray, each of them with a class and a place."""

    def __init__(
        self, model: ControllerModel, places: OutlinePlaces, generator: np.random.Generator
    ) -> None:
        self._places, self._generator = places, generator
        self.classes: Counts = np.zeros(0, dtype=np.int64)
        self.use(model.feeder.moves)

    def use(self, moves: Moves) -> None:
        """Take other shares of drops and flips of the same part from now on."""
        self._drop = np.cumsum(moves.drop)
        self._flips = np.cumsum(np.column_stack([moves.transitions, moves.left]), axis=1)

    def seen(self) -> list[SeenPart]:
        """Return what an image shows."""
        if not len(self.classes):
            return []
        parts = zip(self.classes.tolist(), self._places.clearance().tolist(), strict=True)
        return [SeenPart(k + 1, clearance) for k, clearance in parts]

    def remove(self, parts: Sequence[int]) -> None:
        """Remove the parts with these indices."""
        keep = np.ones(len(self.classes), dtype=np.bool_)
        keep[list(parts)] = False
        self._places.keep(keep)
        self.classes = self.classes[keep]

    def flip(self) -> None:
        """Flip all parts; some may leave the tray."""
        rows = self._flips[self.classes]
        rolled = self._generator.random(len(rows))[:, None] * rows[:, -1:]
        moved = (rolled >= rows).sum(axis=1)
        self.classes = moved[moved < len(self._drop)]
        self.spread()

    def spread(self) -> None:
        """Give each part a new place."""
        self._places.shake(self.classes)

    def move(self, action: Choice | None, model: ControllerModel) -> float:
        """Let the feeder act on the parts; return the time until they are at rest, s."""
        if action is None:
            return 0.0
        if action is Choice.WAIT:
            return WAITING
        seconds = model.times.settle
        if action is Choice.FLIP:
            self.flip()
            seconds += model.times.vibrate
        elif action is Choice.SPREAD:
            self.spread()
            seconds += model.spread or 0.0
        return seconds

    def supply(self, number: int) -> None:
        """Drop parts to random places."""
        rolled = self._generator.random(number) * self._drop[-1]
        self.classes = np.append(self.classes, np.searchsorted(self._drop, rolled, side='right'))
        self._places.add(self.classes)


def simulate(
    controller: Controller,
    model: ControllerModel,
    seconds: float,
    tray: SimulatedTray,
) -> tuple[Array, float]:
    """Simulate a feeder that obeys a controller, beginning with an empty tray.

    Returns when each pick was over, (picks,) s, and when the run was over, s: with the first image
    after ``seconds``. The times are those of `steady_state.cycle_time` with the model, with an
    image after each advice; the controller and the tray may have other models.
    """
    times = model.times
    clock = 0.0
    done: list[float] = []
    while clock < seconds:
        advice = controller(tray.seen())
        action = advice.then if advice.choice is Choice.PICK else advice.choice
        picks = len(advice.picks)
        done += [clock + k * times.robot for k in range(1, picks + 1)]
        tray.remove(advice.picks)
        busy = times.image + tray.move(action, model)
        tray.supply(advice.supply)
        clock += busy + picks * times.robot - (min(times.place, busy) if picks else 0.0)
        clock += times.supply * advice.supply
    return np.array(done), clock


# -- A feeder -------------------------------------------------------------------------------------


# The robot picks a part if the centroid of its outline is so close to where it was seen, m.
REACH = 2e-3


class VirtualFeeder:
    """A tray of parts, a robot and the clock of both.

    The model has the true shares of drops and flips, and the times. ``seconds`` is the simulated
    time since the beginning, s.
    """

    def __init__(
        self, model: ControllerModel, places: OutlinePlaces, generator: np.random.Generator
    ) -> None:
        self.tray = SimulatedTray(model, places, generator)
        self._places = places
        self._model = model
        self.seconds = self._robot_ready = 0.0
        self.picks = self.supplied = 0

    def use(self, model: ControllerModel) -> None:
        """Take the true moves and the times from another model of the same part from now on."""
        self._model = model
        self.tray.use(model.feeder.moves)

    def take_image(self) -> None:
        """Let the time of an image and its evaluation pass."""
        self.seconds += self._model.times.image

    def pick(self, x: float, y: float, symmetry_class: int) -> bool:
        """Let the robot pick a part; return whether it has.

        It picks the part whose outline has its centroid at (x, y), tray frame, m, if that is of
        the symmetry class for which the robot grasps it. Other than the centre of mass, the
        centroid is the same for all poses with the same outline.
        """
        times = self._model.times
        begin = max(self.seconds, self._robot_ready)
        # The robot then places the part, while the feeder may vibrate.
        self.seconds, self._robot_ready = begin + times.robot - times.place, begin + times.robot
        if not len(self.tray.classes):
            return False
        apart = np.linalg.norm(self._places.centres - (x, y), axis=1)
        nearest = int(apart.argmin())
        is_there = bool(apart[nearest] <= REACH)
        if not is_there or self.tray.classes[nearest] + 1 != symmetry_class:
            return False
        self.tray.remove([nearest])
        self.picks += 1
        return True

    def move(self, action: Choice, supply: int = 0) -> None:
        """Flip, spread or supply parts, or wait; after that, the parts are at rest."""
        self.seconds += self.tray.move(action, self._model)
        self.tray.supply(supply)
        self.supplied += supply
        self.seconds += self._model.times.supply * supply


# -- Runs -----------------------------------------------------------------------------------------


# Simulated runs, and how many cycles of the forecast each lasts if the requested run is longer.
SIMULATED, CYCLES = 32, 60
# Share of a simulated run after which the tray counts as filled and mixed.
WARM_UP = 0.25
# Successive parts of the rest of a run, whose variance is that of its cycles.
BATCHES = 3
# Sum of squares of relative rates below which they count as equal.
SAME = 1e-12


@dataclass(frozen=True, eq=False)
class ControlledRuns:
    """Parts per minute of a feeder with a controller.

    rate, lower, upper : float
        In the long run: the rate if the counts were the probabilities, and the interval that
        follows from the counts and the simulation.
    prediction : (float, float)
        Interval of a run of ``minutes``, which begins with an empty tray.
    minutes : float
    """

    rate: float
    lower: float
    upper: float
    prediction: tuple[float, float]
    minutes: float


def forecast_controller(
    model: ControllerModel,
    places: Callable[[np.random.Generator], OutlinePlaces],
    minutes: float = 60.0,
    *,
    controller: Controller | None = None,
    confidence: float = CONFIDENCE,
    seed: int = 1,
) -> ControlledRuns:
    """Forecast the parts per minute of a run of ``minutes``; takes 5 to 20 s.

    The model is what the controller knows, and the truth up to the uncertainty of its counts.
    ``places`` returns the places of a run for its random generator. By default, `advise` decides.
    Raises InvalidValueError.
    """
    check_confidence(confidence)
    check_minutes(minutes)
    generator = np.random.default_rng(seed)
    decide = controller or partial(advise, model=model)
    runs = _simulated(model, decide, float(minutes), places, generator)
    rate, slope = runs.line
    of_line, of_moves, of_minute = runs.variances(generator)
    off = runs.relative[:, None] - 1
    noise = generator.standard_normal((2, DRAWS, RUNS))
    means = rate + slope * off + np.sqrt(of_line + of_moves) * noise[0]
    ends = of_line + of_moves + of_minute * np.maximum(1 + off, 0.0) / minutes
    found = rate + slope * off + runs.start / minutes + np.sqrt(ends) * noise[1]
    tail = (1 - confidence) / 2
    (lower, upper), (low, high) = (
        np.maximum(np.quantile(each, [tail, 1 - tail]), 0.0).tolist() for each in (means, found)
    )
    at_counts = max(rate + slope * (runs.point - 1), 0.0)
    lower, upper = (float(each) for each in containing(at_counts, lower, upper))
    return ControlledRuns(at_counts, lower, upper, (low, high), float(minutes))


@dataclass(frozen=True, eq=False)
class SimulatedRuns:
    """Simulated runs, each with other true moves.

    relative : (d,) float
        Rate of each draw of the moves by the formula of the fixed cycle, divided by their mean;
        the first ones are those of the runs.
    point : float
        The same of the counts, as if they were the probabilities.
    batches : (r, BATCHES) float
        Picks per minute of each run in successive parts of ``steady`` minutes.
    start : float
        Mean difference of the picks of a run from rate x duration, because the tray is empty.
    """

    relative: Array
    point: float
    batches: Array
    steady: float
    start: float

    @cached_property
    def line(self) -> tuple[float, float]:
        """Rate where the formula gives the mean of the draws, and its change with ``relative``.

        A controller does not depend on the moves as the fixed cycle does.
        """
        rates, off = self.batches.mean(axis=1), self.relative[: len(self.batches)] - 1
        square = ((off - off.mean()) ** 2).sum()
        slope = (off - off.mean()) @ rates / square if square > SAME else 0.0
        return float(rates.mean() - slope * off.mean()), float(slope)

    def variances(self, generator: np.random.Generator) -> tuple[Array, Array, Array]:
        """Return draws (DRAWS, 1) of the variance of the rate that the line leaves, 1/min^2.

        Of the line itself; of the moves; and of a minute of a run, which decreases with its
        length. That of the moves is the difference of two estimates, whose errors have chi square
        distributions; without draws of them it would often be 0.
        """
        number, batches = len(self.batches), self.batches.shape[1]
        mean, slope = self.line
        rest = self.batches.mean(axis=1) - mean - slope * (self.relative[:number] - 1)
        inside = self.batches - self.batches.mean(axis=1, keepdims=True)
        free, free_inside = number - 2, number * (batches - 1)
        whole = (rest**2).sum() / generator.chisquare(free, (DRAWS, 1))
        minute = (inside**2).sum() / generator.chisquare(free_inside, (DRAWS, 1))
        minute *= self.steady / batches
        return whole / number, np.maximum(whole - minute / self.steady, 0.0), minute


def _simulated(
    model: ControllerModel,
    decide: Controller,
    minutes: float,
    places: Callable[[np.random.Generator], OutlinePlaces],
    generator: np.random.Generator,
) -> SimulatedRuns:
    """Simulate runs of at most ``minutes`` whose true moves are drawn from their posterior."""
    feeder, number = model.feeder, model.best_number
    state = feeder.state(model.table, number)
    cycle = float(cycle_time(feeder.times, state.picks, state.supplied)) / 60
    length = min(minutes, CYCLES * cycle)
    drawn = drawn_moves(feeder.drop, feeder.transitions, DRAWS, generator)
    rates = drawn_rates(feeder, drawn, model.table, number)
    ends = 60 * length * np.linspace(WARM_UP, 1, BATCHES + 1)
    counts = []
    for k, each in enumerate(generator.spawn(SIMULATED)):
        tray = SimulatedTray(model, places(each), each)
        tray.use(Moves(drawn.drop[k], drawn.transitions[k], drawn.left[k]))
        picked, _ = simulate(decide, model, 60 * length, tray)
        counts.append(np.searchsorted(picked, ends))
    steady = (1 - WARM_UP) * length
    batches = np.diff(counts, axis=1) / (steady / BATCHES)
    mean = rates.mean()
    at_counts = float(parts_per_minute(feeder.times, state.picks, state.supplied))
    return SimulatedRuns(
        rates / mean if mean > 0 else np.ones(DRAWS),
        at_counts / mean if mean > 0 else 1.0,
        batches,
        steady,
        float(np.array(counts)[:, -1].mean() - batches.mean() * length),
    )
