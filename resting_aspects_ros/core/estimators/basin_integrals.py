"""Integrals over the basins of a landscape, of functions of the support height.

A basin consists of spherical triangles with a corner of the body as their first point (see
`core.aspects.basins`). In the cone of a corner p the support height is |p| cos(t) at the angle t
from p. So the integral over t has a closed form if the function has a known antiderivative, and
only the azimuth about p is integrated numerically. The results do not depend on the orientation of
the part or on the division of its mesh.
"""

from collections.abc import Callable
from functools import cached_property

import numpy as np

from resting_aspects_ros.core.aspects.landscape import Landscape
from resting_aspects_ros.core.geometry.polyhedron import Indices
from resting_aspects_ros.core.rotations import Array

# Nodes of the quadrature over the azimuth of a triangle.
NODES = 16
# Arcs closer than this to a corner, or to a great circle through it, have no area.
_NO_AREA = 1e-12


class BasinIntegrals:
    """Integrals over the basins of aspects, sr.

    owners : (k,) int
        For each minimum of the landscape the index of its aspect.
    """

    def __init__(self, landscape: Landscape, owners: Indices, aspects: int) -> None:
        self._landscape = landscape
        self._aspects = aspects
        triangles = landscape.basin_triangles
        of_facets = np.full(len(landscape.hull.normals), -1)
        of_facets[landscape.minima] = owners
        self._owners = of_facets[triangles.onto]
        self._radii = triangles.radii

    def integral(self, antiderivative: Callable[[Array], Array]) -> Array:
        """Return the integrals (k,) over the basins of a function of the support height in R.

        ``antiderivative`` is that of the function, for arrays of any shape.
        """
        cosines, weights = self._nodes
        top, radii = antiderivative(self._radii), self._radii
        inner = (top[:, None] - antiderivative(radii[:, None] * cosines)) / radii[:, None]
        found = np.zeros(self._aspects)
        np.add.at(found, self._owners, (weights * inner).sum(axis=1))
        return found

    @cached_property
    def _nodes(self) -> tuple[Array, Array]:
        """Cosines (n, m) of the angles from the corner to the nodes on the arcs, and weights."""
        at, begin, end = np.moveaxis(self._landscape.basin_triangles.corners, 1, 0)
        normal = np.cross(begin, end)
        first = begin - (begin * at).sum(axis=1, keepdims=True) * at
        last = end - (end * at).sum(axis=1, keepdims=True) * at
        turn = np.arctan2((at * np.cross(first, last)).sum(axis=1), (first * last).sum(axis=1))
        length = np.linalg.norm(first, axis=1)
        lift = (normal * at).sum(axis=1)
        flat = (length < _NO_AREA) | (np.abs(lift) < _NO_AREA)
        first = first / np.where(flat, 1.0, length)[:, None]
        second = np.cross(at, first)
        nodes, weights = np.polynomial.legendre.leggauss(NODES)
        azimuth = turn[:, None] * (nodes + 1) / 2
        towards = np.cos(azimuth) * (normal * first).sum(axis=1)[:, None]
        towards += np.sin(azimuth) * (normal * second).sum(axis=1)[:, None]
        lift = np.where(flat, 1.0, lift)
        cosines = -towards * np.sign(lift)[:, None] / np.hypot(towards, lift[:, None])
        return cosines, np.where(flat, 0.0, turn)[:, None] * weights / 2
