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

import functools
import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.arrays import Array
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.tracks.description import MAX_TRAPS as MAX_ON_TRACK
from resting_aspects_ros.tracks.orientations import Orientation
from resting_aspects_ros.tracks.rate import Passage
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
    outcomes,
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
# Largest share of the parts of a row that may pass traps which reject it.
LEAK = 0.01
# Rows whose critical value is farther than this from the dimension of a trap, m, are not simulated
# for it; and so often are the bands of the best design simulated.
CLEAR, ROUNDS = 6e-3, 8


@dataclass(frozen=True)
class Band:
    """The dimensions of a trap at which only some of the parts of a row pass.

    passes : float
        The dimension, m, from which all parts pass; infinite if there is none, NaN if it does not
        matter, because the row is not wanted.
    rejects : float
        The dimension, m, from which all are rejected; infinite if there is none, NaN if it does
        not matter, because the row is wanted.
    """

    passes: float
    rejects: float


class Asked(NamedTuple):
    """A band that is asked for: of a row, and of a trap with the critical value of a dimension."""

    row: Orientation
    trap: Any
    dimension: str
    critical: float
    wanted: bool


# Returns the band of each row and trap that is asked for.
Measure = Callable[[Sequence[Asked]], Sequence[Band]]


@dataclass(frozen=True, eq=False)
class Design:
    """Traps for wanted orientations.

    Attributes
    ----------
    passage : Passage
        The track with its own traps and these, and what they do to each row.
    margin : float
        Least margin of these traps, over all their dimensions, m.
    """

    passage: Passage
    margin: float


@dataclass(frozen=True, eq=False)
class DesignResult:
    """The best designs for wanted orientations, and what cannot be separated from them.

    Attributes
    ----------
    designs : tuple of Design
        The best one first; empty if no set of traps passes only the wanted orientations and those
        that are alike.
    alike : tuple of int
        Ids of the wanted rows, and of those that no trap of the families separates from them: for
        example mirror images, because the traps are symmetric along the track.
    remaining : tuple of int
        If there is no design: ids of the rows that no trap rejects which passes the wanted rows.
    others : tuple of (int, float)
        If there is no design: rows for which there is one, and its margin, m, best first.
    bands : tuple of (Trap, str, int, Band)
        Of simulated parts: trap, its dimension, row and band; of the best design, or, if there is
        none, all of them.
    """

    designs: tuple[Design, ...]
    alike: tuple[int, ...]
    remaining: tuple[int, ...] = ()
    others: tuple[tuple[int, float], ...] = ()
    bands: tuple[tuple[Trap, str, int, Band], ...] = ()


