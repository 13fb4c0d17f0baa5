"""The potential energy of a part on a flat surface as a function of the direction of gravity.

With gravity along the unit vector d, part frame, the height of the centre of mass above the
surface is the support height s(d) = max p . d over the corners p of the hull, relative to the
centre of mass. Its minima are the stable facets, its saddles are edges on which the part balances
between two minima, and its maxima are corners on which the part balances.
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
        Edges of the hull.
    heights : (s,) float
        Height of the centre of mass on each edge, m, ascending.
    between : (s, 2) int
        The minima (indices into Landscape.minima) to which the part rolls on either side; both are
        equal if both sides lead to the same minimum.
    """

    edges: Indices
    heights: Array
    between: Indices

    def directions(self, hull: Polyhedron, which: Indices) -> Array:
        """Return unit vectors of gravity (n, 3) in some of the saddles, part frame."""
        edges = self.edges[which]
        first, second = np.moveaxis(hull.points[hull.ends[edges]], 1, 0)
        foot = first + hull.feet[edges][:, None] * (second - first)
        return np.asarray(foot / np.linalg.norm(foot, axis=1, keepdims=True))


class Landscape:
    """The critical points of the support height of a part, and the descent between them.

    Attributes
    ----------
    hull : Polyhedron
        Hull around the centre of mass, in units of ``radius``, part axes.
    radius : float
        R, m.
    error : float
        Maximum error of heights, R, because the hull is simplified.
    minima : (k,) int
        Stable facets of the hull, lowest first.
    """

    def __init__(self, part: 'Part') -> None:
        self.radius = part.hull_radius
        self.error = part.hull_error / part.hull_radius
        self.hull: Polyhedron = polyhedron(
            (part.hull_vertices - part.centre_of_mass) / self.radius
        )
        self._descent = Descent(self.hull)
        self._rest = self._descent.rest
        stable = np.flatnonzero(self._rest == np.arange(len(self._rest)))
        self.minima: Indices = stable[np.argsort(self.hull.heights[stable], kind='stable')]
        self._minimum_of_facet = np.full(len(self._rest), -1)
        self._minimum_of_facet[self.minima] = np.arange(len(self.minima))

    @property
    def directions(self) -> Array:
        """(k, 3) unit vectors of gravity in each minimum, part frame."""
        return self.hull.normals[self.minima]

    @property
    def heights(self) -> Array:
        """(k,) heights of the centre of mass in each minimum, m."""
        return np.asarray(self.hull.heights[self.minima] * self.radius)

    @property
    def minima_of_facets(self) -> Indices:
        """(f,) index into ``minima`` of the minimum to which a part rolls from each facet."""
        return self._minimum_of_facet[self._rest]

    @cached_property
    def basin_shares(self) -> Array:
        """(k,) share of the directions from which a part rolls to each minimum; their sum is 1."""
        areas = basin_areas(self.hull, self._rest)
        return np.asarray(areas[self.minima] / (4 * np.pi))

    @cached_property
    def saddles(self) -> Saddles:
        """The saddles, lowest first.

        An edge is a saddle if the foot of the perpendicular from the centre of mass is inside the
        edge, and the direction of the foot is between the normals of the adjacent facets.
        """
        hull = self.hull
        inside = (hull.feet > 0) & (hull.feet < 1)
        one, other = hull.sides.T
        onto = self._descent.onto
        # From a facet that is unstable only because of the margin, the part rolls over this edge.
        rolled = (onto[one] == other) | (onto[other] == one)
        edges = np.flatnonzero(inside & (hull.margins > 0).all(axis=1) & ~rolled)
        first, second = np.moveaxis(hull.points[hull.ends[edges]], 1, 0)
        foot = first + hull.feet[edges][:, None] * (second - first)
        heights = np.linalg.norm(foot, axis=1)
        order = np.argsort(heights, kind='stable')
        edges = edges[order]
        between = self._minimum_of_facet[self._rest[hull.sides[edges]]]
        return Saddles(edges, heights[order] * self.radius, between)

    def descend(self, directions: npt.ArrayLike) -> Indices:
        """Return the minima (n,), as indices into ``minima``, to which a released part rolls.

        Parameters
        ----------
        directions : (n, 3) float
            Unit vectors of gravity, part frame.
        """
        down = np.asarray(directions, dtype=np.float64).reshape(-1, 3)
        return np.asarray(self._minimum_of_facet[self._descent.facets_from(down)])
