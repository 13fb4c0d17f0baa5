"""The energy criterion that decides in which aspect a moving part will come to rest.

The centre of mass is never lower than the support height s(d) of the down direction d. So a part
with less energy than the lowest saddle around its basin cannot leave the basin any more.
"""

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from resting_aspects_ros.core.aspects.landscape import Landscape
from resting_aspects_ros.core.geometry.polyhedron import SAME_FACET, Indices
from resting_aspects_ros.core.geometry.tessellation import CURVED_STEP
from resting_aspects_ros.core.rotations import Array

if TYPE_CHECKING:
    from resting_aspects_ros.core.aspects.joining import JoinedMinima

# Required distance below the saddle, m g R, because an engine can add energy at impacts. Without
# it 3 of 800 drops of an L bracket were decided incorrectly, with it none.
ENERGY_MARGIN = 0.01
# The directions of a round side all around are in a plane, and their mean is zero, within this
# share; at least this number of flats is a round side.
ROUND, MIN_AROUND = 0.1, 8
# Maximum angle, rad, between the direction of gravity and that of the flat side of a part that
# lies on it while it slides.
FLAT_ANGLE = 0.005


class RestRule:
    """The energies below which a part stays in its aspects.

    exits : (k,) float
        For each minimum of the landscape the energy above the surface, m g R, below which a part
        in its basin stays in the aspect. It is minus infinity where the barrier is below twice the
        margin: there only the stillness of the part decides.
    margins : (k,) float
        For each minimum the distance, R, on the surface from the point below the centre of mass
        to the nearest edge of the flat side on which the part lies, or to the nearest end of the
        line on which it rolls.
    rollers : (k, 3) float
        Axes of round sides all around, on which the part can roll for ever; zero for others.
    """

    def __init__(self, landscape: Landscape, aspects: 'list[JoinedMinima]') -> None:
        self.landscape = landscape
        aspect = np.empty(len(landscape.minima), dtype=np.int64)
        for number, joined in enumerate(aspects):
            aspect[joined.minima] = aspect[joined.drained] = number
        saddles = landscape.saddles
        one, other = aspect[saddles.between].T
        between = one != other
        over = np.full(len(aspects), np.inf)
        for side in (one, other):
            np.minimum.at(over, side[between], saddles.heights[between] / landscape.radius)
        low = np.array([landscape.heights[a.minima].min() for a in aspects]) / landscape.radius
        too_shallow = over - low < 2 * ENERGY_MARGIN
        self.margins: Array = _margins(landscape)
        self.exits: Array = np.where(too_shallow, -np.inf, over - ENERGY_MARGIN)[aspect]
        # A part in such a minimum may stay there, in no aspect.
        self.exits[np.concatenate([a.drained for a in aspects])] = -np.inf
        self.rollers = np.zeros((len(aspect), 3))
        for joined in aspects:
            self._roll(joined)

    @property
    def directions(self) -> Array:
        """(k, 3) unit vectors of gravity in the minima, part frame."""
        return self.landscape.directions

    def _roll(self, joined: 'JoinedMinima') -> None:
        """Set rollers and margins of the minima of a round side on which the part can roll."""
        hull = self.landscape.hull
        level = self.directions[joined.minima[: joined.level]]
        if joined.level < MIN_AROUND or np.linalg.norm(level.mean(axis=0)) > ROUND:
            return
        size, axes = np.linalg.svd(level, full_matrices=False)[1:]
        if size[2] > ROUND * size[1]:
            return
        azimuth = np.sort(np.arctan2(*(level @ axes[:2].T).T))
        if np.diff(azimuth, append=azimuth[0] + 2 * np.pi).max() > 2 * CURVED_STEP:
            return
        for minimum in joined.minima:
            along = hull.points[hull.corners(self.landscape.minima[minimum])] @ axes[2]
            self.margins[minimum] = max(0.0, min(along.max(), -along.min()))
            self.rollers[minimum] = axes[2]

    def decided(self, down: Array, energy: Array) -> Indices:
        """Return the minimum (n,) to which each part rolls, or -1 if its aspect is undecided.

        ``down`` are the directions (n, 3) of gravity, ``energy`` the sums (n,) of the kinetic
        energy and the height above the surface, m g R. Above ``highest`` no aspect is decided.
        """
        minima = self.landscape.descend(down)
        return np.where(energy < self.exits[minima], minima, -1)

    def sliding(self, down: Array, tipping: Array, energy: Array) -> Indices:
        """Return the minimum (n,) in which a flat sliding part stays, or -1 if it is undecided.

        The surface pushes such a part with its weight at a distance below the centre of mass, and
        friction turns it with at most ``tipping``. While the distance at which the weight balances
        this is less than half of that to the nearest edge, the part cannot tip over the edge.

        Parameters
        ----------
        down : (n, 3) float
            Directions of gravity, part frame, unit vectors.
        tipping : (n,) float
            Maximum tipping moment on a part, m g R.
        energy : (n,) float
            Height above the surface and kinetic energy without that of the sliding, m g R.
        """
        minima = self.landscape.descend(down)
        flat = (self.directions[minima] * down).sum(axis=1) > np.cos(FLAT_ANGLE)
        stays = flat & (tipping < self.margins[minima] / 2) & (energy < self.exits[minima])
        return np.where(stays, minima, -1)

    @cached_property
    def highest(self) -> float:
        """The maximum of ``exits``."""
        return float(self.exits.max())


def _margins(landscape: Landscape) -> Array:
    hull = landscape.hull
    edges = hull.angles > SAME_FACET
    found = np.full(len(hull.normals), np.inf)
    for side in (0, 1):
        np.minimum.at(found, hull.sides[edges, side], hull.margins[edges, side])
    return np.asarray(found[landscape.minima])