def design_traps(
    on: Passage, most: int = MAX_TRAPS, measure: Measure | None = None
) -> DesignResult:
    """Return the sets of at most ``most`` traps that pass only the wanted orientations.

    Parameters
    ----------
    on : Passage
        The track, with its wanted rows. What its own traps reject needs no further trap.
    measure : callable, optional
        Simulates the bands that the best design depends on; by default statics tells them.

    Raises
    ------
    InvalidValueError
        If the part rolls in a wanted row, or the track and its own traps do not pass it.
    """
    most = _checked_number(most, len(on.track.traps))
    _check_wanted(on)
    ids = [row.id for row in on.rows]
    wanted = np.array([ids.index(number) for number in on.wanted])
    gone = [end == 'reject' for end in on.ends] & (on.passing[1] < LEAK)
    families = list(_families(on.part, on.rows, on.track.surface))

    @functools.cache
    def apart(trap: Trap) -> Array:
        """Return how far the start of a canyon is from its critical values (n,), m."""
        if not isinstance(trap, Canyon):
            return np.full(len(ids), math.inf)
        arrivals = [Arrival(row, on.track.surface, on.part) for row in on.rows]
        return np.abs([trap.start - trap.critical(each, 'start') for each in arrivals])

    def searched(rows: npt.NDArray[np.int64]) -> '_Search':
        return _Search(families, rows, gone, most, apart)

    found = searched(wanted)
    bands: dict[tuple[int, int], Band] = {}
    for _ in range(ROUNDS if measure else 0):
        wants = [pair for pair in found.decisive() if pair not in bands]
        if not wants:
            break
        asked = []
        for f, j in wants:
            critical, kept = float(families[f].critical[j]), bool((found.same == j).any())
            what = families[f].trap, families[f].dimension
            asked.append(Asked(on.rows[j], *what, critical, kept))
        assert measure is not None
        for (f, j), band in zip(wants, measure(asked), strict=True):
            bands[f, j] = band
            families[f] = families[f].with_band(j, band)
        found = searched(wanted)

    def made(best: '_Best') -> Design:
        traps = _ordered([option.trap for option in best.options])
        more = [tuple(outcomes(on.rows, trap, on.track.surface, on.part)) for trap in traps]
        track = replace(on.track, traps=(*on.track.traps, *traps))
        return Design(replace(on, track=track, outcomes=(*on.outcomes, *more)), best.margin)

    alike = tuple(ids[j] for j in found.same.tolist())
    if found.best:
        seen = [
            (option.trap, families[f].dimension, ids[j], band)
            for option in found.best[0].options
            for (f, j), band in bands.items()
            if option.family == f
        ]
        return DesignResult(tuple(map(made, found.best)), alike, bands=tuple(seen))
    remaining = tuple(ids[j] for j in found.never_rejected())
    others = [
        (ids[j], search.best[0].margin)
        for j in np.setdiff1d(np.flatnonzero(~gone), wanted).tolist()
        if not on.rows[j].rolls and (search := searched(np.array([j]))).best
    ]
    others.sort(key=lambda each: -each[1])
    seen = [
        (families[f].trap, families[f].dimension, ids[j], band) for (f, j), band in bands.items()
    ]
    return DesignResult((), alike, remaining, tuple(others), tuple(seen))


def _checked_number(most: int, own: int) -> int:
    """Return how many traps have a place after ``own`` ones; raises InvalidValueError."""
    if not isinstance(most, int) or not 1 <= most <= MAX_TRAPS:
        raise InvalidValueError(f'invalid number of traps {most}: expected 1 to {MAX_TRAPS}')
    if own >= MAX_ON_TRACK:
        raise InvalidValueError(
            f'invalid number of traps {own}: expected less than {MAX_ON_TRACK}, so that others '
            'have a place after them'
        )
    return min(most, MAX_ON_TRACK - own)


def _check_wanted(on: Passage) -> None:
    for row, end in zip(on.rows, on.ends, strict=True):
        if row.id in on.wanted and row.rolls:
            raise InvalidValueError(
                f'invalid wanted orientation {row.id}: expected one that does not roll'
            )
        if row.id in on.wanted and end != 'pass':
            raise InvalidValueError(
                f'invalid wanted orientation {row.id}: expected one that the track and its own '
                f'traps pass; statics says {end}'
            )


def asymmetric_cut(on: Passage, other: int) -> tuple[CutOut, float] | None:
    """Return a triangular cut-out that passes the wanted rows and rejects another one.

    It is as long and as wide as the part, and its size is between the critical ones, beyond the
    band in which a nose dips and jams. Also returns its margin, m. None if neither the triangle
    nor its mirror image separates them.
    """
    arrivals = {row.id: Arrival(row, on.track.surface, on.part) for row in on.rows}
    row = arrivals[on.wanted[0]].row
    long, wide = row.length, row.width
    best: tuple[CutOut, float] | None = None
    for points in (
        ((0.0, 0.0), (long, 0.0), (long, wide)),
        ((0.0, 0.0), (long, 0.0), (0.0, wide)),
        ((0.0, wide), (long, wide), (long, 0.0)),
        ((0.0, wide), (long, wide), (0.0, 0.0)),
    ):
        cut = CutOut(1.0, points=points)
        passes = min(cut.critical(arrivals[number], 'scale') for number in on.wanted)
        rejects = cut.critical(arrivals[other], 'scale') + DIP / cut.unit
        if math.isinf(passes) or math.isinf(rejects):
            continue
        margin = (passes - rejects) / 2 * cut.unit
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
        if not math.isnan(band.passes):
            passes[j] = self.sign * band.passes if math.isfinite(band.passes) else math.inf
        if not math.isnan(band.rejects):
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

    @property
    def kinds(self) -> set[str]:
        """The kinds of its traps."""
        return {option.trap.kind for option in self.options}


