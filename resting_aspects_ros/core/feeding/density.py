"""The share of the parts on a tray that are free: no other part is in the way of the gripper.

Parts are placed at random, one after the other, without overlap (random sequential adsorption). At
low density the share of free parts is exp(-density x area), where the area is that of the places
of another part that block the gripper but do not overlap the part; see `blocking_area`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from resting_aspects_ros.core.errors import InvalidValueError, shown
from resting_aspects_ros.core.feeding.footprint import Footprint, Tray
from resting_aspects_ros.core.feeding.placing import Placing
from resting_aspects_ros.core.statistics.intervals import Array, Counts

# Share of the tray that parts cover, above which parts lean on each other or entangle, which the
# model does not describe. It is an assumption: a little more than half of the share, 0.55, at
# which no further disc finds a place by random sequential adsorption.
MAX_COVERAGE = 0.3
# A table has at most this number of parts, and no more than the second number can be requested.
MAX_NUMBER, MAX_REQUESTED = 600, 2000
# Parts that are placed in total: the standard error of a share is at most about 0.5 points.
PLACED = 16_000
MIN_TRAYS = 30
# A class with a smaller share of the mix is placed with this share, so that it is seen often.
MIN_SHARE = 0.05
# Degree of the polynomials of _smooth.
DEGREE = 3
# Fewer free parts than this share are not worth to be tabulated.
MIN_FREE = 0.03


@dataclass(frozen=True, eq=False)
class FreeShares:
    """The share of free parts with n = 1, 2, ... parts on the tray.

    free : (n, k) float
        Probability that a part of each class is free with 1, 2, ..., n parts on the tray.
    full : bool
        Whether the table ends because no further part fits.
    clustering : (n,) float or None
        Covariance of two parts of a tray being free, relative to the squared share of free parts:
        parts that are close to each other block each other. None: 0.
    """

    free: Array
    full: bool
    clustering: Array | None = None

    def at(self, number: int | Counts) -> Array:
        """Return the shares (..., k) with a number of parts, or with several numbers (...).

        Raises InvalidValueError if the number of parts does not fit on the tray.
        """
        if not 1 <= np.min(number) <= np.max(number) <= len(self.free):
            raise InvalidValueError(
                f'invalid number of parts on the tray {shown(number)}: expected 1 to '
                f'{len(self.free)}'
                + (', as no more fit on it without overlap' if self.full else '')
            )
        return np.asarray(self.free[np.asarray(number) - 1])

    def between(self, number: Array) -> Array:
        """Return the shares (..., k), interpolated; those at the ends beyond the table."""
        at = np.clip(number, 1, len(self.free)) - 1
        low = np.floor(at).astype(np.int64)
        high = np.minimum(low + 1, len(self.free) - 1)
        part = np.asarray(at - low)[..., None]
        return np.asarray((1 - part) * self.free[low] + part * self.free[high])


def free_shares(
    tray: Tray, footprints: Sequence[Footprint], mix: Array, seed: int, number: int = 0
) -> FreeShares:
    """Return how often the parts of each class are free, for each number of parts on the tray.

    Parameters
    ----------
    tray : Tray
    footprints : sequence of k Footprint
        One for each class.
    mix : (k,) float
        Share of each class among the parts on the tray.
    seed : int
    number : int
        The table has at least this number of parts, if they fit. It goes on to a coverage of
        MAX_COVERAGE, but not where next to no part is free.

    Raises
    ------
    InvalidValueError
        If a part of one of the classes does not fit into the tray.
    """
    check_fit(tray, footprints)
    if number > MAX_REQUESTED:
        raise InvalidValueError(
            f'invalid number of parts on the tray {shown(number)}: expected at most '
            f'{MAX_REQUESTED}'
        )
    share = np.where(mix > 0, np.maximum(mix / mix.sum(), MIN_SHARE), 0.0)
    share /= share.sum()
    limit = max(min(coverage_limit(tray, footprints, share), _few_free(tray, footprints)), number)
    trays = max(PLACED // limit, MIN_TRAYS)
    placing = Placing(tray, footprints, trays, limit)
    generator = np.random.default_rng(seed)
    rows: list[Counts] = []
    pairs: list[float] = []
    full = False
    while len(rows) < limit:
        kind = generator.choice(len(share), size=trays, p=share)
        if not placing.place(kind, generator):
            full = True
            break
        rows.append(placing.counts(len(share)))
        pairs.append(placing.clustering())
        if len(rows) >= number and rows[-1][0].sum() < MIN_FREE * rows[-1][1].sum():
            break
    return FreeShares(_smooth(np.array(rows)), full, _line(np.array(pairs)))


def coverage(tray: Tray, footprints: Sequence[Footprint], mix: Array, number: int) -> float:
    """Return the share of the tray that the footprints of a number of parts cover."""
    areas = np.array([footprint.area for footprint in footprints])
    return float(number * (mix @ areas) / mix.sum() / tray.area)


def coverage_limit(tray: Tray, footprints: Sequence[Footprint], mix: Array) -> int:
    """Return the number of parts, at least 1, with which the coverage is MAX_COVERAGE."""
    one = coverage(tray, footprints, mix, 1)
    return max(int(min(MAX_COVERAGE / one, MAX_NUMBER)), 1) if one else MAX_NUMBER


def blocking_area(tray: Tray, one: Footprint, other: Footprint) -> float:
    """Return the mean area of the centres of `other` that block `one` without overlap, m2.

    Only for a tray without a footprint of the gripper. For convex bodies of areas A, perimeters P
    and random orientations the mean area of the centres of all overlaps is A1 + A2 +
    P1 P2 / (2 pi) (Santalo, Integral Geometry and Geometric Probability, section 9.4); a clearance
    c dilates one of them, which adds c (P1 + P2) + pi c^2. At low density the share of free parts
    is exp(-density x this area); for points it is exp(-pi c^2 density).
    """
    c = tray.clearance
    return c * (one.perimeter + other.perimeter) + math.pi * c**2


def check_fit(tray: Tray, footprints: Sequence[Footprint]) -> None:
    """Raise InvalidValueError if a part does not fit into the tray in any of many directions."""
    yaw = np.linspace(0, math.pi / 2, 181)
    cos, sin = np.cos(yaw), np.sin(yaw)
    for each in footprints:
        a, b, radius = each.values
        wide, deep = (2 * (a * u + b * v + radius) for u, v in ((cos, sin), (sin, cos)))
        if not ((wide <= tray.size[0]) & (deep <= tray.size[1])).any():
            sides = ' x '.join(f'{1000 * side:g}' for side in tray.size)
            raise InvalidValueError(
                f'invalid tray {sides} mm: expected one into which the part fits, which is up to '
                f'{each.text} seen from above'
            )


def _few_free(tray: Tray, footprints: Sequence[Footprint]) -> int:
    """Return a number of parts with which next to none is free, by the formula of low density.

    The formula is an upper bound, because parts that cannot overlap are closer together.
    """
    area = min(blocking_area(tray, each, each) for each in footprints)
    return int(min(1 - math.log(MIN_FREE) * tray.area / max(area, 1e-12), MAX_NUMBER)) + 1


def _line(clustering: Array) -> Array:
    """Return a line (n,) through the clustering with n = 1, 2, ... parts, of which 1 has none."""
    n = np.arange(1, len(clustering) + 1)
    if len(n) < 3:
        return np.zeros(len(n))
    # The standard error of a covariance is about the inverse of the number of parts.
    slope, start = np.polyfit(n[1:], clustering[1:], 1, w=n[1:])
    return np.where(n > 1, np.maximum(slope * n + start, 0.0), 0.0)


def _smooth(counts: Counts) -> Array:
    """Return smooth shares of free parts (n, k) from counts (n, 2, k) of free and of all parts.

    The logarithm of the share is a polynomial of the number of other parts, which is 0 without
    any. Where next to no part is free, the counted shares are returned. A class without parts has
    the shares of all classes together.
    """
    counts = np.concatenate([counts, counts.sum(axis=2, keepdims=True)], axis=2)
    free, parts = counts[:, 0], np.maximum(counts[:, 1], 1)
    others = np.arange(len(counts)) / max(len(counts) - 1, 1)
    powers = others[:, None] ** np.arange(1, DEGREE + 1)
    shares = np.minimum.accumulate(free / parts)
    for k in range(free.shape[1]):
        q = (free[:, k] + 0.5) / (parts[:, k] + 1)
        # The inverse of the standard deviation of the logarithm.
        weight = np.sqrt(parts[:, k] * q / np.maximum(1 - q, 1e-3)) * (counts[:, 1, k] > 0)
        few = np.append(np.flatnonzero(q < MIN_FREE), len(q))[0]
        x, w = powers[:few], weight[:few]
        logarithm = np.log(np.maximum(free[:few, k], 0.5) / parts[:few, k])
        found = np.linalg.lstsq(w[:, None] * x, w * logarithm, rcond=None)[0]
        shares[:few, k] = np.exp(np.minimum.accumulate(np.minimum(x @ found, 0.0)))
        shares[few:, k] = np.minimum(shares[few:, k], shares[max(few - 1, 0), k])
    unknown = counts[-1, 1] == 0
    shares[:, unknown] = shares[:, -1:]
    return np.asarray(shares[:, :-1])
