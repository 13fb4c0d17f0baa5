"""The exact area of all directions from which a part rolls to each facet.

The cone of a corner consists of the directions in which that corner touches the surface. In it the
descent follows great circles away from the corner. The descents that leave the cone through an arc
of its border fill the spherical triangle between the corner and the arc, except for those that
entered the cone from other cones. So the area of a basin is the sum of the triangles of the arcs
that lead to it, where the triangles of entries are negative, as is their orientation. The areas
therefore sum to 4 pi even if noise makes the facets of the hull inconsistent. If a border leads
into another cone, its arcs follow from those of that cone, whose corner is nearer to the centre of
mass.
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
    """An arc of the border between two cones, and the stable facet to which it leads."""

    begin: Array
    end: Array
    onto: int


def basin_areas(body: Polyhedron, rest: Indices) -> Array:
    """Return the basin areas (f,), sr, whose sum is 4 pi; 0 for unstable facets.

    Parameters
    ----------
    rest : (f,) int
        For each facet the stable facet to which the descent leads.
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
            # On a nearly flat side, noise can leave a corner without a way down.
            around = np.unique(body.sides[entries])
            lowest = int(rest[around[body.heights[around].argmin()]])
            for edge in entries:
                begin, end = body.normals[body.sides[edge]]
                pieces[edge] = [BorderArc(begin, end, lowest)]
        elif entries:
            _split_entries(body, point, entries, exits, pieces)
        for edge in body.edges_of_points[corner]:
            # The cone is to the left of the arc from the right side of an outgoing edge to its
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
    np.add.at(area, onto, triangle_angles(*np.moveaxis(np.array(triangles), 1, 0)))
    return area


def _rolled_over(body: Polyhedron, edge: int, rest: Indices) -> Iterator[BorderArc]:
    """Yield the arcs of the border over an edge; from each the part rolls to a facet beside it."""
    (first, second), (one, other) = body.sides[edge].tolist(), body.margins[edge].tolist()
    begin, end = body.normals[first], body.normals[second]
    if one > 0 and other > 0:
        a, b = body.points[body.ends[edge]]
        top = a + body.feet[edge] * (b - a)
        top /= np.sqrt(top @ top)
        yield BorderArc(begin, top, int(rest[first]))
        yield BorderArc(top, end, int(rest[second]))
    else:
        # One foot is beyond the edge: the part rolls from that facet onto the other one.
        yield BorderArc(begin, end, int(rest[first if one > other else second]))


def _split_entries(
    body: Polyhedron,
    point: Array,
    entries: list[int],
    exits: list[BorderArc],
    pieces: list[list[BorderArc]],
) -> None:
    """Split the borders of entering descents where their exits lead to different facets."""
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
    separators = [after.begin for before, after in pairwise(fan) if before.onto != after.onto]
    angles = [azimuth(direction) for direction in separators]
    onto = [fan[0].onto, *(b.onto for a, b in pairwise(fan) if a.onto != b.onto)]
    for edge in entries:
        begin, end = sorted(body.normals[body.sides[edge]], key=azimuth)
        a, b = body.points[body.ends[edge]]
        first = sum(angle <= azimuth(begin) for angle in angles)
        last = sum(angle < azimuth(end) for angle in angles)
        marks = [begin]
        for direction in separators[first:last]:
            mark = _cross(_cross(point, direction), b - a)
            marks.append(mark * np.sign(mark @ (begin + end)) / np.sqrt(mark @ mark))
        marks.append(end)
        pieces[edge] = [
            BorderArc(x, y, onto[first + k]) for k, (x, y) in enumerate(pairwise(marks))
        ]


def _cross(a: Array, b: Array) -> Array:
    """Return the cross product of two vectors (3,); np.cross takes ten times as long."""
    (x, y, z), (u, v, w) = a.tolist(), b.tolist()
    return np.array([y * w - z * v, z * u - x * w, x * v - y * u])
