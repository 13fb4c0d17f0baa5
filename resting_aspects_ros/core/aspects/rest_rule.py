"""The energy criterion that decides in which aspect a moving part will come to rest.

The centre of mass is never lower than the support height s(d) of the down direction d. So a part
with less energy than the lowest saddle around its basin cannot leave the basin any more.
"""

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from resting_aspects_ros.core.aspects.landscape import Landscape
from resting_aspects_ros.core.geometry.polyhedron import Indices
from resting_aspects_ros.core.rotations import Array

if TYPE_CHECKING:
    from resting_aspects_ros.core.aspects.joining import JoinedMinima

# Required distance below the saddle, m g R, because an engine can add energy at impacts. Without
# it 3 of 800 drops of an L bracket were decided incorrectly, with it none.
ENERGY_MARGIN = 0.01


class RestRule:
    """The energies below which a part stays in its aspects.

    exits : (k,) float
        For each minimum of the landscape the energy above the surface, m g R, below which a part
        in its basin stays in the aspect. It is minus infinity where the barrier is below twice the
        margin: there only the stillness of the part decides.
    """

    def __init__(self, landscape: Landscape, aspects: 'list[JoinedMinima]') -> None:
        self._landscape = landscape
        aspect = np.empty(len(landscape.minima), dtype=np.int64)
        for number, joined in enumerate(aspects):
            aspect[joined.minima] = number
        saddles = landscape.saddles
        one, other = aspect[saddles.between].T
        between = one != other
        over = np.full(len(aspects), np.inf)
        for side in (one, other):
            np.minimum.at(over, side[between], saddles.heights[between] / landscape.radius)
        low = np.array([landscape.heights[a.minima].min() for a in aspects]) / landscape.radius
        too_shallow = over - low < 2 * ENERGY_MARGIN
        self.exits: Array = np.where(too_shallow, -np.inf, over - ENERGY_MARGIN)[aspect]

    @property
    def directions(self) -> Array:
        """(k, 3) unit vectors of gravity in the minima, part frame."""
        return self._landscape.directions

    def decided(self, down: Array, energy: Array) -> Indices:
        """Return the minimum (n,) to which each part rolls, or -1 if its aspect is undecided.

        ``down`` are the directions (n, 3) of gravity, ``energy`` the sums (n,) of the kinetic
        energy and the height above the surface, m g R. Above ``highest`` no aspect is decided.
        """
        minima = self._landscape.descend(down)
        return np.where(energy < self.exits[minima], minima, -1)

    @cached_property
    def highest(self) -> float:
        """The maximum of ``exits``."""
        return float(self.exits.max())
