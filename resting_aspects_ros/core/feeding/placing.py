"""Random placement of parts without overlap, on many trays at once."""

from collections.abc import Sequence

import numpy as np

from resting_aspects_ros.core.feeding.footprint import Footprint, Poses, Tray, gap
from resting_aspects_ros.core.feeding.grip_room import GripRoom, free_grip
from resting_aspects_ros.core.reorientation.markov import Mask
from resting_aspects_ros.core.statistics.intervals import Array, Counts

# Places that are tried for a part before it counts as not fitting on the tray, and the share of
# the trays on which the last part of a table fits.
TRIES, MIN_FIT = 100, 0.5


class Placing:
    """Parts on many trays, placed one after the other on all of them."""

    def __init__(
        self, tray: Tray, footprints: Sequence[Footprint], trays: int, limit: int
    ) -> None:
        self._tray = tray
        self._size = np.array([f.values for f in footprints])
        self._grips = GripRoom(tray, footprints)
        # Distance of two centres from which on neither part matters for the other.
        self._reach = np.array([footprint.reach for footprint in footprints])
        self._room = max(tray.clearance, self._grips.reach)
        self._poses = np.zeros((trays, limit, 4))  # x, y, cosine and sine of the yaw
        self._kind = np.zeros((trays, limit), dtype=np.int64)
        self._blocked = np.zeros((trays, limit), dtype=np.bool_)
        self._hit = np.zeros((trays, limit, self._grips.number), dtype=np.bool_)
        self._fitting = np.ones(trays, dtype=np.bool_)
        self._placed = 0

    def place(self, kind: Counts, generator: np.random.Generator) -> bool:
        """Place a part of a class on each tray; returns False if too few of them fit.

        A tray on which a part does not fit is not used any more.
        """
        j = self._placed
        self._kind[:, j] = kind
        self._hit[:, j] = self._grips.missing(kind)
        missing = np.flatnonzero(self._fitting)
        for _ in range(TRIES):
            self._poses[missing, j], inside = self._proposed(kind[missing], generator)
            row, other = self._near(missing, 0.0)
            touching = gap(*self._parts(row, j), *self._parts(row, other)) < 0
            hit = ~np.isin(missing, row[touching])
            missing = missing[~(hit & inside)]
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
            self._blocked[row[close], mine[close]] = True
            pair, grip = self._grips.hits(self._kind[row, mine], poses, *there).nonzero()
            self._hit[row[pair], mine[pair], grip] = True
        self._placed = j + 1
        return True

    def counts(self, classes: int) -> Counts:
        """Return the numbers of free parts and of all parts of each class, (2, k)."""
        used = self._fitting, slice(self._placed)
        kind = self._kind[used].ravel()
        free = (~self._blocked[used] & free_grip(self._hit[used])).ravel()
        return np.stack(
            [
                np.bincount(kind, weights, minlength=classes)
                for weights in (free, np.ones(len(kind)))
            ]
        )

    def clustering(self) -> float:
        """Return the covariance of two parts being free, relative to the squared free share."""
        used, number = (self._fitting, slice(self._placed)), self._placed
        free = (~self._blocked[used] & free_grip(self._hit[used])).sum(axis=1)
        mean = free.mean() / number
        pairs = (free * (free - 1)).mean() / max(number * (number - 1), 1)
        return float(pairs / mean**2 - 1) if mean > 0 and number > 1 else 0.0

    def _proposed(self, kind: Counts, generator: np.random.Generator) -> tuple[Poses, Mask]:
        """Return random poses within the tray, and whether the parts fit into it so."""
        yaw = generator.uniform(0, self._grips.turn, len(kind))
        cos, sin = np.cos(yaw), np.sin(yaw)
        a, b, radius = self._size[kind].T
        half = np.stack(
            [a * np.abs(cos) + b * np.abs(sin), a * np.abs(sin) + b * np.abs(cos)], axis=1
        )
        room = np.array(self._tray.size) / 2 - half - radius[:, None]
        place = generator.uniform(-1, 1, (len(kind), 2)) * room
        return np.column_stack([place, cos, sin]), (room >= 0).all(axis=1)

    def _near(self, trays: Counts, room: float) -> tuple[Counts, Counts]:
        """Return trays and earlier parts on them that may be within reach of the last part."""
        j = self._placed
        offset = self._poses[trays, :j, :2] - self._poses[trays, j, None, :2]
        reach = self._reach[self._kind[trays, :j]] + self._reach[self._kind[trays, j, None]] + room
        row, other = np.nonzero((offset**2).sum(axis=-1) < reach**2)
        return trays[row], other

    def _parts(self, row: Counts, part: object) -> tuple[Poses, Array]:
        return self._poses[row, part], self._size[self._kind[row, part]]  # type: ignore[index]
