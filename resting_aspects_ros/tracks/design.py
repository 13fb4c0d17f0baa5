"""Design the traps that pass a wanted orientation and reject all others, with the largest margin.

Of each family of traps, two values of its dimension are known for every row: that from which all
parts pass, and that from which all are rejected. Statics places the first at the critical value,
and the second beyond the band in which parts jam. Simulated parts replace both by the ends of the
*grey band*, between which only some of the parts pass at the speed of the track.

The margin of a design is the smaller one of the margin by which all traps pass the wanted row, and
of the least margin by which one of them rejects each other row. Passive traps cannot raise the
efficiency: they only reject. A higher rate needs another wanted row, or an action before the traps
that turns parts.
"""

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.arrays import Array
from resting_aspects_ros.errors import InvalidValueError, shown
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.tracks.description import Track
from resting_aspects_ros.tracks.orientations import Orientation
from resting_aspects_ros.tracks.rate import Passage, Tolerance, pass_traps
from resting_aspects_ros.tracks.support import is_line
from resting_aspects_ros.tracks.traps import (
    DIP,
    WEDGE,
    Arrival,
    Balcony,
    Canyon,
    Cut,
    CutOut,
    Gap,
    Surface,
    Trap,
    Wiper,
)

MAX_TRAPS = 3
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
# Rows whose critical value is farther than this from the dimension of a trap, m, are not simulated
# for it; and so often are the bands of the best design simulated.
CLEAR, ROUNDS = 6e-3, 8


@dataclass(frozen=True)
class Band:
    """The dimensions of a trap at which only some of the parts of a row pass.

    passes : float
        The dimension, m, from which all parts pass; infinite if there is none.
    rejects : float
        The dimension, m, from which all are rejected; infinite if there is none.
    """

    passes: float
    rejects: float


# Returns the band of a row and a trap, whose dimension with this name has the critical value.
Measure = Callable[[Orientation, Any, str, float], Band]


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
    bands : tuple of (Trap, str, int, Band)
        Of simulated parts: trap, its dimension, row and band.
    """

    passage: Passage
    margin: float
    bands: tuple[tuple[Trap, str, int, Band], ...] = ()

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
        If there is no design: ids of the rows that no trap rejects which passes the wanted row.
    others : tuple of (int, float)
        If there is no design: rows for which there is one, and its margin, m, by statics.
    """

    designs: tuple[Design, ...]
    alike: tuple[int, ...]
    remaining: tuple[int, ...] = ()
    others: tuple[tuple[int, float], ...] = ()


def design_traps(
    part: Part,
    rows: Sequence[Orientation],
    track: Track,
    wanted: int,
    tolerance: Tolerance | None = None,
    most: int = MAX_TRAPS,
    measure: Measure | None = None,
) -> DesignResult:
    """Return the sets of at most ``most`` traps that pass only one orientation.

    The traps of the track itself are not used; its surface, wall and speed are.

    Parameters
    ----------
    measure : callable, optional
        Simulates the bands that the best design depends on; by default statics tells them.

    Raises
    ------
    InvalidValueError
        If the row is not known, the part rolls in it, or the track does not support it.
    """
    ids = [row.id for row in rows]
    if wanted not in ids:
        raise InvalidValueError(
            f'invalid wanted orientation {shown(wanted)}: expected 1 to {len(ids)}'
        )
    if not 1 <= most <= MAX_TRAPS:
        raise InvalidValueError(f'invalid number of traps {most}: expected 1 to {MAX_TRAPS}')
    k = ids.index(wanted)
    if rows[k].rolls:
        raise InvalidValueError(
            f'invalid wanted orientation {wanted}: expected one in which the part does not roll'
        )
    pass_traps(part, rows, replace(track, traps=()), (wanted,))
    families = list(_families(part, rows, track.surface))
    found = _Search(families, k, len(rows), most)
    bands: dict[tuple[int, int], Band] = {}
    for _ in range(ROUNDS if measure else 0):
        wants = [pair for pair in found.decisive() if pair not in bands]
        if not wants:
            break
        for f, j in wants:
            family = families[f]
            assert measure is not None
            band = measure(rows[j], family.trap, family.dimension, float(family.critical[j]))
            bands[f, j] = band
            families[f] = family.with_band(j, band)
        found = _Search(families, k, len(rows), most)
    alike = tuple(ids[j] for j in found.same.tolist())

    def made(best: '_Best') -> Design:
        traps = _ordered([option.trap for option in best.options])
        passage = pass_traps(part, rows, replace(track, traps=traps), alike, tolerance)
        return Design(
            passage,
            best.margin,
            tuple(
                (option.trap, families[f].dimension, ids[j], band)
                for option in best.options
                for (f, j), band in bands.items()
                if option.family == f
            ),
        )

    designs = tuple(made(best) for best in found.best if best.margin > LEAST)
    if designs:
        return DesignResult(designs, alike)
    remaining = tuple(ids[j] for j in found.never_rejected())
    return DesignResult((), alike, remaining, _other_rows(families, rows, k, most))


