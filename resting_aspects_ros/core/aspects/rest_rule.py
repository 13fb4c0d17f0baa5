"""When it is decided in which aspect a moving part will rest: by its energy alone.

Its centre of mass is never lower than the support height s(d) of its down direction d, so that a
part with less energy than the lowest saddle around its basin can no longer leave it, whatever it
still does.
"""

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from resting_aspects_ros.core.aspects.landscape import Landscape
from resting_aspects_ros.core.geometry.polyhedron import Indices
from resting_aspects_ros.core.rotations import Array

if TYPE_CHECKING:
    from resting_aspects_ros.core.aspects.joining import JoinedMinima

# Below the saddle by this, m g R: at impacts an engine can add a little energy. Without it 3 of
# 800 drops of an L bracket were decided wrongly, with it none.
ENERGY_MARGIN = 0.01


class RestRule:
    """The energies below which a part stays in its aspects.

    exits : (k,) float
        For each minimum of the landscape the energy, m g R above the surface, below which a part
        in its basin stays in the aspect. Minus infinity where the barrier is below twice the
        margin: there only stillness tells.
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
        barred = over - low < 2 * ENERGY_MARGIN
        self.exits: Array = np.where(barred, -np.inf, over - ENERGY_MARGIN)[aspect]

    @property
    def directions(self) -> Array:
        """(k, 3) unit vectors of gravity, part frame, in the minima."""
        return self._landscape.directions

    def decided(self, down: Array, energy: Array) -> Indices:
        """(n,) minima to which parts roll whose aspect is decided; -1 while it is open.

        Of the directions (n, 3) of gravity and the energies (n,), kinetic and of the height above
        the surface, m g R; from ``highest`` on nothing is decided.
        """
        minima = self._landscape.descend(down)
        return np.where(energy < self.exits[minima], minima, -1)

    @cached_property
    def highest(self) -> float:
        """The highest exit."""
        return float(self.exits.max())
