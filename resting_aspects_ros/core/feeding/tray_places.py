"""Places of parts on a simulated tray: by the density model, or outlines without overlap."""

import math
from typing import Protocol

import numpy as np

from resting_aspects_ros.core.feeding.controller_model import ControllerModel
from resting_aspects_ros.core.feeding.footprint import Poses, gap
from resting_aspects_ros.core.feeding.grip_room import GripRoom, free_grip
from resting_aspects_ros.core.reorientation.markov import Mask
from resting_aspects_ros.core.statistics.intervals import Array, Counts

# Random places that are tried for a part; if none is empty, the part lies on another one.
TRIES = 60
_AT_ONCE = 4


class Places(Protocol):
    """Places of the parts on a tray, in their order."""

    def shake(self, classes: Counts) -> None:
        """Give parts of these classes (n,) new places; nothing else is on the tray."""

    def add(self, classes: Counts) -> None:
        """Add places for the last of the classes (n,), which do not have a place yet."""

    def keep(self, which: Mask) -> None:
        """Remove all but some of the parts."""

    def clearance(self) -> Array:
        """Return the distance (n,) of each part from others, m; -1 where the gripper is blocked.

        The density model knows only the clearance that is needed, and -1.
        """


class DensityPlaces:
    """Places by the share of free parts, without positions.

    A part in a new place is free with the probability of the table. If parts are added, some of
    the free ones become blocked. If parts are removed, no other part becomes free, because only
    free parts are picked, which block none.
    """

    def __init__(self, model: ControllerModel, generator: np.random.Generator) -> None:
        self._model, self._generator = model, generator
        self._is_free: Mask = np.zeros(0, dtype=np.bool_)

    def shake(self, classes: Counts) -> None:  # noqa: D102
        self._is_free = self._generator.random(len(classes)) < self._share(len(classes), classes)

    def add(self, classes: Counts) -> None:  # noqa: D102
        before, now = len(self._is_free), len(classes)
        old, new = self._share(before, classes), self._share(now, classes)
        chance = np.where(np.arange(now) < before, new / np.maximum(old, 1e-12), new)
        free = np.append(self._is_free, np.ones(now - before, dtype=np.bool_))
        self._is_free = free & (self._generator.random(now) < chance)

    def keep(self, which: Mask) -> None:  # noqa: D102
        self._is_free = self._is_free[which]

    def clearance(self) -> Array:  # noqa: D102
        return np.where(self._is_free, self._model.feeder.tray.clearance, -1.0)

    def _share(self, number: int, classes: Counts) -> Array:
        return self._model.free(np.array(float(number)))[classes]


class RandomPlaces:
    """Random positions of the footprints on the tray, which stay until the next vibration."""

    def __init__(self, model: ControllerModel, generator: np.random.Generator) -> None:
        self._tray, self._generator = model.feeder.tray, generator
        self._grips = GripRoom(self._tray, model.feeder.footprints)
        self._kinds: Counts = np.zeros(0, dtype=np.int64)
        self._sizes = np.array([footprint.values for footprint in model.feeder.footprints])
        self._poses: Poses = np.zeros((0, 4))
        self._size: Array = np.zeros((0, 3))

    def shake(self, classes: Counts) -> None:  # noqa: D102
        self.keep(np.zeros(len(self._kinds), dtype=np.bool_))
        self.add(classes)

    def add(self, classes: Counts) -> None:  # noqa: D102
        for kind in classes[len(self._poses) :]:
            pose = self._empty_place(self._sizes[kind])
            self._poses = np.vstack([self._poses, pose])
            self._size = np.vstack([self._size, self._sizes[kind]])
            self._kinds = np.append(self._kinds, kind)

    def keep(self, which: Mask) -> None:  # noqa: D102
        self._poses, self._size = self._poses[which], self._size[which]
        self._kinds = self._kinds[which]

    def clearance(self) -> Array:  # noqa: D102
        number = len(self._poses)
        one, other = np.nonzero(~np.eye(number, dtype=np.bool_))
        found = np.full(number, math.inf)
        if not len(one):
            return found
        there = self._poses[other], self._size[other]
        np.minimum.at(found, one, gap(self._poses[one], self._size[one], *there))
        hit = self._grips.missing(self._kinds)
        pair, grip = self._grips.hits(self._kinds[one], self._poses[one], *there).nonzero()
        hit[one[pair], grip] = True
        found[~free_grip(hit)] = -1.0
        return found

    def _empty_place(self, size: Array) -> Poses:
        """Return the first of random poses (4,) in which a part overlaps no other."""
        for _ in range(TRIES // _AT_ONCE):
            yaw = self._generator.uniform(0, self._grips.turn, _AT_ONCE)
            cos, sin = np.cos(yaw), np.sin(yaw)
            a, b, radius = size
            along, across = np.abs(cos), np.abs(sin)
            half = np.stack([a * along + b * across, a * across + b * along], axis=1)
            room = np.array(self._tray.size) / 2 - half - radius
            place = self._generator.uniform(-1, 1, (_AT_ONCE, 2)) * np.maximum(room, 0.0)
            poses = np.column_stack([place, cos, sin])
            number = len(self._poses)
            empty = (room >= 0).all(axis=1)
            if number:
                row = np.repeat(np.arange(_AT_ONCE), number)
                other = np.tile(np.arange(number), _AT_ONCE)
                mine = np.broadcast_to(size, (len(row), 3))
                apart = gap(poses[row], mine, self._poses[other], self._size[other])
                empty &= apart.reshape(_AT_ONCE, number).min(axis=1) >= 0
            if empty.any():
                return np.asarray(poses[int(empty.argmax())])
        return np.asarray(poses[0])
