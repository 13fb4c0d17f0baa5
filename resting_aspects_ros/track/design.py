"""Design the traps that pass a wanted orientation and reject all others, with the largest margin.

Of each family of traps, the critical value of every row is known: the dimension at which the trap
begins to reject it. A trap passes a row by a *margin*, the distance of its dimension from that
value, or rejects it by one. The margin of a design is the smaller one of the margin by which all
traps pass the wanted row, and of the least margin by which one of them rejects each other row. A
rejection needs more than the band in which parts jam.

Passive traps cannot raise the efficiency: they only reject. A higher rate needs another wanted
row, or an action before the traps that turns parts.
"""

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.arrays import Array
from resting_aspects_ros.errors import InvalidValueError, shown
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.track.description import Track
from resting_aspects_ros.track.orientations import Orientation
from resting_aspects_ros.track.rate import Passage, Tolerance, pass_traps
from resting_aspects_ros.track.support import is_line
from resting_aspects_ros.track.traps import (
    DIP,
    WEDGE,
    Arrival,
    Balcony,
    Canyon,
    Cut,
    Gap,
    Surface,
    Trap,
    Wiper,
)

MOST_TRAPS = 3
# Rows whose critical values agree within this, m, are alike to these traps.
SAME = 5e-5
# Least margin of a design, m, and by how much a further trap must raise it.
LEAST, BETTER = 1e-4, 3e-4
# Distances of the near side of canyons from the wall, as shares of the widest row.
STARTS = 8
# Traps of one family that are combined with others.
KEPT = 40
# Alternatives that are returned.
ALTERNATIVES = 3


@dataclass(frozen=True, eq=False)
class _Option:
    """A trap with its margins (n,), m: positive if it passes a row, negative if it rejects it."""

    trap: Any
    margins: Array


@dataclass(frozen=True, eq=False)
class Design:
    """Traps for a wanted orientation.

    Attributes
    ----------
    passage : Passage
        The track with these traps, and what they do to each row. The wanted rows are the wanted
        one and those that are alike.
    margin : float
        Least margin, m.
    """

    passage: Passage
    margin: float

    @property
    def traps(self) -> tuple[Trap, ...]:
        """The traps, in the order in which a part passes them."""
        return self.passage.track.traps


@dataclass(frozen=True, eq=False)
class DesignResult:
    """The best designs for a wanted orientation, and what cannot be separated from it.

    Attributes
    ----------
    designs : tuple of Design
        The best one first; empty if no set of traps passes only the wanted orientation.
    alike : tuple of int
        Ids of the rows that no trap of the families separates from the wanted one, with it: for
        example its mirror image, because the traps are symmetric along the track.
    remaining : tuple of int
        Ids of the rows that also pass the best set of traps if there is no design.
    """

    designs: tuple[Design, ...]
    alike: tuple[int, ...]
    remaining: tuple[int, ...]


def design_traps(
    part: Part,
    rows: Sequence[Orientation],
    track: Track,
    wanted: int,
    tolerance: Tolerance | None = None,
    most: int = MOST_TRAPS,
) -> DesignResult:
    """Return the sets of at most ``most`` traps that pass only one orientation.

    The traps of the track itself are not used; its surface, wall and speed are.

    Raises
    ------
    InvalidValueError
        If the row is not known, or the part rolls in it.
    """
    ids = [row.id for row in rows]
    if wanted not in ids:
        raise InvalidValueError(
            f'invalid wanted orientation {shown(wanted)}: expected 1 to {len(ids)}'
        )
    if not 1 <= most <= MOST_TRAPS:
        raise InvalidValueError(f'invalid number of traps {most}: expected 1 to {MOST_TRAPS}')
    k = ids.index(wanted)
    if rows[k].rolls:
        raise InvalidValueError(
            f'invalid wanted orientation {wanted}: expected one in which the part does not roll'
        )
    families = list(_families(part, rows, track.surface))
    same = _alike(families, k)
    others = np.setdiff1d(np.arange(len(rows)), same)
    options = [option for family in families for option in _options(family, same, others)]
    alike = tuple(ids[j] for j in same.tolist())
    found = list(_best(options, same, others, most))
    if not len(others):
        found = [(math.inf, ())]
    designs = tuple(
        Design(
            pass_traps(part, rows, replace(track, traps=_ordered(traps)), alike, tolerance),
            margin,
        )
        for margin, traps in found
        if margin > LEAST
    )
    remaining = () if designs else tuple(ids[j] for j in _never_rejected(options, others))
    return DesignResult(designs, alike, remaining)


@dataclass(frozen=True, eq=False)
class _Family:
    """Traps that differ in one dimension.

    critical : (n,) float
        Value of the dimension at which a row changes between pass and reject.
    above : bool
        Whether larger values pass.
    band : float
        Rejections with a smaller margin can jam, m.
    certain : (n,) bool
        Whether a rejection of the row is certain: not if it rolls, or if its body catches an edge.
    """

    trap: Any
    dimension: str
    critical: Array
    above: bool
    band: float
    certain: npt.NDArray[np.bool_]


