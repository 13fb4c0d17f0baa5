"""What the estimators look at: the landscape of a part, and the faces of its aspects."""

from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy.spatial import ConvexHull

from resting_aspects_ros.core.aspects.aspect import facets_at, find_aspects
from resting_aspects_ros.core.aspects.aspect_set import Aspect, AspectSet
from resting_aspects_ros.core.aspects.joining import is_curved
from resting_aspects_ros.core.aspects.landscape import Landscape
from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.geometry.polyhedron import Indices
from resting_aspects_ros.core.geometry.solid_angle import facet_angles
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.rotations import Array, rotate

# Where a curved side meets facets that are narrower or wider than its own by more than this it
# ends: at a fillet, or at a flat side that it runs into.
NARROWER = 3.0


class NotDefinedError(InvalidValueError):
    """A method says nothing about a part."""


class RestingShape:
    """A part with its aspects, as polygons and solid angles.

    Attributes
    ----------
    part : Part
    aspects : AspectSet
        Of the part; found, if they are not known.
    landscape : Landscape
    """

    def __init__(self, part: Part, aspects: AspectSet | None = None) -> None:
        self.part = part
        self.landscape = Landscape(part)
        self.aspects = find_aspects(part, self.landscape) if aspects is None else aspects

    @cached_property
    def aspect_of_facets(self) -> Indices:
        """(f,) place, id - 1, of the aspect to which the part rolls from each facet."""
        of_minima = self.aspects.locate(self.landscape.directions)[0] - 1
        return np.asarray(of_minima[self.landscape.minima_of_facets])

    @cached_property
    def facet_angles(self) -> Array:
        """(f,) solid angles of the facets seen from the centre of mass, sr."""
        return facet_angles(self.landscape.hull)

    @cached_property
    def face_angles(self) -> Array:
        """(k,) solid angle of the face on which each aspect rests, sr.

        Of flat ones all facets within a degree of those it rests on; else the curved side, up to
        its edges. NotDefinedError if it has none before it is that of another aspect, too.
        """
        return np.array([self.facet_angles[self._face(a)].sum() for a in self.aspects.aspects])

    def polygons(self) -> list[tuple[Array, float]]:
        """For each aspect the corners of its face (n, 2), m, counter-clockwise, and com_height, m.

        NotDefinedError if one rests on a curved side.
        """
        hull, found = self.landscape.hull, []
        for aspect in self.aspects.aspects:
            if aspect.sweep.curved:
                raise NotDefinedError(f'aspect {aspect.id} rests on a curved side, not a polygon')
            corners = np.unique(np.concatenate([hull.corners(f) for f in self._face(aspect)]))
            flat = rotate(aspect.orientation, hull.points[corners] * self.landscape.radius)[:, :2]
            found.append((flat[ConvexHull(flat).vertices], aspect.com_height))
        return found

    def _face(self, aspect: Aspect) -> list[int]:
        """The facets of the face of an aspect."""
        hull, minima = self.landscape.hull, self.landscape.minima
        own = self.aspect_of_facets[minima] == aspect.id - 1
        face: list[int] = minima[own].tolist()
        if not aspect.sweep.curved:
            return sorted({each for facet in face for each in facets_at(hull, facet)})
        known = set(face)
        for facet in face:
            for edge in hull.edges_of_facets[facet]:
                other = int(hull.sides[edge].sum()) - facet
                if other not in known and self._curved[edge] and self._alike(facet, other, edge):
                    known.add(other)
                    face.append(other)
        if known & set(minima[~own].tolist()):
            raise NotDefinedError(
                f'aspect {aspect.id} rests on a curved side that goes on to another aspect '
                'without an edge between'
            )
        return face

    @cached_property
    def _curved(self) -> npt.NDArray[np.bool_]:
        return is_curved(self.landscape.hull)

    def _alike(self, facet: int, other: int, edge: int) -> bool:
        """Whether two facets of a mesh are about as wide, seen from the edge between them."""
        one, two = self._width(facet, edge), self._width(other, edge)
        return max(one, two) < NARROWER * min(one, two)

    def _width(self, facet: int, edge: int) -> float:
        """How far a facet reaches from one of its edges, R."""
        hull = self.landscape.hull
        start, end = hull.points[hull.ends[edge]]
        arms = hull.points[hull.corners(facet)] - start
        along = (end - start) / np.linalg.norm(end - start)
        return float(np.linalg.norm(arms - np.outer(arms @ along, along), axis=1).max())
