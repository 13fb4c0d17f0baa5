"""The potential energy of a part on a flat surface, over the direction of gravity seen from it.

With gravity along the unit vector d, part frame, the centre of mass is at the support height
s(d) = max p . d over the corners p of the hull from the centre of mass, above the surface. Its
minima are the facets on which the part can stay, its saddles edges on which it balances between
two of them, its maxima corners on which it stands on its head.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.aspects.basins import basin_areas
from resting_aspects_ros.core.aspects.descent import Descent
from resting_aspects_ros.core.geometry.polyhedron import Indices, Polyhedron, polyhedron
from resting_aspects_ros.core.rotations import Array

if TYPE_CHECKING:
    from resting_aspects_ros.core.part import Part


@dataclass(frozen=True, eq=False)
class Saddles:
    """Edges on which the part balances between two minima.

    edges : (s,) int
        Of the hull.
    heights : (s,) float
        Of the centre of mass there, m, ascending.
    between : (s, 2) int
        The minima (their places in Landscape.minima) to which it rolls on either side; the same
        twice if both sides lead to one.
    """

    edges: Indices
    heights: Array
    between: Indices


class Landscape:
    """The critical points of the support height of a part, and the descent between them.

    Attributes
    ----------
    hull : Polyhedron
        In units of ``radius`` from the centre of mass, part axes.
    radius : float
        R, m.
    minima : (k,) int
        Facets of the hull on which the part can stay, lowest first.
    """

    def __init__(self, part: 'Part') -> None:
        self.radius = part.hull_radius
        self.hull: Polyhedron = polyhedron(
            (part.hull_vertices - part.centre_of_mass) / self.radius
        )
        self._descent = Descent(self.hull)
        self._rest = self._descent.rest
        stable = np.flatnonzero(self._rest == np.arange(len(self._rest)))
        self.minima: Indices = stable[np.argsort(self.hull.heights[stable], kind='stable')]
        self._place = np.full(len(self._rest), -1)
        self._place[self.minima] = np.arange(len(self.minima))

    @property
    def directions(self) -> Array:
        """(k, 3) unit vectors of gravity seen from the part in each minimum."""
        return self.hull.normals[self.minima]

    @property
    def heights(self) -> Array:
        """(k,) heights of the centre of mass in each minimum, m."""
        return np.asarray(self.hull.heights[self.minima] * self.radius)

    @property
    def minima_of_facets(self) -> Indices:
        """(f,) the minimum, as its place in ``minima``, to which a part rolls from each facet."""
        return self._place[self._rest]

    @cached_property
    def basin_shares(self) -> Array:
        """(k,) shares of all directions that roll to each minimum; they add up to 1."""
        return np.asarray(basin_areas(self.hull, self._rest)[self.minima] / (4 * np.pi))

    @cached_property
    def saddles(self) -> Saddles:
        """The saddles, lowest first.

        An edge is one if the foot of the perpendicular from the centre of mass is inside it, and
        its direction between the normals of the facets beside it.
        """
        hull = self.hull
        inside = (hull.feet > 0) & (hull.feet < 1)
        one, other = hull.sides.T
        onto = self._descent.onto
        # A facet that is unstable by the margin alone rolls over what would be its saddle.
        rolled = (onto[one] == other) | (onto[other] == one)
        edges = np.flatnonzero(inside & (hull.margins > 0).all(axis=1) & ~rolled)
        first, second = np.moveaxis(hull.points[hull.ends[edges]], 1, 0)
        foot = first + hull.feet[edges][:, None] * (second - first)
        heights = np.linalg.norm(foot, axis=1)
        order = np.argsort(heights, kind='stable')
        edges = edges[order]
        between = self._place[self._rest[hull.sides[edges]]]
        return Saddles(edges, heights[order] * self.radius, between)

    def descend(self, directions: npt.ArrayLike) -> Indices:
        """(n,) minima, as places in ``minima``, to which a part rolls that is let go.

        Parameters
        ----------
        directions : (n, 3) float
            Unit vectors of gravity, part frame.
        """
        given = np.asarray(directions, dtype=np.float64).reshape(-1, 3)
        return np.asarray(self._place[self._descent.facets_from(given)])
