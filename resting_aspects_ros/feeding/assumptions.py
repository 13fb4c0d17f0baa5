"""The rate of a feeder if an assumption of the forecast does not hold.

Each assumption that is broken is another chain of the places on the tray, whose long run follows
as that of the forecast does. The shares are examples of what is common, not measurements of a
machine.
"""

from dataclasses import dataclass, replace

import numpy as np

from resting_aspects_ros.arrays import Array
from resting_aspects_ros.feeding.steady_state import (
    CycleTimes,
    Moves,
    SteadyState,
    parts_per_minute,
    refilled_later,
    steady_state,
)
from resting_aspects_ros.statistics.markov import Mask

# Share of the parts that a vibration leaves where they are.
STAYING = 0.8
# Share of the supplied parts that another one of the same clump blocks in the first image.
CLUMPED = 0.25
# Share of the free parts that vision misses, and of the picks that fail.
MISSED, FAILED = 0.02, 0.03


@dataclass(frozen=True)
class BrokenAssumption:
    """An assumption that does not hold.

    text : str
        What happens instead.
    rate : float
        Parts per minute with the same counts.
    change : float
        Relative to the forecast, such as -0.05.
    """

    text: str
    rate: float
    change: float


@dataclass(frozen=True, eq=False)
class Places:
    """The forecast of a number of parts on the tray, whose assumptions can be changed.

    moves : Moves
        Over k aspects, all of which are occupied in the long run.
    pickable : (k,) bool
    free : (k,) float
        Probability that a part of each aspect is free.
    number : int
    max_picks : int or None
    """

    moves: Moves
    pickable: Mask
    free: Array
    number: int
    times: CycleTimes
    max_picks: int | None = None

    def rate(self, staying: float = 0.0, clumped: float = 0.0) -> float:
        """Return the parts per minute.

        staying : float
            Share of the parts that stay where they are in a vibration. A part stays free or
            blocked if it and its neighbour stay, hence with the square of this probability.
        clumped : float
            Share of supplied parts that are blocked in the first image, in addition.
        """
        k, kept = len(self.free), staying**2
        fresh = np.stack([self.free, 1 - self.free])  # free and blocked, after a vibration
        first = np.stack([self.free * (1 - clumped), 1 - self.free * (1 - clumped)])
        moved = self.moves.transitions
        rows = np.zeros((2, k, 2, k))
        for was in range(2):
            for now in range(2):
                stays = kept if was == now else 0.0
                rows[was, :, now] = moved * (stays + (1 - kept) * fresh[now])
        drop = (self.moves.drop * first).ravel()
        left = np.tile(self.moves.left, 2)
        wanted = np.concatenate([self.pickable.astype(np.float64), np.zeros(k)])
        state = self._state(Moves(drop, rows.reshape(2 * k, 2 * k), left), wanted)
        return float(parts_per_minute(self.times, state.picks, state.supplied))

    def _state(self, moves: Moves, wanted: Array) -> SteadyState:
        """Return the long run over the states that are reached."""
        reached = moves.drop > 0
        while True:
            further = reached | (moves.transitions[reached].sum(axis=0) > 0)
            if (further == reached).all():
                break
            reached = further
        inside = Moves(
            moves.drop[reached], moves.transitions[np.ix_(reached, reached)], moves.left[reached]
        )
        free = np.append(np.minimum(wanted[reached], 1 - 1e-12), 0.0)
        return steady_state(refilled_later(inside), free, self.number, self.max_picks)


def broken_assumptions(places: Places, overlapping: Array) -> tuple[BrokenAssumption, ...]:
    """Return the rate with each assumption broken by itself; empty if no part is picked.

    overlapping : (k,) float
        Shares of free parts, if parts that fall on others are not separated.
    """
    base = places.rate()
    if base <= 0:
        return ()
    seen = replace(
        places,
        free=places.free * (1 - MISSED) * (1 - FAILED),
        # A pick that fails takes as long as one that does not.
        times=replace(places.times, robot=places.times.robot / (1 - FAILED)),
    )
    staying, clumped, missed, failed = (
        f'{100 * share:g} %' for share in (STAYING, CLUMPED, MISSED, FAILED)
    )
    rates = {
        f'{staying} of the parts stay in place': places.rate(staying=STAYING),
        f'{clumped} fall in clumps': places.rate(clumped=CLUMPED),
        f'{missed} missed, {failed} of picks fail': seen.rate(),
        'overlaps do not separate': replace(places, free=overlapping).rate(),
    }
    return tuple(BrokenAssumption(text, rate, rate / base - 1) for text, rate in rates.items())
