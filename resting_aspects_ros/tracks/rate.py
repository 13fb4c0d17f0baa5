"""What passes the traps of a track, and how many good parts per minute that gives.

The *orienting efficiency* E is the share of the entering parts that leave in the wanted
orientation (Boothroyd, Assembly Automation and Product Design). With the speed v, the share phi of
the track that parts cover, and the mean length L of the parts that arrive,

    60 v phi E / L  good parts per minute,   1 / E passes for each of them,

because a rejected part falls back and comes again in a new orientation.

A sensor is a camera with an air jet. Views of each row are made from its outline, with errors of
the boundary, and identified as a camera above a tray would do it (`identify`). The row of the most
probable pose is the answer; of rows that look the same, the one with the largest share. The jet
needs a distance between the parts: at most 60 v / (L + spacing) of them arrive per minute.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import shapely
from scipy.special import ndtr

from resting_aspects_ros.arrays import Array
from resting_aspects_ros.errors import InvalidValueError, shown
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.tracks.description import Track
from resting_aspects_ros.tracks.orientations import Orientation, same_orientation
from resting_aspects_ros.tracks.traps import MAX_SIZE, Balcony, Outcome, Sensor, Trap, outcomes
from resting_aspects_ros.vision.fitting import OutlineNoise
from resting_aspects_ros.vision.identification import identify, observed_polygon
from resting_aspects_ros.vision.outline import seen_outline
from resting_aspects_ros.vision.rolling import KnownPart

# A tolerance is the half width that 3 standard deviations of a normal distribution fill.
SIGMAS = 3.0
# Views of each row.
VIEWS = 20
# Two orientations within this, rad, are one row.
WITHIN = 0.1


@dataclass(frozen=True)
class Tolerance:
    """Half widths of the dimensions of parts and of traps, m."""

    part: float = 0.0
    trap: float = 0.0

    def __post_init__(self) -> None:
        for name in ('part', 'trap'):
            value = getattr(self, name)
            if not isinstance(value, int | float) or not 0 <= value <= 0.1:
                raise InvalidValueError(
                    f'invalid tolerance {shown(value)} of the {name}: expected 0 to 0.1 m'
                )

    @property
    def both(self) -> float:
        """Margin that is enough for all parts and traps, m."""
        return self.part + self.trap

    def passing(self, margin: float) -> float:
        """Return the probability that a part with this margin, m, passes."""
        sigma = math.hypot(self.part, self.trap) / SIGMAS
        if not sigma or math.isinf(margin):
            return float(margin > 0)
        return float(ndtr(margin / sigma))


@dataclass(frozen=True, eq=False)
class Passage:
    """What the traps of a track do to each orientation of a part.

    Attributes
    ----------
    part : Part
    track : Track
    rows : tuple of Orientation
        By their numbers.
    entry : tuple of Outcome
        Whether the track without traps supports each row; what it does not support falls off
        before the first trap.
    outcomes : tuple of tuple of Outcome
        For each trap, what it does to each row.
    wanted : tuple of int
        Ids of the wanted rows.
    tolerance : Tolerance
    """

    part: Part
    track: Track
    rows: tuple[Orientation, ...]
    entry: tuple[Outcome, ...]
    outcomes: tuple[tuple[Outcome, ...], ...]
    wanted: tuple[int, ...]
    tolerance: Tolerance

    @cached_property
    def passing(self) -> tuple[Array, Array]:
        """Least and greatest probability (n,) of each row to pass all traps.

        They differ where an outcome is not known, or changes the orientation.
        """
        low, high = np.ones((2, len(self.rows)))
        for of_trap in (self.entry, *self.outcomes):
            for k, found in enumerate(of_trap):
                if found.share is not None:
                    low[k] *= found.share
                    high[k] *= found.share
                elif found.outcome in ('unknown', 'turn'):
                    low[k] = 0.0
                elif found.outcome == 'jam':
                    low[k] = high[k] = 0.0
                else:
                    p = self.tolerance.passing(found.margin)
                    low[k] *= p
                    high[k] *= p
        return low, high

    @property
    def probability(self) -> Array:
        """Probability (n,) of each row."""
        return np.array([row.probability for row in self.rows])

    def _shares(self, *, wanted: bool) -> tuple[float, float]:
        """Return the least and greatest share of the parts that pass in wanted or other rows."""
        mask = np.array([(row.id in self.wanted) == wanted for row in self.rows])
        low, high = (float((self.probability * each)[mask].sum()) for each in self.passing)
        return low, high

    @property
    def good(self) -> tuple[float, float]:
        """Least and greatest orienting efficiency: parts that leave in a wanted row."""
        return self._shares(wanted=True)

    @property
    def model_good(self) -> tuple[float, float] | None:
        """Model range of the orienting efficiency; None if that of a wanted row is not known.

        The bounds of several wanted rows are added, which is wider than the range of their sum.
        """
        low = high = 0.0
        for row, least, most in zip(self.rows, *self.passing, strict=True):
            if row.id in self.wanted:
                if row.model is None:
                    return None
                low, high = low + row.model[0] * least, high + row.model[1] * most
        return float(low), float(min(high, 1.0))

    @property
    def purity(self) -> tuple[float, float]:
        """Least and greatest share of the parts that pass which are in a wanted row."""
        (low, high), (fewest, most) = self.good, self._shares(wanted=False)
        worst, best = (a / (a + b) if a + b > 0 else 0.0 for a, b in ((low, most), (high, fewest)))
        return worst, best

    @property
    def mean_length(self) -> float:
        """Mean length of the parts that arrive, m."""
        p = self.probability
        return float((p * [row.length for row in self.rows]).sum() / p.sum())

    @property
    def arrivals(self) -> float:
        """Parts per minute that arrive at the traps."""
        speed, length = 60 * self.track.speed, self.mean_length
        limits = [
            speed / (length + trap.spacing)
            for trap in self.track.traps
            if isinstance(trap, Sensor)
        ]
        return min([speed * self.track.fill / length, *limits])

    @property
    def rate(self) -> tuple[float, float]:
        """Good parts per minute, at least and at most."""
        low, high = self.good
        return self.arrivals * low, self.arrivals * high

    @property
    def other_rows(self) -> tuple[float, float]:
        """Parts per minute that pass in rows that are not wanted, at least and at most."""
        low, high = self._shares(wanted=False)
        return self.arrivals * low, self.arrivals * high

    @property
    def returned(self) -> tuple[float, float]:
        """Parts per minute that fall back, at least and at most; the others pass or jam."""
        low, high = (float((self.probability * each).sum()) for each in self.passing)
        rest = 1 - self.jams
        return self.arrivals * max(0.0, rest - high), self.arrivals * max(0.0, rest - low)

    @property
    def ends(self) -> list[str]:
        """What becomes of each row: the first outcome that is no pass."""
        of_rows = zip(self.entry, *self.outcomes, strict=True)
        return [
            next((each.outcome for each in of_row if each.outcome != 'pass'), 'pass')
            for of_row in of_rows
        ]

    @property
    def jams(self) -> float:
        """Share of the parts that jam in a trap."""
        stuck = [end == 'jam' for end in self.ends]
        return float(self.probability[stuck].sum())


def pass_traps(
    part: Part,
    rows: Sequence[Orientation],
    track: Track,
    wanted: Sequence[int] = (),
    tolerance: Tolerance | None = None,
    confusions: Mapping[Sensor, Array] | None = None,
) -> Passage:
    """Return what the traps of a track do to each orientation.

    Parameters
    ----------
    wanted : sequence of int
        Ids of rows; empty: the first row that the track supports and a part arrives in.
    confusions : mapping of Sensor to (n, n + 1) float
        Matrix of each sensor of the track; see confusion.

    Raises
    ------
    InvalidValueError
        If a wanted row is not known, or falls off the track before the first trap.
    """
    ids = [row.id for row in rows]
    for each in wanted:
        if not isinstance(each, int | np.integer) or isinstance(each, bool) or each not in ids:
            raise InvalidValueError(
                f'invalid wanted orientation {shown(each)}: expected 1 to {len(ids)}'
            )
    wide = replace(track.surface, width=MAX_SIZE)
    entry = outcomes(rows, Balcony(track.surface.width), wide, part)
    entry = [Outcome('pass') if row.rolls else each for row, each in zip(rows, entry, strict=True)]
    for row, enters in zip(rows, entry, strict=True):
        if row.id in wanted and enters.outcome == 'reject':
            raise InvalidValueError(
                f'invalid wanted orientation {row.id}: expected one that the track of '
                f'{1e3 * track.surface.width:g} mm supports; this one needs '
                f'{1e3 * enters.critical:.2f} mm'
            )
    supported = [row for row, each in zip(rows, entry, strict=True) if each.outcome == 'pass']
    first = [*(row.id for row in supported if row.probability), *(row.id for row in supported)]
    chosen = tuple(sorted({*map(int, wanted)})) or tuple(first[:1]) or (ids[0],)

    def found(trap: Trap) -> tuple[Outcome, ...]:
        if isinstance(trap, Sensor):
            return _accepted(rows, chosen, (confusions or {})[trap])
        return tuple(outcomes(rows, trap, track.surface, part))

    return Passage(
        part,
        track,
        tuple(rows),
        tuple(entry),
        tuple(found(trap) for trap in track.traps),
        chosen,
        tolerance or Tolerance(),
    )


def _accepted(
    rows: Sequence[Orientation], wanted: Sequence[int], confusion: Array
) -> tuple[Outcome, ...]:
    """Return what a sensor does to each row: it lets pass what it identifies as a wanted row."""
    columns = [k for k, row in enumerate(rows) if row.id in wanted]
    shares = confusion[:, columns].sum(axis=1).tolist()
    return tuple(Outcome('pass' if share >= 0.5 else 'reject', share=share) for share in shares)


# -- Sensors --------------------------------------------------------------------------------------


def confusion(
    known: KnownPart, rows: Sequence[Orientation], sd: float, seed: int, views: int = VIEWS
) -> Array:
    """Return the confusion matrix (n, n + 1) of the rows: shares of the views of a row.

    Column j is the share that is identified as row j, the last one what is identified as none.

    sd : standard deviation of the boundary that the camera sees, m
    """
    noise = OutlineNoise(sd)
    counts = np.zeros((len(rows), len(rows) + 1))
    for k, row in enumerate(rows):
        outline = seen_outline(known.part, row.orientation)
        random = np.random.default_rng((seed, 11, row.id))
        for _ in range(views):
            seen = _seen(outline, noise, random)
            counts[k, _answer(seen, known, rows, noise)] += 1
    return counts / views


def _seen(
    outline: shapely.Polygon, noise: OutlineNoise, random: np.random.Generator
) -> shapely.Polygon:
    """Return an outline whose boundary has independent errors at each correlation length."""
    rings = [_ring(ring, noise, random) for ring in (outline.exterior, *outline.interiors)]
    return shapely.Polygon(rings[0], rings[1:])


def _ring(ring: shapely.LinearRing, noise: OutlineNoise, random: np.random.Generator) -> Array:
    count = max(int(ring.length / noise.correlation), 8)
    at = shapely.line_interpolate_point(ring, np.arange(count) / count, normalized=True)
    points = np.concatenate([shapely.get_coordinates(ring)[:-1], shapely.get_coordinates(at)])
    place = shapely.line_locate_point(ring, shapely.points(points))
    points = points[np.argsort(place, kind='stable')]
    return np.asarray(points + noise.sd * random.standard_normal(points.shape))


def _answer(
    seen: shapely.Polygon, known: KnownPart, rows: Sequence[Orientation], noise: OutlineNoise
) -> int:
    """Return the index of the row that a polygon is identified as; n: none."""
    try:
        best = identify(observed_polygon(seen), [known], noise).best
    except InvalidValueError:  # the noise is so large that the polygon crosses itself
        return len(rows)
    if best is None:
        return len(rows)
    symmetry = known.aspects.symmetry
    for k in sorted(range(len(rows)), key=lambda k: -rows[k].probability):
        if any(
            same_orientation(pose.orientation, rows[k].orientation, symmetry, WITHIN)
            for pose in best.poses
        ):
            return k
    return len(rows)