def _worth(best: _Best, others: Sequence[_Best]) -> bool:
    """Return whether a set has a margin, and a larger one than those with fewer traps."""
    simpler = [each.margin + BETTER for each in others if each.kinds < best.kinds]
    return best.margin > max([LEAST, *simpler])


class _Search:
    """The sets of traps that pass wanted rows and those that are alike, and reject all others.

    gone : (n,) bool
        Rows that the track rejects already.
    apart : callable
        Returns how far another dimension of a trap than that of its family is from its critical
        values (n,), m.
    """

    def __init__(
        self,
        families: Sequence[_Family],
        wanted: npt.NDArray[np.int64],
        gone: npt.NDArray[np.bool_],
        most: int,
        apart: Callable[[Trap], Array],
    ) -> None:
        self._families = families
        alike = np.any([_alike(families, k) for k in wanted.tolist()], axis=0)
        self.same = np.flatnonzero(alike & ~gone)
        self._others = np.flatnonzero(~alike & ~gone)
        self._options = [
            option
            for f, family in enumerate(families)
            for option in _options(f, family, self.same, self._others)
        ]
        if len(self._others):
            self.best = self._verified(self._found(most), apart)
        else:
            self.best = [_Best(math.inf, ())]

    def _found(self, most: int) -> list[_Best]:
        """Return the best set of each set of kinds, best first, by one dimension of each trap."""
        if not self._options:
            return []
        margins = np.array([option.margins for option in self._options])
        passed = margins[:, self.same].min(axis=1)
        rejected = -margins[:, self._others]
        # An option that passes by less and rejects each row by less than another of its kind goes.
        groups: dict[str, list[int]] = {}
        for k in _undominated(self._options, passed, rejected):
            groups.setdefault(self._options[k].trap.kind, []).append(k)
        found = []
        for count in range(1, most + 1):
            for kinds in itertools.combinations(groups.values(), count):
                sets = np.array(list(itertools.product(*kinds)))
                values = np.minimum(
                    passed[sets].min(axis=1), rejected[sets].max(axis=1).min(axis=1)
                )
                k = int(values.argmax())
                options = tuple(self._options[each] for each in sets[k].tolist())
                found.append(_Best(float(values[k]), options))
        return sorted(found, key=lambda each: (-each.margin, len(each.options)))

    def _verified(self, found: Sequence[_Best], apart: Callable[[Trap], Array]) -> list[_Best]:
        """Return the best sets with their margins over all dimensions of their traps."""
        checked: list[_Best] = []
        kept: list[_Best] = []
        for best in found:
            # One with fewer traps may still replace those that are not better by BETTER.
            enough = sum(each.margin > best.margin + BETTER for each in kept) >= ALTERNATIVES
            if enough or best.margin <= LEAST:
                break
            limits = np.array([apart(option.trap) for option in best.options])
            margins = np.clip([option.margins for option in best.options], -limits, limits)
            value = min(margins[:, self.same].min(), -margins[:, self._others].min(axis=0).max())
            checked.append(replace(best, margin=float(value)))
            kept = [each for each in checked if _worth(each, checked)]
        return sorted(kept, key=lambda each: (-each.margin, len(each.options)))[:ALTERNATIVES]

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
                # A high blade tips a tall part over instead of pushing it off.
                tips = isinstance(option.trap, Wiper) and j in own
                if math.isfinite(apart) and (apart < CLEAR or tips):
                    yield option.family, j

    def never_rejected(self) -> list[int]:
        """Return the rows that no option rejects."""
        if not self._options:
            return [int(j) for j in self._others]
        margins = np.array([option.margins for option in self._options])[:, self._others]
        return [int(j) for j in self._others[(margins >= -LEAST).all(axis=0)]]


def _alike(families: Sequence[_Family], k: int) -> npt.NDArray[np.bool_]:
    """Return which rows (n,) no family separates from row k; it is one of them."""
    same = np.ones(len(families[0].critical), dtype=bool)
    for family in families:
        values = family.critical
        with np.errstate(invalid='ignore'):
            same &= (np.abs(values - values[k]) < SAME) | (values == values[k])
    same[k] = True
    return same


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