def _families(part: Part, rows: Sequence[Orientation], surface: Surface) -> Iterator[_Family]:
    rolls = np.array([row.rolls for row in rows])
    line = np.array([is_line(row) for row in rows])
    height = np.array([row.height for row in rows])
    yield _Family(Wiper(1.0), 'height', height, True, WEDGE, ~rolls)
    widest = max(row.width for row in rows)

    def made(trap: Cut, dimension: str, above: bool, band: float) -> _Family:
        found = np.array(
            [
                math.nan if row.rolls else trap.critical(Arrival(row, surface, part), dimension)
                for row in rows
            ]
        )
        return _Family(trap, dimension, found, above, band, ~rolls & ~line)

    yield made(Balcony(min(surface.width, widest)), 'width', True, 0.0)
    yield made(Gap(0.01), 'length', False, DIP)
    for start in np.linspace(0.1, 0.8, STARTS) * min(widest, surface.width):
        near = round(float(start), 4)
        yield made(Canyon(near, 2 * surface.width), 'end', False, 0.0)


def _alike(families: Sequence[_Family], k: int) -> npt.NDArray[np.int64]:
    """Return the rows that no family separates from row k, with it."""
    same = np.ones(len(families[0].critical), dtype=bool)
    for family in families:
        values = family.critical
        with np.errstate(invalid='ignore'):
            same &= (np.abs(values - values[k]) < SAME) | (values == values[k])
    same[k] = True
    return np.flatnonzero(same)


def _options(
    family: _Family,
    same: npt.NDArray[np.int64],
    others: npt.NDArray[np.int64],
) -> Iterator[_Option]:
    """Yield traps of a family that pass the wanted rows and reject at least one other."""
    sign = 1.0 if family.above else -1.0
    own = float((sign * family.critical[same]).max())
    if not math.isfinite(own):
        if own == -math.inf:  # it passes every value: any value that rejects another row
            own = float(np.nanmin(sign * family.critical[others], initial=math.inf)) - 1e-3
        else:
            return
    beyond = sign * family.critical[others]
    beyond = np.unique(beyond[np.isfinite(beyond) & (beyond > own + 2 * LEAST)])
    values = np.concatenate([(own + beyond) / 2, (own + beyond - family.band) / 2])
    for value in np.unique(np.round(sign * values, 6)).tolist():
        if value <= 0 or sign * value <= own:
            continue
        margins = np.nan_to_num(sign * (value - family.critical), nan=0.0, posinf=10, neginf=-10)
        margins = np.where(margins < 0, np.minimum(margins + family.band, 0.0), margins)
        margins = np.where((margins < 0) & ~family.certain, 0.0, margins)
        if (margins[others] < -LEAST).any():
            yield _Option(replace(family.trap, **{family.dimension: value}), margins)


def _best(
    options: Sequence[_Option],
    same: npt.NDArray[np.int64],
    others: npt.NDArray[np.int64],
    most: int,
) -> list[tuple[float, tuple[Trap, ...]]]:
    """Return margins and sets of traps: the best one of each set of kinds, best first."""
    if not options or not len(others):
        return []
    margins = np.array([option.margins for option in options])
    passed = margins[:, same].min(axis=1)
    rejected = -margins[:, others]
    # An option that passes by less and rejects each row by less than another one of its kind goes.
    kept = _undominated(options, passed, rejected)
    best: dict[tuple[str, ...], tuple[float, tuple[Trap, ...]]] = {}
    for count in range(1, most + 1):
        for chosen in itertools.combinations(kept, count):
            kinds = tuple(options[c].trap.kind for c in chosen)
            if len({*kinds}) < count:
                continue
            index = list(chosen)
            value = float(min(passed[index].min(), rejected[index].max(axis=0).min()))
            known = best.get(kinds)
            smaller = max(
                (b[0] for other, b in best.items() if {*other} < {*kinds}), default=-math.inf
            )
            if value > LEAST and value > smaller + BETTER and (known is None or value > known[0]):
                best[kinds] = value, tuple(options[c].trap for c in chosen)
    return sorted(best.values(), key=lambda each: (-each[0], len(each[1])))[:ALTERNATIVES]


def _undominated(options: Sequence[_Option], passed: Array, rejected: Array) -> list[int]:
    kept: list[int] = []
    all_values = np.column_stack([passed, rejected])
    for k, option in enumerate(options):
        rivals = [
            j for j, other in enumerate(options) if j != k and other.trap.kind == option.trap.kind
        ]
        better = [
            j
            for j in rivals
            if (all_values[j] >= all_values[k]).all()
            and ((all_values[j] > all_values[k]).any() or j < k)
        ]
        if not better:
            kept.append(k)
    order = sorted(kept, key=lambda k: -float(np.minimum(all_values[k], 0.01).sum()))
    return sorted(order[:KEPT])


def _never_rejected(options: Sequence[_Option], others: npt.NDArray[np.int64]) -> list[int]:
    if not options:
        return [int(k) for k in others]
    margins = np.array([option.margins for option in options])[:, others]
    return [int(k) for k in others[(margins >= -LEAST).all(axis=0)]]


def _ordered(traps: Sequence[Trap]) -> tuple[Trap, ...]:
    """Return traps with wipers first: what they push off cannot jam in a hole."""
    return tuple(sorted(traps, key=lambda trap: not isinstance(trap, Wiper)))