def asymmetric_cut(
    part: Part, rows: Sequence[Orientation], surface: Surface, wanted: int, other: int
) -> tuple[CutOut, float] | None:
    """Return a triangular cut-out that passes one row and rejects another, and its margin, m.

    It is as long and as wide as the part, and its size is between the critical ones of both rows.
    None if neither the triangle nor its mirror image separates them.
    """
    by_id = {row.id: row for row in rows}
    one, two = (Arrival(by_id[number], surface, part) for number in (wanted, other))
    long, wide = one.row.length, one.row.width
    best: tuple[CutOut, float] | None = None
    for points in (
        ((0.0, 0.0), (long, 0.0), (long, wide)),
        ((0.0, 0.0), (long, 0.0), (0.0, wide)),
        ((0.0, wide), (long, wide), (long, 0.0)),
        ((0.0, wide), (long, wide), (0.0, 0.0)),
    ):
        cut = CutOut(1.0, points=points)
        passes, rejects = (cut.critical(each, 'scale') for each in (one, two))
        if math.isinf(passes) or math.isinf(rejects):
            continue
        margin = (passes - rejects) / 2 * min(long, wide)
        if margin > LEAST and (best is None or margin > best[1]):
            best = replace(cut, scale=round((passes + rejects) / 2, 3)), margin
    return best


# -- Families -------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Family:
    """Traps that differ in one dimension; ``sign`` times a value is larger where more pass.

    critical : (n,) float
        Value of the dimension at which a row changes between pass and reject, by statics.
    passes, rejects : (n,) float
        Values, times the sign, above which a row passes, and below which it is rejected.
    certain : (n,) bool
        Whether a rejection of the row is certain: not if it rolls, or if its body catches an edge.
    """

    trap: Any
    dimension: str
    sign: float
    critical: Array
    passes: Array
    rejects: Array
    certain: npt.NDArray[np.bool_]

    def with_band(self, j: int, band: Band) -> '_Family':
        """Return the family with the simulated band of row j."""
        passes, rejects = self.passes.copy(), self.rejects.copy()
        passes[j] = self.sign * band.passes if math.isfinite(band.passes) else math.inf
        rejects[j] = self.sign * band.rejects if math.isfinite(band.rejects) else -math.inf
        return replace(self, passes=passes, rejects=rejects)

    def margins(self, value: float) -> Array:
        """Return margins (n,), m: positive if a row passes, negative if it is rejected."""
        with np.errstate(invalid='ignore'):
            above = np.nan_to_num(self.sign * value - self.passes, posinf=10, neginf=-10)
            below = np.nan_to_num(self.sign * value - self.rejects, posinf=10, neginf=-10)
        rejected = np.where(self.certain & (below < 0), below, 0.0)
        return np.where(above > 0, above, rejected)


def _families(part: Part, rows: Sequence[Orientation], surface: Surface) -> Iterator[_Family]:
    rolls = np.array([row.rolls for row in rows])
    line = np.array([is_line(row) for row in rows])
    height = np.array([row.height for row in rows])
    widest = max(row.width for row in rows)
    yield _Family(Wiper(1.0), 'height', 1.0, height, height, height - WEDGE, ~rolls)

    def made(trap: Cut, dimension: str, sign: float, band: float) -> _Family:
        found = np.array(
            [
                math.nan if row.rolls else trap.critical(Arrival(row, surface, part), dimension)
                for row in rows
            ]
        )
        certain = ~rolls & ~line
        return _Family(trap, dimension, sign, found, sign * found, sign * found - band, certain)

    yield made(Balcony(min(surface.width, widest)), 'width', 1.0, 0.0)
    yield made(Gap(0.01), 'length', -1.0, DIP)
    for start in np.linspace(0.1, 0.8, STARTS) * min(widest, surface.width):
        near = round(float(start), 4)
        yield made(Canyon(near, 2 * surface.width), 'end', -1.0, 0.0)


# -- Search ---------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Option:
    """A trap of a family, by its index, with its margins (n,), m."""

    trap: Any
    family: int
    margins: Array


@dataclass(frozen=True, eq=False)
class _Best:
    """The best set of traps of some kinds."""

    margin: float
    options: tuple[_Option, ...]


