"""What the controller of a feeder knows: the model of the forecast, and the value of each part."""

import dataclasses
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from resting_aspects_ros.core.errors import InvalidValueError, shown
from resting_aspects_ros.core.feeding.cycle import MAX_TIME, CycleTimes
from resting_aspects_ros.core.feeding.density import FreeShares, free_shares
from resting_aspects_ros.core.feeding.forecast import forecast
from resting_aspects_ros.core.feeding.model import FeederModel, SteadyStates, check_number
from resting_aspects_ros.core.feeding.steady_state import Moves, moves_of
from resting_aspects_ros.core.reorientation.markov import Mask
from resting_aspects_ros.core.statistics.intervals import Array

DEFAULT_MIN_SCORE = 0.5


@dataclass(frozen=True, eq=False)
class PartValues:
    """What a part is worth in the long run, in picks, if the feeder runs as in the forecast.

    The values solve Poisson's equation of a place on the tray, in which a pick counts 1 and each
    second costs the long-run rate. They are those at the next image, relative to the mean.

    rate : float
        Long-run rate, picks per second.
    mix : (k,) float
        Shares of the classes in an image.
    part : (k,) float
        Value of a part of each class that is not picked.
    place : float
        Value of a place without a part, which a dropped part will take.
    """

    rate: float
    mix: Array
    part: Array
    place: float


@dataclass(frozen=True, eq=False)
class ControllerModel:
    """Everything that a decision depends on, over k symmetry classes; class c has index c - 1.

    feeder : FeederModel
        Drops, flips, pickable classes, tray with the clearance, times, and maximum of picks. A
        flip is the action of its transitions.
    table : FreeShares
        The share of free parts for each number of parts on the tray.
    best_number : int
        Number of parts up to which the tray is refilled.
    spread : float or None
        Time of a vibration that moves the parts to new places but does not turn them over, s;
        None: the feeder has none.
    max_supply : int or None
        Maximum number of parts that can be supplied at once; 0: none is left; None: no limit.
    min_score : float
        Minimum score of a part that is picked.
    """

    feeder: FeederModel
    table: FreeShares
    best_number: int
    spread: float | None = None
    max_supply: int | None = None
    min_score: float = DEFAULT_MIN_SCORE

    def __post_init__(self) -> None:
        check_number('best number of parts', self.best_number)
        if self.best_number > len(self.table.free):
            raise InvalidValueError(
                f'invalid best number of parts {self.best_number}: expected at most '
                f'{len(self.table.free)}'
            )
        if self.spread is not None and not 0 <= self.spread <= MAX_TIME:
            raise InvalidValueError(
                f'invalid spread time {shown(self.spread)} s: expected 0 to {MAX_TIME:g} s'
            )
        if self.max_supply is not None and self.max_supply < 0:
            raise InvalidValueError(
                f'invalid maximum supply {shown(self.max_supply)}: expected 0 or more'
            )
        if not 0 <= self.min_score <= 1:
            raise InvalidValueError(
                f'invalid minimum score {shown(self.min_score)}: expected 0 to 1'
            )

    @property
    def times(self) -> CycleTimes:
        """Times of a cycle."""
        return self.feeder.times

    @cached_property
    def moves(self) -> Moves:
        """Shares of the drops and of the flips."""
        return moves_of(self.feeder.drop, self.feeder.transitions)

    @cached_property
    def trapped(self) -> Mask:
        """Classes (k,) from which flips bring no part into a pickable one."""
        return SteadyStates(self.feeder).trapped

    @cached_property
    def values(self) -> PartValues:
        """Values of the parts with the best number of parts on the tray.

        Parts in trapped classes have the value of an empty place: it is assumed that a person
        removes them. Otherwise the long-run rate would be 0, and nothing would have a value.
        """
        feeder = self._without_traps()
        states = SteadyStates(feeder)
        number, times = self.best_number, self.times
        state = states.at(self.table, number)
        rate = float(states.rates(self.table)[number - 1]) / 60
        if not rate > 0:
            return PartValues(0.0, state.mix, np.zeros_like(state.mix), 0.0)
        moves = moves_of(feeder.drop, feeder.transitions)
        taken = state.taken
        supply = rate * times.supply
        pick = taken * (1 - rate * times.robot - supply)
        expected = pick - (1 - taken) * moves.left * supply
        stay = moves.transitions + np.outer(moves.left, moves.drop)
        chain = np.outer(taken, moves.drop) + (1 - taken)[:, None] * stay
        mean = state.mix @ expected
        h = np.linalg.solve(np.eye(len(chain)) - chain + state.mix, expected - mean)
        place = float(moves.drop @ h) - supply
        return PartValues(rate, state.mix, moves.transitions @ h + moves.left * place, place)

    def free(self, number: Array) -> Array:
        """Return the shares of free parts (..., k), interpolated, with numbers of parts (...)."""
        return self.table.between(number)

    def _without_traps(self) -> FeederModel:
        if not self.trapped.any():
            return self.feeder
        counts = np.column_stack([self.feeder.transitions, np.zeros_like(self.feeder.drop)])
        counts[self.trapped] = 0
        counts[self.trapped, -1] = 1
        return dataclasses.replace(self.feeder, transitions=counts)


def controller_model(
    feeder: FeederModel,
    *,
    spread: float | None = None,
    max_supply: int | None = None,
    min_score: float = DEFAULT_MIN_SCORE,
    number: int | None = None,
    seed: int = 1,
) -> ControllerModel:
    """Return the model of a controller, with the best number of parts of the forecast.

    It takes about a second. ``number`` replaces the best number. Raises InvalidValueError as
    `forecast`.
    """
    found = forecast(feeder, number, seed=seed)
    table = free_shares(feeder.tray, feeder.footprints, found.state.mix, seed, found.number)
    best = min(found.number, len(table.free))
    return ControllerModel(feeder, table, best, spread, max_supply, min_score)
