"""Which grips of parts on a tray have no other part in the footprint of the gripper."""

import math
from collections.abc import Sequence

import numpy as np

from resting_aspects_ros.core.feeding.footprint import Footprint, Grip, Poses, Tray, gap
from resting_aspects_ros.core.reorientation.markov import Mask
from resting_aspects_ros.core.statistics.intervals import Array, Counts


class GripRoom:
    """The grips of k classes of parts.

    Attributes
    ----------
    number : int
        Largest number of grips of a class; 0 if only the clearance matters.
    reach : float
        Largest distance from a part's centre that matters for a grip, m.
    turn : float
        Angle by which a part can be turned without a difference, rad: half a turn, if no grip is
        beside the centre of a rectangle.
    """

    def __init__(self, tray: Tray, footprints: Sequence[Footprint]) -> None:
        given = () if tray.gripper is None else (Grip(tray.gripper),)
        grips = [footprint.grips or given for footprint in footprints]
        self.number = max((len(each) for each in grips), default=0)
        self.reach = max((grip.reach for each in grips for grip in each), default=0.0)
        self.turn = 2 * math.pi if self.number else math.pi
        self._poses = np.zeros((len(grips), self.number, 4))
        self._sizes = np.zeros((len(grips), self.number, 3))
        self._missing = np.zeros((len(grips), self.number), dtype=np.bool_)
        for k, each in enumerate(grips):
            self._missing[k, len(each) :] = len(each) > 0
            for g, grip in enumerate(each):
                self._poses[k, g] = grip.x, grip.y, np.cos(grip.yaw), np.sin(grip.yaw)
                self._sizes[k, g] = grip.footprint.values

    def missing(self, kind: Counts) -> Mask:
        """Return which of the grips (..., number) parts of classes (...) do not have."""
        return np.asarray(self._missing[kind])

    def hits(self, kind: Counts, poses: Poses, other: Poses, size: Array) -> Mask:
        """Return in which grips (n, number) of n parts another part reaches.

        Parameters
        ----------
        kind : (n,) int
            Classes of the parts.
        poses, other : (n, 4) float
            Poses of the parts and of the others; see `gap`.
        size : (n, 3) float
            Values of the footprints of the others.
        """
        found = np.zeros((len(kind), self.number), dtype=np.bool_)
        cos, sin = poses[:, 2], poses[:, 3]
        for g in range(self.number):
            x, y, c, s = self._poses[kind, g].T
            place = poses[:, 0] + cos * x - sin * y, poses[:, 1] + sin * x + cos * y
            gripper = np.column_stack([*place, cos * c - sin * s, sin * c + cos * s])
            found[:, g] = gap(gripper, self._sizes[kind, g], other, size) < 0
        # A footprint of nothing is a point; a part without any grip needs no room for one.
        return found & self._sizes[kind].any(axis=-1)


def free_grip(hit: Mask) -> Mask:
    """Return whether a grip of each part (...) is free, from the hit ones (..., number)."""
    return np.asarray(~hit.all(axis=-1)) if hit.shape[-1] else np.ones(hit.shape[:-1], np.bool_)