class _Search:
    """The sets of traps that pass row k and those that are alike, and reject all others."""

    def __init__(self, families: Sequence[_Family], k: int, count: int, most: int) -> None:
        self._families = families
        self.same = _alike(families, k)
        self._others = np.setdiff1d(np.arange(count), self.same)
        self._options = [
            option
            for f, family in enumerate(families)
            for option in _options(f, family, self.same, self._others)
        ]
        self.best = self._found(most) if len(self._others) else [_Best(math.inf, ())]

    def _found(self, most: int) -> list[_Best]:
        """Return the best set of each set of kinds, best first."""
        if not self._options:
            return []
        margins = np.array([option.margins for option in self._options])
        passed = margins[:, self.same].min(axis=1)
        rejected = -margins[:, self._others]
        # An option that passes by less and rejects each row by less than another of its kind goes.
        kept = _undominated(self._options, passed, rejected)
        best: dict[tuple[str, ...], _Best] = {}
        for count in range(1, most + 1):
            for chosen in itertools.combinations(kept, count):
                kinds = tuple(self._options[c].trap.kind for c in chosen)
                if len({*kinds}) < count:
                    continue
                index = list(chosen)
                value = float(min(passed[index].min(), rejected[index].max(axis=0).min()))
                known = best.get(kinds)
                smaller = max(
                    (b.margin for other, b in best.items() if {*other} < {*kinds}),
                    default=-math.inf,
                )
                better = value > LEAST and value > smaller + BETTER
                if better and (known is None or value > known.margin):
                    best[kinds] = _Best(value, tuple(self._options[c] for c in chosen))
        ordered = sorted(best.values(), key=lambda each: (-each.margin, len(each.options)))
        return ordered[:ALTERNATIVES]

    def decisive(self) -> Iterator[tuple[int, int]]:
        """Yield family and row for each critical value on which the best set depends."""
        if not self.best or not self.best[0].options:
            return
        options = self.best[0].options
        margins = np.array([option.margins for option in options])
        rejecting = margins.argmin(axis=0)
        for place, option in enumerate(options):
            family = self._families[option.family]
            value = getattr(option.trap, family.dimension)
            own = self._others[rejecting[self._others] == place]
            for j in [*self.same.tolist(), *own.tolist()]:
                apart = abs(value - family.critical[j])
                if math.isfinite(apart) and apart < CLEAR:
                    yield option.family, j

    def never_rejected(self) -> list[int]:
        """Return the rows that no option rejects."""
        if not self._options:
            return [int(j) for j in self._others]
        margins = np.array([option.margins for option in self._options])[:, self._others]
        return [int(j) for j in self._others[(margins >= -LEAST).all(axis=0)]]


def _other_rows(
    families: Sequence[_Family], rows: Sequence[Orientation], k: int, most: int
) -> tuple[tuple[int, float], ...]:
    """Return the rows for which there is a design, and its margin, m."""
    found = []
    for j, row in enumerate(rows):
        if j != k and not row.rolls:
            best = _Search(families, j, len(rows), most).best
            if best and best[0].margin > LEAST:
                found.append((row.id, best[0].margin))
    return tuple(found)


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
    index: int,
    family: _Family,
    same: npt.NDArray[np.int64],
    others: npt.NDArray[np.int64],
) -> Iterator[_Option]:
    """Yield traps of a family that pass the wanted rows and reject at least one other."""
    own = float(family.passes[same].max())
    if not math.isfinite(own):
        if own == -math.inf and np.isfinite(family.rejects[others]).any():
            # It passes every value: any value that rejects another row.
            rejects = family.rejects[others]
            own = float(rejects[np.isfinite(rejects)].min()) - 1e-3
        else:
            return
    beyond = family.rejects[others]
    beyond = np.unique(beyond[np.isfinite(beyond) & (beyond > own + 2 * LEAST)])
    for value in np.unique(np.round(family.sign * (own + beyond) / 2, 6)).tolist():
        if value <= 0 or family.sign * value <= own:
            continue
        margins = family.margins(value)
        if (margins[others] < -LEAST).any():
            trap = replace(family.trap, **{family.dimension: value})
            yield _Option(trap, index, margins)


def _undominated(options: Sequence[_Option], passed: Array, rejected: Array) -> list[int]:
    kept: list[int] = []
    all_values = np.column_stack([passed, rejected])
    kinds = np.array([option.trap.kind for option in options])
    for k in range(len(options)):
        rivals = all_values[kinds == kinds[k]]
        numbers = np.flatnonzero(kinds == kinds[k])
        as_good = (rivals >= all_values[k]).all(axis=1)
        better = (rivals > all_values[k]).any(axis=1) | (numbers < k)
        if not (as_good & better & (numbers != k)).any():
            kept.append(k)
    order = sorted(kept, key=lambda k: -float(np.minimum(all_values[k], 0.01).sum()))
    return sorted(order[:KEPT])


def _ordered(traps: Sequence[Trap]) -> tuple[Trap, ...]:
    """Return traps with wipers first: what they push off cannot jam in a hole."""
    return tuple(sorted(traps, key=lambda trap: not isinstance(trap, Wiper)))
