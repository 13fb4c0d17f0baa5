"""Footprints of parts and grippers on a tray, and the share of the parts that are free."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.arrays import Array, Counts
from resting_aspects_ros.errors import InvalidValueError, shown
from resting_aspects_ros.statistics.markov import Mask

Poses = npt.NDArray[np.float64]
# Longer sides of a tray are probably given in mm, m.
MAX_SIDE = 50.0
# Signs of the corners along the length and along the width.
_SIGNS = np.array([[1.0, 1.0, -1.0, -1.0], [1.0, -1.0, 1.0, -1.0]])


@dataclass(frozen=True)
class Footprint:
    """A rectangle, a disc, or a rectangle with round edges: all points within a distance of it.

    length, width : float
        Sides of the rectangle, m; both 0 for a disc.
    radius : float
        Distance from the rectangle, m; 0 for a rectangle with sharp corners.
    """

    length: float
    width: float
    radius: float = 0.0

    def __post_init__(self) -> None:
        if not all(0 <= value < math.inf for value in (self.length, self.width, self.radius)):
            raise InvalidValueError(
                f'invalid footprint {self.length!r} x {self.width!r} m, radius {self.radius!r} m: '
                'expected lengths of 0 m or more'
            )

    @property
    def values(self) -> Array:
        """(3,) half length, half width and radius, m."""
        return np.array([self.length / 2, self.width / 2, self.radius])

    @property
    def reach(self) -> float:
        """Largest distance from the centre, m."""
        return math.hypot(self.length, self.width) / 2 + self.radius

    @property
    def perimeter(self) -> float:
        """Perimeter, m."""
        return 2 * (self.length + self.width) + 2 * math.pi * self.radius

    @property
    def area(self) -> float:
        """Area, m2."""
        band = 2 * (self.length + self.width) * self.radius + math.pi * self.radius**2
        return self.length * self.width + band

    @property
    def text(self) -> str:
        """Length and width in mm, or the diameter, for messages."""
        sides = [1000 * (side + 2 * self.radius) for side in (self.length, self.width)]
        if self.length == self.width == 0:
            return f'{sides[0]:.4g} mm in diameter'
        return f'{sides[0]:.4g} x {sides[1]:.4g} mm'


@dataclass(frozen=True)
class Tray:
    """The tray and the room that the gripper needs.

    A part is free if no other part is closer to it than the clearance, and none reaches into the
    footprint of the gripper.

    size : tuple of float
        Width and depth of the rectangle, m, within which all parts lie.
    clearance : float
        Minimum distance between the outline of a free part and any other outline, m.
    gripper : Footprint or None
        What the gripper covers, centred on the part and turned with it, so that its length is
        along that of the part; None: only the clearance matters.
    """

    size: tuple[float, float]
    clearance: float
    gripper: Footprint | None = None

    def __post_init__(self) -> None:
        if not all(0 < side <= MAX_SIDE for side in self.size):
            raise InvalidValueError(
                f'invalid tray {shown(self.size)} m: expected two sides of more than 0 and at '
                f'most {MAX_SIDE:g} m'
            )
        if not 0 <= self.clearance <= max(self.size):
            raise InvalidValueError(
                f'invalid clearance {self.clearance!r} m: expected 0 m or more, and at most the '
                f'longer side of the tray, {max(self.size):g} m'
            )

    @property
    def area(self) -> float:
        """Area, m2."""
        return self.size[0] * self.size[1]


def gap(poses: Poses, size: Array, other_poses: Poses, other_size: Array) -> Array:
    """Return the distances (n,) between n pairs of footprints, m; negative if they overlap.

    Where rectangles overlap, the value is minus the sum of the radii, or at most -1e-12.

    Parameters
    ----------
    poses, other_poses : (n, 4) float
        Position, m, and cosine and sine of the yaw.
    size, other_size : (n, 3) float
        Values of the footprints.
    """
    apart = np.zeros(len(poses), dtype=np.bool_)
    nearest = np.full(len(poses), np.inf)
    pairs = ((poses, size, other_poses, other_size), (other_poses, other_size, poses, size))
    for one, box, other, other_box in pairs:
        x, y = _corners(one, other, other_box)
        a, b = box[:, :1], box[:, 1:2]
        outside = np.maximum(np.abs(x) - a, 0) ** 2 + np.maximum(np.abs(y) - b, 0) ** 2
        nearest = np.minimum(nearest, np.sqrt(outside.min(axis=1)))
        # All corners of the other rectangle are beyond the line of a side of this one.
        for along, half in ((x, a[:, 0]), (y, b[:, 0])):
            apart |= (along.min(axis=1) >= half) | (along.max(axis=1) <= -half)
    rounded = size[:, 2] + other_size[:, 2]
    return np.where(apart, nearest - rounded, -np.maximum(rounded, 1e-12))


def _corners(one: Poses, other: Poses, size: Array) -> tuple[Array, Array]:
    """Return x and y (n, 4) of the corners of other rectangles, in the axes of these ones."""
    (dx, dy), (cos, sin) = (other[:, :2] - one[:, :2]).T, one[:, 2:].T
    turn_cos = cos * other[:, 2] + sin * other[:, 3]
    turn_sin = cos * other[:, 3] - sin * other[:, 2]
    a, b = size[:, 0], size[:, 1]
    x = (cos * dx + sin * dy)[:, None] + (turn_cos * a)[:, None] * _SIGNS[0]
    y = (cos * dy - sin * dx)[:, None] + (turn_sin * a)[:, None] * _SIGNS[0]
    return x - (turn_sin * b)[:, None] * _SIGNS[1], y + (turn_cos * b)[:, None] * _SIGNS[1]


# -- Random places --------------------------------------------------------------------------------


# Places that are tried for a part before it counts as not fitting on the tray, and the share of
# the trays on which the last part of a table fits.
TRIES, MIN_FIT = 100, 0.5


def random_poses(tray: Tray, sizes: Array, generator: np.random.Generator) -> tuple[Poses, Mask]:
    """Return random poses (n, 4) within the tray, and whether the parts fit into it so.

    Parameters
    ----------
    sizes : (n, 3) float
        Values of the footprints.
    """
    yaw = generator.uniform(0, math.pi, len(sizes))
    room = _room(tray, sizes, yaw)
    fits: Mask = np.asarray((room >= 0).all(axis=1))
    for size in np.unique(sizes[~fits], axis=0):
        # A long part may only fit in directions that are hardly ever drawn.
        ways, here = _fitting_yaws(tray, size), ~fits & (sizes == size).all(axis=1)
        if len(ways):
            yaw[here] = generator.choice(np.concatenate([ways, np.pi - ways]), here.sum())
            room[here] = np.maximum(_room(tray, sizes[here], yaw[here]), 0.0)
            fits[here] = True
    place = generator.uniform(-1, 1, (len(sizes), 2)) * room
    return np.column_stack([place, np.cos(yaw), np.sin(yaw)]), fits


def _room(tray: Tray, sizes: Array, yaw: Array) -> Array:
    """Return how far (n, 2) parts can be from the middle, m; negative where they do not fit."""
    a, b, radius = sizes.T
    along, across = np.abs(np.cos(yaw)), np.abs(np.sin(yaw))
    half = np.stack([a * along + b * across, a * across + b * along], axis=1)
    return np.asarray(np.array(tray.size) / 2 - half - radius[:, None])


def _fitting_yaws(tray: Tray, size: Array) -> Array:
    """Return yaws (k,) from 0 to pi / 2, rad, of many, in which a part (3,) fits on the tray."""
    yaw = np.linspace(0, math.pi / 2, 181)
    return yaw[(_room(tray, np.tile(size, (len(yaw), 1)), yaw) >= 0).all(axis=1)]


class Placing:
    """Parts on many trays, placed one after the other on all of them.

    separated : bool
        Whether parts never overlap; otherwise each lies anywhere, also on others.
    """

    def __init__(
        self,
        tray: Tray,
        footprints: Sequence[Footprint],
        trays: int,
        limit: int,
        *,
        separated: bool = True,
    ) -> None:
        self._separated = separated
        self._tray = tray
        self._size = np.array([f.values for f in footprints])
        self._gripper = None if tray.gripper is None else tray.gripper.values
        # Distance of two centres from which on neither part matters for the other.
        self._reach = np.array([footprint.reach for footprint in footprints])
        self._room = max(tray.clearance, 0.0 if tray.gripper is None else tray.gripper.reach)
        self._poses = np.zeros((trays, limit, 4))  # x, y, cosine and sine of the yaw
        self._kind = np.zeros((trays, limit), dtype=np.int64)
        self._blocked = np.zeros((trays, limit), dtype=np.bool_)
        self._fitting = np.ones(trays, dtype=np.bool_)
        self._placed = 0

    def place(self, kind: Counts, generator: np.random.Generator) -> bool:
        """Place a part of a class on each tray; returns False if too few of them fit.

        A tray on which a part does not fit is not used any more.
        """
        j = self._placed
        self._kind[:, j] = kind
        missing = np.flatnonzero(self._fitting)
        for _ in range(TRIES):
            self._poses[missing, j], inside = random_poses(
                self._tray, self._size[kind[missing]], generator
            )
            clear = np.ones(len(missing), dtype=np.bool_)
            if self._separated:
                row, other = self._near(missing, 0.0)
                touching = gap(*self._parts(row, j), *self._parts(row, other)) < 0
                clear = ~np.isin(missing, row[touching])
            missing = missing[~(clear & inside)]
            if not len(missing):
                break
        self._fitting[missing] = False
        if self._fitting.mean() < MIN_FIT:
            return False
        row, other = self._near(np.flatnonzero(self._fitting), self._room)
        for mine, theirs in ((np.full_like(other, j), other), (other, np.full_like(other, j))):
            poses, size = self._parts(row, mine)
            there = self._parts(row, theirs)
            close = gap(poses, size, *there) < self._tray.clearance
            if self._gripper is not None:
                close |= gap(poses, np.tile(self._gripper, (len(poses), 1)), *there) < 0
            self._blocked[row[close], mine[close]] = True
        self._placed = j + 1
        return True

    def counts(self, classes: int) -> Counts:
        """Return the numbers of free parts and of all parts of each class, (2, k)."""
        used = self._fitting, slice(self._placed)
        kind = self._kind[used].ravel()
        free = ~self._blocked[used].ravel()
        return np.stack(
            [
                np.bincount(kind, weights, minlength=classes)
                for weights in (free, np.ones(len(kind)))
            ]
        )

    def clustering(self) -> float:
        """Return the covariance of two parts being free, relative to the squared free share."""
        used, number = (self._fitting, slice(self._placed)), self._placed
        free = (~self._blocked[used]).sum(axis=1)
        mean = free.mean() / number
        pairs = (free * (free - 1)).mean() / max(number * (number - 1), 1)
        return float(pairs / mean**2 - 1) if mean > 0 and number > 1 else 0.0

    def _near(self, trays: Counts, room: float) -> tuple[Counts, Counts]:
        """Return trays and earlier parts on them that may be within reach of the last part."""
        j = self._placed
        offset = self._poses[trays, :j, :2] - self._poses[trays, j, None, :2]
        reach = self._reach[self._kind[trays, :j]] + self._reach[self._kind[trays, j, None]] + room
        row, other = np.nonzero((offset**2).sum(axis=-1) < reach**2)
        return trays[row], other

    def _parts(self, row: Counts, part: object) -> tuple[Poses, Array]:
        return self._poses[row, part], self._size[self._kind[row, part]]  # type: ignore[index]


# -- Density --------------------------------------------------------------------------------------


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
    tray: Tray,
    footprints: Sequence[Footprint],
    mix: Array,
    seed: int,
    number: int = 0,
    *,
    separated: bool = True,
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
    separated : bool
        Whether parts never overlap. Otherwise they lie at independent random places, and parts
        that overlap another one are not free.

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
    placing = Placing(tray, footprints, trays, limit, separated=separated)
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
    for each in footprints:
        if not len(_fitting_yaws(tray, each.values)):
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
