"""Input of the estimators: the landscape of a part, and the faces of its aspects."""

from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy.spatial import ConvexHull

from resting_aspects_ros.core.aspects.aspect import find_aspects
from resting_aspects_ros.core.aspects.aspect_set import Aspect, AspectSet
from resting_aspects_ros.core.aspects.landscape import Landscape
from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.geometry.curved_edges import CurvedEdges
from resting_aspects_ros.core.geometry.polyhedron import Indices, coplanar_facets
from resting_aspects_ros.core.geometry.solid_angle import facet_angles
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.rotations import Array, rotate

# A curved side ends at facets that are narrower or wider than its own by more than this factor: at
# a fillet, or at an adjacent flat side.
MAX_WIDTH_RATIO = 3.0


class NotDefinedError(InvalidValueError):
    """A method is not defined for a part."""


class RestingShape:
    """The faces of the aspects of a part, as polygons and solid angles.

    Attributes
    ----------
    part : Part
    aspects : AspectSet
        Aspects of the part; computed if not given.
    landscape : Landscape
    """

    def __init__(self, part: Part, aspects: AspectSet | None = None) -> None:
        self.part = part
        self.landscape = Landscape(part)
        self.aspects = find_aspects(part, self.landscape) if aspects is None else aspects

    @cached_property
    def aspect_of_facets(self) -> Indices:
        """(f,) index, id - 1, of the aspect to which the part rolls from each facet."""
        aspect_of_minima = self.aspects.locate(self.landscape.directions)[0] - 1
        return np.asarray(aspect_of_minima[self.landscape.minima_of_facets])

    @cached_property
    def facet_angles(self) -> Array:
        """(f,) solid angles of the facets seen from the centre of mass, sr."""
        return facet_angles(self.landscape.hull)

    @cached_property
    def face_angles(self) -> Array:
        """(k,) solid angle of the face on which each aspect rests, sr.

        The face of a flat aspect consists of all facets within a degree of those it rests on, the
        face of a curved aspect is the curved side up to its edges. NotDefinedError if there is no
        edge between the curved side and another aspect.
        """
        return np.array([self.facet_angles[self._face(a)].sum() for a in self.aspects.aspects])

    def polygons(self) -> list[tuple[Array, float]]:
        """Return for each aspect the corners of its face (n, 2), m, and its com_height, m.

        The corners are counter-clockwise. NotDefinedError if an aspect rests on a curved side.
        """
        hull, polygons = self.landscape.hull, []
        for aspect in self.aspects.aspects:
            if aspect.sweep.curved:
                raise NotDefinedError(f'aspect {aspect.id} rests on a curved side, not a polygon')
            corners = np.unique(np.concatenate([hull.corners(f) for f in self._face(aspect)]))
            flat = rotate(aspect.orientation, hull.points[corners] * self.landscape.radius)[:, :2]
            polygons.append((flat[ConvexHull(flat).vertices], aspect.com_height))
        return polygons

    def _face(self, aspect: Aspect) -> list[int]:
        """Return the facets of the face of an aspect."""
        hull, minima = self.landscape.hull, self.landscape.minima
        own = self.aspect_of_facets[minima] == aspect.id - 1
        face: list[int] = minima[own].tolist()
        if not aspect.sweep.curved:
            return sorted({each for facet in face for each in coplanar_facets(hull, facet)})
        known = set(face)
        for facet in face:
            for edge in hull.edges_of_facets[facet]:
                other = int(hull.sides[edge].sum()) - facet
                if other not in known and self._curved[edge] and self._alike(facet, other, edge):
                    known.add(other)
                    face.append(other)
        if known & set(minima[~own].tolist()):
            raise NotDefinedError(
                f'aspect {aspect.id} rests on a curved side that continues to another '
                'aspect without an edge'
            )
        return face

    @cached_property
    def _curved(self) -> npt.NDArray[np.bool_]:
        return CurvedEdges(self.landscape.hull).curved

    def _alike(self, facet: int, other: int, edge: int) -> bool:
        """Return whether two facets have similar widths, measured from the edge between them."""
        one, two = self._width(facet, edge), self._width(other, edge)
        return max(one, two) < MAX_WIDTH_RATIO * min(one, two)

    def _width(self, facet: int, edge: int) -> float:
        """Return how far a facet extends from one of its edges, R."""
        hull = self.landscape.hull
        start, end = hull.points[hull.ends[edge]]
        arms = hull.points[hull.corners(facet)] - start
        along = (end - start) / np.linalg.norm(end - start)
        return float(np.linalg.norm(arms - np.outer(arms @ along, along), axis=1).max())
