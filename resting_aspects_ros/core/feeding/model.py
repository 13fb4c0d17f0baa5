"""What a forecast depends on, and the long run for each number of parts on the tray."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from resting_aspects_ros.core.errors import InvalidValueError, shown
from resting_aspects_ros.core.feeding.cycle import CycleTimes, parts_per_minute, picks
from resting_aspects_ros.core.feeding.density import FreeShares
from resting_aspects_ros.core.feeding.footprint import Footprint, Tray
from resting_aspects_ros.core.feeding.steady_state import (
    Moves,
    RunSpread,
    SteadyState,
    moves_of,
    recurrent,
    refilled_later,
    run_spread,
    steady_state,
)
from resting_aspects_ros.core.reorientation.markov import Mask
from resting_aspects_ros.core.statistics.intervals import Array, Counts

_HARDLY = 1e-12


@dataclass(frozen=True, eq=False)
class FeederModel:
    """Everything that a forecast depends on, over k aspects or symmetry classes.

    drop : (k,) int
        Dropped parts at rest in each.
    transitions : (k, m) int
        Counts of the action from each to each, and in m - k columns to none of them.
    pickable : (k,) bool
    footprints : sequence of k Footprint
    tray : Tray
    times : CycleTimes
    max_picks : int or None
        Maximum number of picks after one image.
    """

    drop: Counts
    transitions: Counts
    pickable: Mask
    footprints: Sequence[Footprint]
    tray: Tray
    times: CycleTimes
    max_picks: int | None = None

    def __post_init__(self) -> None:
        if not self.pickable.any():
            raise InvalidValueError('invalid pickable aspects: expected at least one')
        if not self.drop.any() or not (self.transitions.sum(axis=1) > 0).all():
            raise InvalidValueError(
                'invalid counts: expected drops that come to rest in an aspect, and actions from '
                'each aspect'
            )
        if self.max_picks is not None:
            check_number('maximum number of picks', self.max_picks)


class SteadyStates:
    """The steady state for each number of parts, if the counts were the probabilities.

    Attributes
    ----------
    trapped : (k,) bool
        Aspects in which parts collect because the action does not bring them into a pickable one.
        If there are any, the tray fills with these parts, and no part is picked in the long run.
    """

    def __init__(self, model: FeederModel) -> None:
        self._model = model
        self._moves = moves_of(model.drop, model.transitions)
        self._shares, self.trapped = recurrent(self._moves, model.pickable)
        self._occupied = self._shares > 0
        m, here = self._moves, self._occupied
        self._inside = Moves(m.drop[here], m.transitions[np.ix_(here, here)], m.left[here])

    def at(self, table: FreeShares, number: int) -> SteadyState:
        """Return the steady state with a number of parts on the tray.

        Raises InvalidValueError if the number of parts does not fit.
        """
        found = self._at(table, number)
        mix, taken = np.zeros((2, len(self._occupied)))
        mix[self._occupied] = found.mix[:-1] / found.mix[:-1].sum()
        taken[self._occupied] = found.taken[:-1]
        return SteadyState(mix, taken, found.picks, found.lost)

    def spread(self, table: FreeShares, number: int) -> RunSpread:
        """Return how the number of picks of runs differs from that of the long run."""
        found = self._at(table, number)
        near = 0.0 if table.clustering is None else float(table.clustering[number - 1])
        moves = refilled_later(self._inside)
        return run_spread(moves, found, number, self._model.times, near)

    def rates(self, table: FreeShares) -> Array:
        """Return the parts per minute (n,) for each number of parts of a table."""
        found = self._at(table, np.arange(1, len(table.free) + 1))
        return parts_per_minute(self._model.times, found.picks, found.supplied)

    def free(self, table: FreeShares) -> Array:
        """Return the share (n,) of the pickable parts of a drop that are free."""
        pickable = self._model.pickable
        weight = np.where(pickable, self._moves.drop, 0.0)
        weight = weight if weight.any() else pickable.astype(np.float64)
        return np.asarray(table.free @ weight / weight.sum())

    def _at(self, table: FreeShares, number: int | Counts) -> SteadyState:
        """Return the steady state over the aspects that are occupied in the long run.

        The last class is that of missing parts. For several numbers of parts (n,), its arrays have
        a leading axis.
        """
        if self.trapped.any():
            shape = np.shape(table.at(number))[:-1]
            mix = np.append(self._shares[self._occupied], 0.0)
            mix = np.broadcast_to(mix, (*shape, len(mix)))
            none = picks(number, np.zeros(shape))
            return SteadyState(mix, np.zeros_like(mix), none, np.zeros(shape))
        pickable, most = self._model.pickable, self._model.max_picks
        return tray_state(self._inside, table, pickable, self._occupied, number, most)


def tray_state(
    moves: Moves,
    table: FreeShares,
    pickable: Mask,
    which: Mask,
    number: int | Counts,
    max_picks: int | None,
) -> SteadyState:
    """Return the steady state with a last class of missing parts; see `refilled_later`.

    Parameters
    ----------
    moves : Moves
        Of the aspects ``which`` (k,) of the table.
    number : int or (n,) int
        Parts on the tray after it is refilled. As some are missing in an image, the others are
        free with the share of their mean number.
    """
    places = refilled_later(moves)

    def state(shares: Array) -> SteadyState:
        # Where no part is ever free, the mix is that of a tray whose parts are hardly ever picked,
        # and where all are, that of one whose parts are hardly ever left.
        free = np.where(pickable, np.clip(shares, _HARDLY, 1 - _HARDLY), 0.0)[..., which]
        free = np.concatenate([free, np.zeros((*free.shape[:-1], 1))], axis=-1)
        return steady_state(places, free, number, max_picks)

    found = state(table.at(number))
    missing = found.mix[..., -1]
    return state(table.between(number * (1 - missing))) if missing.any() else found


def check_number(name: str, value: object) -> None:
    """Raise InvalidValueError unless the value is an integer of at least 1."""
    if isinstance(value, bool) or not isinstance(value, int) or value < 1:
        raise InvalidValueError(f'invalid {name} {shown(value)}: expected 1 or more')
