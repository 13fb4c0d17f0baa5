"""The potential energy of a part on a flat surface as a function of the direction of gravity."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.arrays import Array, Indices
from resting_aspects_ros.part.hull import SAME_FACET, Polyhedron, polyhedron, triangle_angles
from resting_aspects_ros.part.tessellation import CURVED_STEP

if TYPE_CHECKING:
    from resting_aspects_ros.aspects.find import JoinedMinima
    from resting_aspects_ros.part.part import Part


# -- Descent --------------------------------------------------------------------------------------


# A part can rest on a facet if its centre of mass is inside the facet by more than this, R. Less
# is indistinguishable from the noise of float32 coordinates, and any disturbance tips the part
# over. For slender parts the margin is less: this share of the width of the facet.
STABLE_MARGIN, MARGIN_SHARE = 1e-4, 0.01
# Number of array elements that are processed at once, to limit the memory.
_BATCH = 4_000_000


class Descent:
    """The steepest descent on a polyhedron.

    onto : (f,) int
        For each facet the next facet to which a part rolls; itself if it is stable.
    rest : (f,) int
        For each facet the stable facet to which a part released on it rolls.
    """

    def __init__(self, body: Polyhedron) -> None:
        self._body = body
        around = body.edges_of_points
        self._width = max(map(len, around))
        self._edges = np.full((len(around), self._width), -1)
        for point, edges in enumerate(around):
            self._edges[point, : len(edges)] = edges
        self.onto = self.rest = self._without_cycles(self._onto())
        while (self.rest[self.rest] != self.rest).any():
            self.rest = self.rest[self.rest]

    def facets_from(self, directions: Array) -> Indices:
        """Return the stable facets (n,) to which a part rolls from unit vectors (n, 3)."""
        found = np.empty(len(directions), dtype=np.int64)
        for chunk in _slices(len(directions), len(self._body.points)):
            # Not a matrix product, because its rounding depends on the number of rows.
            x, y, z = directions[chunk].T[:, :, None]
            px, py, pz = self._body.points.T
            found[chunk] = (x * px + y * py + z * pz).argmax(axis=1)
        for chunk in _slices(len(directions), 9 * self._width):
            found[chunk] = self.rest[self._first_facets(directions[chunk], found[chunk])]
        return found

    def _first_facets(self, directions: Array, corner: Indices) -> Indices:
        """Return the facet on which each part first lies when it pivots about a corner."""
        body = self._body
        found = np.empty(len(directions), dtype=np.int64)
        left = np.arange(len(directions))
        d = directions
        while len(left):
            edge, d = self._next_edge(d, corner)
            second = body.ends[edge, 1] == corner
            other = np.where(second, body.ends[edge, 0], body.ends[edge, 1])
            foot = np.where(second, 1 - body.feet[edge], body.feet[edge])
            over = foot < 1
            found[left[over]] = self._over_edge(edge[over], d[over])
            left, d, corner = left[~over], d[~over], other[~over]
        return found

    def _next_edge(self, d: Array, corner: Indices) -> tuple[Indices, Array]:
        """Return the edge that each part touches next, and its down direction then."""
        p = self._body.points[corner]
        away = (p * d).sum(axis=1, keepdims=True) * d - p
        length = np.linalg.norm(away, axis=1, keepdims=True)
        # Exactly above the corner every direction leads down; any of them is valid.
        axis = np.eye(3)[np.abs(d).argmin(axis=1)]
        along = np.cross(d, axis)
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        away = np.where(length > 1e-12, away / np.maximum(length, 1e-300), along)
        edges = self._edges[corner]
        ends = self._body.ends[edges]
        other = np.where(ends[..., 1] == corner[:, None], ends[..., 0], ends[..., 1])
        gap = p[:, None, :] - self._body.points[other]
        now = np.maximum((gap * d[:, None, :]).sum(axis=2), 0.0)
        rate = (gap * away[:, None, :]).sum(axis=2)
        angle = np.arctan2(now, -rate)
        angle[edges < 0] = np.inf
        first = angle.argmin(axis=1)
        rows = np.arange(len(d))
        turn = angle[rows, first][:, None]
        moved = np.cos(turn) * d + np.sin(turn) * away
        return edges[rows, first], moved / np.linalg.norm(moved, axis=1, keepdims=True)

    def _over_edge(self, edge: Indices, d: Array) -> Indices:
        """Return the facet to which each part rolls over an edge, away from the balance on it."""
        body = self._body
        a, b = np.moveaxis(body.points[body.ends[edge]], 1, 0)
        turn = np.cross(body.tops(edge), b - a)
        lean = (d * turn).sum(axis=1)
        first, second = body.sides[edge].T
        towards = ((body.normals[second] - body.normals[first]) * turn).sum(axis=1)
        return np.asarray(np.where((lean > 0) == (towards > 0), second, first))

    def _onto(self) -> Indices:
        """Return for each facet the facet that follows; itself if it is stable."""
        body = self._body
        onto = np.arange(len(body.normals))
        pivots: list[tuple[int, int]] = []
        for facet, edges in enumerate(body.edges_of_facets):
            which = (body.sides[edges, 1] == facet).astype(int)
            margin = body.margins[edges, which]
            needed = STABLE_MARGIN
            if 0 < margin.min() <= needed:
                needed = min(needed, MARGIN_SHARE * self._width_of(facet))
            if margin.min() > needed:
                continue
            ends = body.points[body.ends[edges]]
            at = np.clip(body.feet[edges], 0.0, 1.0)[:, None]
            nearest = ends[:, 0] + at * (ends[:, 1] - ends[:, 0])
            distance = np.linalg.norm(nearest - body.heights[facet] * body.normals[facet], axis=1)
            distance[margin > needed] = np.inf
            k = int(distance.argmin())
            edge = edges[k]
            if 0.0 < at[k, 0] < 1.0:
                onto[facet] = body.sides[edge, 1 - which[k]]
            else:
                pivots.append((facet, int(body.ends[edge, int(at[k, 0])])))
        if pivots:
            facets, corners = np.array(pivots).T
            onto[facets] = self._first_facets(body.normals[facets], corners)
        return onto

    def _width_of(self, facet: int) -> float:
        """Return the minimum width of a facet, R."""
        body = self._body
        ends = body.points[body.ends[body.edges_of_facets[facet]]]
        out = np.cross(ends[:, 1] - ends[:, 0], body.normals[facet])
        out /= np.linalg.norm(out, axis=1, keepdims=True)
        return float(np.ptp(body.points[body.corners(facet)] @ out.T, axis=0).min())

    def _without_cycles(self, onto: Indices) -> Indices:
        """Make the lowest facet of each cycle stable; noise causes cycles of nearby facets."""
        seen = np.full(len(onto), -1)  # the facet from which each was reached first
        for start in range(len(onto)):
            facet = start
            while seen[facet] < 0:
                seen[facet] = start
                facet = int(onto[facet])
            if seen[facet] != start:
                continue
            cycle = [facet]
            while onto[cycle[-1]] != facet:
                cycle.append(int(onto[cycle[-1]]))
            lowest = min(cycle, key=lambda k: float(self._body.heights[k]))
            onto[lowest] = lowest
        return onto


def _slices(count: int, width: int) -> Iterator[slice]:
    """Return slices of rows of ``width`` numbers that are processed at once."""
    step = max(1, _BATCH // width)
    return (slice(first, first + step) for first in range(0, count, step))


# -- Basins ---------------------------------------------------------------------------------------


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


# -- Landscape ------------------------------------------------------------------------------------


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
        foot = hull.tops(self.edges[which])
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
        heights = np.linalg.norm(hull.tops(edges), axis=1)
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


# -- The rule of rest -----------------------------------------------------------------------------


# Required distance below the saddle, m g R, because an engine can add energy at impacts. Without
# it 3 of 800 drops of an L bracket were decided incorrectly, with it none.
ENERGY_MARGIN = 0.01
# The directions of a round side all around are in a plane, and their mean is zero, within this
# share; at least this number of flats is a round side.
ROUND, MIN_AROUND = 0.1, 8
# Maximum angle, rad, between the direction of gravity and that of the flat side of a part that
# lies on it while it slides.
FLAT_ANGLE = 0.005


class RestRule:
    """The energies below which a part stays in its aspects.

    exits : (k,) float
        For each minimum of the landscape the energy above the surface, m g R, below which a part
        in its basin stays in the aspect. It is minus infinity where the barrier is below twice the
        margin: there only the stillness of the part decides.
    margins : (k,) float
        For each minimum the distance, R, on the surface from the point below the centre of mass
        to the nearest edge of the flat side on which the part lies, or to the nearest end of the
        line on which it rolls.
    rollers : (k, 3) float
        Axes of round sides all around, on which the part can roll for ever; zero for others.
    """

    def __init__(self, landscape: Landscape, aspects: 'list[JoinedMinima]') -> None:
        self.landscape = landscape
        aspect = np.empty(len(landscape.minima), dtype=np.int64)
        for number, joined in enumerate(aspects):
            aspect[joined.minima] = aspect[joined.drained] = number
        saddles = landscape.saddles
        one, other = aspect[saddles.between].T
        between = one != other
        over = np.full(len(aspects), np.inf)
        for side in (one, other):
            np.minimum.at(over, side[between], saddles.heights[between] / landscape.radius)
        low = np.array([landscape.heights[a.minima].min() for a in aspects]) / landscape.radius
        too_shallow = over - low < 2 * ENERGY_MARGIN
        self.margins: Array = _margins(landscape)
        self.exits: Array = np.where(too_shallow, -np.inf, over - ENERGY_MARGIN)[aspect]
        # A part in such a minimum may stay there, in no aspect.
        self.exits[np.concatenate([a.drained for a in aspects])] = -np.inf
        self.rollers = np.zeros((len(aspect), 3))
        for joined in aspects:
            self._roll(joined)

    @property
    def directions(self) -> Array:
        """(k, 3) unit vectors of gravity in the minima, part frame."""
        return self.landscape.directions

    def _roll(self, joined: 'JoinedMinima') -> None:
        """Set rollers and margins of the minima of a round side on which the part can roll."""
        hull = self.landscape.hull
        level = self.directions[joined.minima[: joined.level]]
        if joined.level < MIN_AROUND or np.linalg.norm(level.mean(axis=0)) > ROUND:
            return
        size, axes = np.linalg.svd(level, full_matrices=False)[1:]
        if size[2] > ROUND * size[1]:
            return
        azimuth = np.sort(np.arctan2(*(level @ axes[:2].T).T))
        if np.diff(azimuth, append=azimuth[0] + 2 * np.pi).max() > 2 * CURVED_STEP:
            return
        for minimum in joined.minima:
            along = hull.points[hull.corners(self.landscape.minima[minimum])] @ axes[2]
            self.margins[minimum] = max(0.0, min(along.max(), -along.min()))
            self.rollers[minimum] = axes[2]

    def decided(self, down: Array, energy: Array) -> Indices:
        """Return the minimum (n,) to which each part rolls, or -1 if its aspect is undecided.

        ``down`` are the directions (n, 3) of gravity, ``energy`` the sums (n,) of the kinetic
        energy and the height above the surface, m g R. Above ``highest`` no aspect is decided.
        """
        minima = self.landscape.descend(down)
        return np.where(energy < self.exits[minima], minima, -1)

    def sliding(self, down: Array, tipping: Array, energy: Array) -> Indices:
        """Return the minimum (n,) in which a flat sliding part stays, or -1 if it is undecided.

        The surface pushes such a part with its weight at a distance below the centre of mass, and
        friction turns it with at most ``tipping``. While the distance at which the weight balances
        this is less than half of that to the nearest edge, the part cannot tip over the edge.

        Parameters
        ----------
        down : (n, 3) float
            Directions of gravity, part frame, unit vectors.
        tipping : (n,) float
            Maximum tipping moment on a part, m g R.
        energy : (n,) float
            Height above the surface and kinetic energy without that of the sliding, m g R.
        """
        minima = self.landscape.descend(down)
        flat = (self.directions[minima] * down).sum(axis=1) > np.cos(FLAT_ANGLE)
        stays = flat & (tipping < self.margins[minima] / 2) & (energy < self.exits[minima])
        return np.where(stays, minima, -1)

    @cached_property
    def highest(self) -> float:
        """The maximum of ``exits``."""
        return float(self.exits.max())


def _margins(landscape: Landscape) -> Array:
    hull = landscape.hull
    edges = hull.angles > SAME_FACET
    found = np.full(len(hull.normals), np.inf)
    for side in (0, 1):
        np.minimum.at(found, hull.sides[edges, side], hull.margins[edges, side])
    return np.asarray(found[landscape.minima])
