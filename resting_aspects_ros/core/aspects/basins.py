"""The area of all directions from which a part rolls to each facet, exactly.

Within the directions in which one corner touches, the cone of the corner, the descent follows
great circles away from it. So what leaves the cone through a piece of its border fills the
spherical triangle between corner and piece, without what came in from other cones through the
border on the way: the area of a basin is the sum of the triangles over the pieces that lead to it,
those of entries negative, as is their sense of rotation. So the areas add up to 4 pi also on hulls
whose facets fit each other up to noise only. Where a border leads into another cone its pieces
follow from that one's, which is the cone of a corner nearer to the centre of mass.
"""

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from resting_aspects_ros.core.geometry.polyhedron import Indices, Polyhedron
from resting_aspects_ros.core.geometry.solid_angle import triangle_angles
from resting_aspects_ros.core.rotations import Array


class BorderArc(NamedTuple):
    """Part of a border between two cones, an arc, and the stable facet to which it leads."""

    begin: Array
    end: Array
    onto: int


def basin_areas(body: Polyhedron, rest: Indices) -> Array:
    """(f,) areas, sr, which add up to 4 pi; 0 for facets that are not stable.

    Parameters
    ----------
    rest : (f,) int
        For each facet the stable one to which the descent leads from it.
    """
    pieces: list[list[BorderArc]] = [[] for _ in body.ends]
    triangles: list[tuple[Array, Array, Array]] = []
    onto: list[int] = []
    for corner in np.argsort(np.linalg.norm(body.points, axis=1), kind='stable').tolist():
        point = body.points[corner] / np.linalg.norm(body.points[corner])
        entries, exits = [], []
        for edge in body.edges_of_points[corner]:
            foot = body.feet[edge] if body.ends[edge, 0] == corner else 1 - body.feet[edge]
            if foot <= 0:
                entries.append(edge)
                continue
            if foot < 1:
                pieces[edge] = list(_rolled_over(body, edge, rest))
            exits += pieces[edge]
        if entries and not exits:
            # On a side that is flat but for noise a corner can be left without a way down.
            around = np.unique(body.sides[entries])
            lowest = int(rest[around[body.heights[around].argmin()]])
            for edge in entries:
                begin, end = body.normals[body.sides[edge]]
                pieces[edge] = [BorderArc(begin, end, lowest)]
        elif entries:
            _lead_on(body, point, entries, exits, pieces)
        for edge in body.edges_of_points[corner]:
            # The cone is on the left of the way from the right side of an outgoing edge to its
            # left side.
            outgoing = body.ends[edge, 0] == corner
            start = body.normals[body.sides[edge, 1 if outgoing else 0]]
            stop = body.normals[body.sides[edge, 0 if outgoing else 1]]
            for piece in pieces[edge]:
                ahead = (piece.end - piece.begin) @ (stop - start) > 0
                arc = (piece.begin, piece.end) if ahead else (piece.end, piece.begin)
                triangles.append((point, *arc))
                onto.append(piece.onto)
    area = np.zeros(len(rest))
    np.add.at(area, np.array(onto), triangle_angles(*np.moveaxis(np.array(triangles), 1, 0)))
    return area


def _rolled_over(body: Polyhedron, edge: int, rest: Indices) -> Iterator[BorderArc]:
    """The border over an edge that carries the part: it rolls to the facets at its sides."""
    (first, second), (one, other) = body.sides[edge].tolist(), body.margins[edge].tolist()
    begin, end = body.normals[first], body.normals[second]
    if one > 0 and other > 0:
        a, b = body.points[body.ends[edge]]
        top = a + body.feet[edge] * (b - a)
        top /= np.sqrt(top @ top)
        yield BorderArc(begin, top, int(rest[first]))
        yield BorderArc(top, end, int(rest[second]))
    else:
        # One foot is beyond the edge: the part rolls from its facet onto the other one.
        yield BorderArc(begin, end, int(rest[first if one > other else second]))


def _lead_on(
    body: Polyhedron,
    point: Array,
    entries: list[int],
    exits: list[BorderArc],
    pieces: list[list[BorderArc]],
) -> None:
    """Cut the borders through which the descent comes in where it parts on the way out."""
    if len({piece.onto for piece in exits}) == 1:
        for edge in entries:
            begin, end = body.normals[body.sides[edge]]
            pieces[edge] = [BorderArc(begin, end, exits[0].onto)]
        return
    forward = np.sum([piece.begin + piece.end for piece in exits], axis=0)
    forward = forward - (forward @ point) * point
    sideways = _cross(point, forward)

    def azimuth(direction: Array) -> float:
        return math.atan2(direction @ sideways, direction @ forward)

    fan = []
    for piece in exits:
        begin, end = sorted((piece.begin, piece.end), key=azimuth)
        fan.append(BorderArc(begin, end, piece.onto))
    fan.sort(key=lambda piece: azimuth(piece.begin) + azimuth(piece.end))
    parting = [after.begin for before, after in pairwise(fan) if before.onto != after.onto]
    angles = [azimuth(direction) for direction in parting]
    onto = [fan[0].onto, *(b.onto for a, b in pairwise(fan) if a.onto != b.onto)]
    for edge in entries:
        begin, end = sorted(body.normals[body.sides[edge]], key=azimuth)
        a, b = body.points[body.ends[edge]]
        first = sum(angle <= azimuth(begin) for angle in angles)
        last = sum(angle < azimuth(end) for angle in angles)
        marks = [begin]
        for direction in parting[first:last]:
            mark = _cross(_cross(point, direction), b - a)
            marks.append(mark * np.sign(mark @ (begin + end)) / np.sqrt(mark @ mark))
        marks.append(end)
        pieces[edge] = [
            BorderArc(x, y, onto[first + k]) for k, (x, y) in enumerate(pairwise(marks))
        ]


def _cross(a: Array, b: Array) -> Array:
    """Of two vectors (3,): numpy's takes ten times as long for so little."""
    (x, y, z), (u, v, w) = a.tolist(), b.tolist()
    return np.array([y * w - z * v, z * u - x * w, x * v - y * u])
