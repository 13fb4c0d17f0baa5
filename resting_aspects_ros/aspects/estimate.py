"""Analytic estimates of a distribution by the methods of the literature, without drops."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import ConvexHull

from resting_aspects_ros.arrays import Array, Flags, Indices
from resting_aspects_ros.aspects.aspect_set import Aspect, AspectSet
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.aspects.landscape import Landscape
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.part.hull import coplanar_facets, facet_angles, polygon_angle
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.part.tessellation import CurvedEdges
from resting_aspects_ros.rotations import rotate

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
        return np.array([self.facet_angles[self._face(a)].sum() for a in self.aspects])

    def polygons(self) -> list[tuple[Array, float]]:
        """Return for each aspect the corners of its face (n, 2), m, and its com_height, m.

        The corners are counter-clockwise. NotDefinedError if an aspect rests on a curved side.
        """
        hull, polygons = self.landscape.hull, []
        for aspect in self.aspects:
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
                if other not in known and self._continues[edge]:
                    known.add(other)
                    face.append(other)
        if known & set(minima[~own].tolist()):
            raise NotDefinedError(
                f'aspect {aspect.id} rests on a curved side that continues to another '
                'aspect without an edge'
            )
        return face

    @cached_property
    def _continues(self) -> Flags:
        """(e,) whether a curved side continues over each edge, to a facet of a similar width."""
        edges = CurvedEdges(self.landscape.hull)
        alike = edges.widths.max(axis=1) < MAX_WIDTH_RATIO * edges.widths.min(axis=1)
        return np.asarray(edges.curved & alike)


def solid_angle(shape: RestingShape) -> Array:
    """Return Omega_i."""
    return shape.face_angles


def csa(shape: RestingShape) -> Array:
    """Return Omega_i / h_i: the centroid solid angle."""
    return np.asarray(shape.face_angles / _heights(shape))


def crsa(shape: RestingShape) -> Array:
    """Return (Omega_i - mean over j of Omega_crit,ij) / h_i: the critical solid angle.

    Omega_crit,ij is the solid angle of the face seen from the height r_ij, to which the centre of
    mass rises when the part tips over edge j. All edges have the same weight, also short ones: a
    corner that is rounded in many steps has more weight than a sharp one.
    """
    critical = [_critical(polygon, height) for polygon, height in shape.polygons()]
    return np.asarray(np.maximum(shape.face_angles - critical, 0.0) / _heights(shape))


def stability(shape: RestingShape) -> Array:
    """Return A_i / h_i."""
    return np.array([_area(polygon) / height for polygon, height in shape.polygons()])


def energy_barrier(shape: RestingShape) -> Array:
    """Return the minimum energy that moves the part out of each aspect, with m g = 1."""
    return np.array([aspect.min_barrier for aspect in shape.aspects])


def quasi_static(shape: RestingShape) -> Array:
    """Return the sum of Omega over all facets of the hull that lead to each aspect.

    From an unstable facet the part tips over the edge, or the corner, beyond which its centre of
    mass is, from facet to facet, until it reaches a stable one.
    """
    count = len(shape.aspects)
    angles = np.bincount(shape.aspect_of_facets, weights=shape.facet_angles, minlength=count)
    return np.asarray(angles, dtype=np.float64)


def rolling(shape: RestingShape) -> Array:
    """Return the exact share of directions from which the part rolls into each aspect."""
    return np.array([aspect.basin_share for aspect in shape.aspects])


def _heights(shape: RestingShape) -> Array:
    return np.array([aspect.com_height for aspect in shape.aspects])


def _critical(polygon: Array, height: float) -> float:
    """Return the mean critical solid angle over the edges, sr."""
    along = np.roll(polygon, -1, axis=0) - polygon
    across = polygon[:, 0] * along[:, 1] - polygon[:, 1] * along[:, 0]
    over_edges = np.hypot(height, across / np.linalg.norm(along, axis=1))
    return float(np.mean([polygon_angle(polygon, float(r)) for r in over_edges]))


def _area(polygon: Array) -> float:
    x, y = polygon.T
    return float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum() / 2)


@dataclass(frozen=True)
class Method:
    """A method that predicts probabilities from the shape of a part.

    weights : function
        Returns the weights (k,) of the aspects by id, to which the probabilities are proportional,
        or raises NotDefinedError.
    label : str
        Display name.
    meaning : str
        Quantity to which the probability of an aspect is proportional.
    source : str
        Publication of the method.
    heading : str
        Its name as the heading of a column, in one or two short lines.
    """

    weights: Callable[[RestingShape], Array]
    label: str
    meaning: str
    source: str
    heading: str


METHODS = {
    'solid_angle': Method(
        solid_angle,
        'solid angle',
        'solid angle of its side, seen from the centre of mass',
        "Simpson's rule",
        'sol.\nang.',
    ),
    'csa': Method(
        csa,
        'centroid solid angle',
        'solid angle / height of the centre of mass',
        'Ngoi, Lim, Lee 1995',
        'csa',
    ),
    'crsa': Method(
        crsa,
        'critical solid angle',
        '(solid angle - mean critical solid angle) / height',
        'Ngoi, Lye, Chen 1996',
        'crsa',
    ),
    'stability': Method(
        stability,
        'stability',
        'area of the support / height of the centre of mass',
        'Chua, Tay 1998',
        'sta-\nbil.',
    ),
    'energy_barrier': Method(
        energy_barrier,
        'energy barrier',
        'minimum energy that moves the part out of it',
        'Boothroyd, Ho 1977',
        'bar-\nrier',
    ),
    'quasi_static': Method(
        quasi_static,
        'quasi-static',
        'solid angle of all sides that lead to the aspect',
        'Goldberg, Mirtich, Zhuang, Craig et al. 1999',
        'quasi\nstat.',
    ),
    'rolling': Method(
        rolling,
        'rolling',
        'directions from which the part rolls into the aspect',
        'Baktash, Sharp, Zhou, Crane, Jacobson 2025',
        'rol-\nling',
    ),
}


@dataclass(frozen=True, eq=False)
class Estimate:
    """The distribution that a method predicts; it has no drops.

    method : str
        One of METHODS.
    probabilities : (k,) float
        Probability of each aspect, by id from 1; their sum is 1.
    """

    aspects: AspectSet
    method: str
    probabilities: Array

    def class_probabilities(self) -> Array:
        """Return the probability (c,) of each symmetry class, by number from 1."""
        numbers = [aspect.symmetry_class for aspect in self.aspects]
        return np.asarray(np.bincount(numbers, weights=self.probabilities)[1:])


def check_method(method: str) -> None:
    """Raise InvalidValueError if there is no such method."""
    if method not in METHODS:
        raise InvalidValueError(f'invalid method {method!r}: expected one of {", ".join(METHODS)}')


def estimate(shape: RestingShape, method: str) -> Estimate:
    """Return the distribution that a method predicts for a part.

    Aspects of one symmetry class are equally probable. If a part has only one aspect, its
    probability is 1 for every method.

    Raises
    ------
    InvalidValueError
        If there is no such method.
    NotDefinedError
        If the method is not defined for this part.
    """
    check_method(method)
    aspects = shape.aspects
    if len(aspects) == 1:
        return Estimate(aspects, method, np.ones(1))
    try:
        weights = METHODS[method].weights(shape)
    except NotDefinedError as error:
        raise NotDefinedError(f'{method} is not defined for {shape.part.name}: {error}') from error
    for members in aspects.classes():
        indices = [aspect.id - 1 for aspect in members]
        weights[indices] = weights[indices].mean()
    return Estimate(aspects, method, weights / weights.sum())


def estimate_each(
    shape: RestingShape, names: Iterable[str]
) -> tuple[dict[str, Estimate], dict[str, str]]:
    """Return the estimates by method, and the reasons for methods that are not defined."""
    estimates: dict[str, Estimate] = {}
    reasons: dict[str, str] = {}
    for name in names:
        try:
            estimates[name] = estimate(shape, name)
        except NotDefinedError as error:
            reasons[name] = str(error)
    return estimates, reasons
