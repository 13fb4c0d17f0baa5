"""How a part lies on a track: in which aspect, and with which edge of its outline at the wall.

The *track frame*: x is the conveying direction, the wall is the plane y = 0 with the part at
y > 0, and z is normal to the track. Positive roll leans the track towards the wall; positive pitch
leads downhill along x.

A track conveys a part along its wall, and the wall pushes it until an edge of the convex hull of
its outline lies at the wall. Without friction, pushing turns the part so that the distance of its
centre of mass from the wall, the radius function of the hull, decreases to a local minimum
(Goldberg 1993, Algorithmica 10:201). The part starts with any yaw with equal probability.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from scipy.spatial.transform import Rotation

from resting_aspects_ros.arrays import Array, Indices
from resting_aspects_ros.aspects.aspect_set import Aspect, AspectSet
from resting_aspects_ros.aspects.symmetry import Symmetry
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.rotations import rotate, turned_about_vertical
from resting_aspects_ros.vision.location import is_symmetry, vertical_order

# Corners of the hull of an outline at which it turns by less than this, rad, are no corners.
STRAIGHT = 1e-4
# Rotations of the part onto itself map orientations to each other within this.
ALIKE = 0.02
# Points of a part touch the wall if they are closer to it than this, R.
AT_WALL = 0.01
# The mesh touches the track within this height, R.
ON_TRACK = 2e-4
# Directions of the wall's force between the limits of its friction.
FORCES = 41
# Orientations with a smaller share of the yaw do not occur.
MIN_SHARE = 1e-6


@dataclass(frozen=True, eq=False)
class Yaw:
    """A yaw at which a part comes to rest against a wall.

    angle : float
        rad, counter-clockwise seen from above, of the part in its orientation of reference.
    distance : float
        Distance of the centre of mass from the wall, m.
    length : float
        Length of the edge at the wall, m.
    lever : float
        Along the wall, from the foot of the centre of mass to the nearer end of the edge, m.
    share : float
        Share of all yaws from which the part gets there, without friction at the wall.
    low, high : float
        Share of the yaws from which it gets there with every direction of the force that the
        friction of the wall allows, and with at least one.
    """

    angle: float
    distance: float
    length: float
    lever: float
    share: float
    low: float
    high: float


class PushedOutline:
    """A convex polygon about the centre of mass that is pushed by a wall.

    Parameters
    ----------
    points : (n, 2) float
        Points whose convex hull is the outline, m; the origin is the centre of mass.

    Raises
    ------
    InvalidValueError
        If the hull has no area, or the centre of mass is outside it.
    """

    def __init__(self, points: Array) -> None:
        self.corners = _corners(points)
        ends = np.roll(self.corners, -1, axis=0)
        edge = ends - self.corners
        self.length = np.linalg.norm(edge, axis=1)
        along = edge / self.length[:, None]
        outward = np.stack([along[:, 1], -along[:, 0]], axis=1)
        self.distance = (self.corners * outward).sum(axis=1)
        if not (self.distance > 0).all():
            raise InvalidValueError(
                'invalid outline: expected one that contains the centre of mass'
            )
        # Along the edge, from its first corner to the foot of the centre of mass, and to the last.
        self.before = -(self.corners * along).sum(axis=1)
        self.after = (ends * along).sum(axis=1)
        self.normal = np.arctan2(outward[:, 1], outward[:, 0])
        self.direction = np.arctan2(self.corners[:, 1], self.corners[:, 0])

    def yaws(self, friction: float = 0.0, order: int = 1) -> list[Yaw]:
        """Return the yaws at which the outline comes to rest, by their share.

        Parameters
        ----------
        friction : float
            Of the wall; it tilts its force by up to the friction angle in both directions.
        order : int
            Number of rotations about the vertical that map the part onto itself, 0 for all: edges
            that they map to each other are one yaw.
        """
        limit = math.atan(friction)
        tilts = np.linspace(-limit, limit, FORCES) if limit else np.zeros(0)
        basins = [self._basins(tilt) for tilt in [0.0, *tilts.tolist()]]
        bounds = np.unique(np.concatenate([starts for starts, _ in basins]))
        if not len(bounds):
            return []
        width = np.diff(np.append(bounds, bounds[0] + 2 * np.pi))
        middle = bounds + width / 2
        reached = np.array([_reached(*each, middle) for each in basins])
        found = []
        for edges in self._alike(order):
            # A round outline is the same at every yaw, also while it rolls along the wall.
            here = np.isin(reached, edges) if order else np.ones_like(reached, dtype=bool)
            low, share, high = (
                float(width[mask].sum() / (2 * np.pi))
                for mask in (here.all(axis=0), here[0], here.any(axis=0))
            )
            if high > MIN_SHARE:
                k = edges[np.argmax([width[reached[0] == edge].sum() for edge in edges])]
                angle = _wrapped(-np.pi / 2 - self.normal[k])
                lever = float(min(self.before[k], self.after[k]))
                distance, length = float(self.distance[k]), float(self.length[k])
                found.append(Yaw(angle, distance, length, lever, share, low, high))
        return sorted(found, key=lambda yaw: -yaw.share)

    def _alike(self, order: int) -> list[Indices]:
        """Return the edges that rotations about the vertical map to each other."""
        edges = np.arange(len(self.corners))
        if order == 0:
            return [edges]
        angle = _positive(self.normal * order)
        groups: list[Indices] = []
        for k in edges.tolist():
            same = np.abs(np.angle(np.exp(1j * (angle - angle[k])))) < ALIKE * order
            if not (same & (edges < k)).any():
                groups.append(np.flatnonzero(same))
        return groups

    def _basins(self, tilt: float) -> tuple[Array, Indices]:
        """Return where the basins of the stable edges begin, rad, ascending, and the edges.

        The direction of the wall, in axes of the part, turns away from the direction of the corner
        that it touches, less the tilt of its force. It cannot cross such a direction, and between
        two of them is one edge at which both ends turn it towards the edge.
        """
        before = np.roll(self.normal, 1)
        cone = _positive(self.normal - before)
        there = _positive(self.direction - tilt - before)
        barriers = np.sort(_positive(self.direction[there < cone] - tilt))
        lever = math.tan(tilt) * self.distance
        stable = np.flatnonzero((self.before + lever > 0) & (self.after - lever > 0))
        if not len(barriers) or not len(stable):
            return np.zeros(0), np.zeros(0, dtype=np.int64)
        edges = np.full(len(barriers), -1, dtype=np.int64)
        place = np.searchsorted(barriers, _positive(self.normal[stable]), side='right') - 1
        edges[place] = stable
        return barriers, edges


def _reached(starts: Array, edges: Indices, directions: Array) -> Indices:
    """Return the edge (n,) that is reached from directions (n,) of the wall; -1: none."""
    if not len(starts):
        return np.full(len(directions), -1, dtype=np.int64)
    return np.asarray(edges[np.searchsorted(starts, _positive(directions), side='right') - 1])


def _corners(points: Array) -> Array:
    """Return the corners of the convex hull, counter-clockwise; none is on a straight edge."""
    hull = shapely.MultiPoint(points).convex_hull
    if hull.geom_type != 'Polygon':
        raise InvalidValueError('invalid outline: expected one with an area')
    corners = shapely.get_coordinates(shapely.geometry.polygon.orient(hull))[:-1]
    one = corners - np.roll(corners, 1, axis=0)
    two = np.roll(one, -1, axis=0)
    cross = one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0]
    size = np.linalg.norm(one, axis=1) * np.linalg.norm(two, axis=1)
    return np.asarray(corners[cross > STRAIGHT * size])


def _positive(angle: Array) -> Array:
    return np.asarray(np.mod(angle, 2 * np.pi))


def _wrapped(angle: float) -> float:
    return float((angle + np.pi) % (2 * np.pi) - np.pi)


@dataclass(frozen=True, eq=False)
class Orientation:
    """A row: how a part lies on the track. Rotations of the part onto itself are one row.

    id : int
        From 1, by falling probability of quasi-static motion: the `basin_share` of the aspects
        times the share of the yaw; rows in which the part rolls are last. The numbers do not
        change with the drops and their conditions, only with the wall.
    aspects : tuple of int
        Ids of the aspects of which the row consists.
    orientation : (4,) float
        Unit quaternion xyzw, track from part.
    yaw : Yaw
    probability, low, high : float
        Share of the parts that come to rest so: the share of the aspects times the share of the
        yaw, and its bounds by the friction of the wall.
    model : (float, float) or None
        Model range of the share: that of the aspects, with all yaws that the friction of the wall
        allows. None where it is not known.
    corners : (n, 3) float
        Vertices of the mesh in the track frame, m; the centre of mass is at x = 0.
    contact : shapely geometry
        Where the mesh touches the track, x and y in m: polygons, edges and points.
    com_height : float
        Height of the centre of mass above the track, m.
    wall_top : float
        Height up to which the wall can push the part, m.
    rolls : bool
        Whether the part rolls or rocks in this aspect.
    """

    id: int
    aspects: tuple[int, ...]
    orientation: Array
    yaw: Yaw
    probability: float
    low: float
    high: float
    corners: Array
    contact: shapely.Geometry
    com_height: float
    wall_top: float
    rolls: bool
    model: tuple[float, float] | None = None

    @property
    def height(self) -> float:
        """Height of the part above the track, m."""
        return float(self.corners[:, 2].max())

    @property
    def length(self) -> float:
        """Length of the part along the track, m."""
        return float(np.ptp(self.corners[:, 0]))

    @property
    def width(self) -> float:
        """Distance of the farthest point of the part from the wall, m."""
        return float(self.corners[:, 1].max())


def orientations_on(
    part: Part,
    aspects: AspectSet,
    shares: Sequence[float],
    wall_height: float = math.inf,
    wall_friction: float = 0.0,
    model: Array | None = None,
) -> list[Orientation]:
    """Return the orientations of a part on a track, by their numbers.

    Parameters
    ----------
    shares : sequence of float
        Share of each aspect, by id.
    wall_height : float
        Only what is below it touches the wall, m.
    wall_friction : float
    model : (k, 2) float, optional
        Model range of the share of each aspect.

    Raises
    ------
    InvalidValueError
        If the part has no aspect.
    """
    if not len(aspects):
        raise InvalidValueError(f'invalid part {part.name}: expected a part with an aspect')
    found: list[Orientation] = []
    for aspect, share in zip(aspects, shares, strict=True):
        corners = rotate(aspect.orientation, part.vertices - part.centre_of_mass)
        order = vertical_order(aspects.symmetry, aspect.down_in_part)
        for yaw in _pushed(part, aspect, corners, wall_height).yaws(wall_friction, order):
            made = _orientation(part, aspect, yaw, share, corners, wall_height)
            if model is not None:
                low, high = model[aspect.id - 1].tolist()
                made = replace(made, model=(yaw.low * low, yaw.high * high))
            same = [
                k
                for k, each in enumerate(found)
                if aspect.id not in each.aspects
                and same_orientation(each.orientation, made.orientation, aspects.symmetry)
            ]
            if same:
                found[same[0]] = _joined(found[same[0]], made)
            else:
                found.append(made)

    def place(row: Orientation) -> tuple[bool, float, tuple[int, ...], int]:
        share = sum(aspects[number - 1].basin_share for number in row.aspects) * row.yaw.share
        # Rounded first: -1e-16 and 1e-16 are the same angle.
        angle = round(1000 * row.yaw.angle) % round(2000 * np.pi)
        return row.rolls, -round(share, 6), row.aspects, angle

    ordered = sorted(found, key=place)
    return [replace(each, id=k) for k, each in enumerate(ordered, 1)]


def _pushed(part: Part, aspect: Aspect, corners: Array, wall_height: float) -> PushedOutline:
    """Return the outline of what the wall touches; raises InvalidValueError."""
    try:
        return PushedOutline(points_below(part, corners, wall_height))
    except InvalidValueError:
        if wall_height >= float(np.ptp(corners[:, 2])):
            raise
        raise InvalidValueError(
            f'invalid height of the wall {1e3 * wall_height:g} mm: expected a wall that '
            f'{part.name} cannot tip over in aspect {aspect.id}: its centre of mass is not above '
            'what is lower than the wall'
        ) from None


def _orientation(
    part: Part, aspect: Aspect, yaw: Yaw, share: float, corners: Array, wall_height: float
) -> Orientation:
    sine, cosine = math.sin(yaw.angle), math.cos(yaw.angle)
    lowest = float(corners[:, 2].min())
    turn = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    placed = corners @ turn.T + [0.0, yaw.distance, -lowest]
    reach = placed[placed[:, 1] < AT_WALL * part.hull_radius]
    top = float(reach[:, 2].max()) if len(reach) else 0.0
    return Orientation(
        id=0,
        aspects=(aspect.id,),
        orientation=turned_about_vertical(aspect.orientation, yaw.angle),
        yaw=yaw,
        probability=share * yaw.share,
        low=share * yaw.low,
        high=share * yaw.high,
        corners=placed,
        contact=contact_region(part, placed),
        com_height=-lowest,
        wall_top=min(top, wall_height),
        rolls=aspect.sweep.curved,
    )


def mirror_images(rows: Sequence[Orientation], within: float) -> list[tuple[int, ...]]:
    """Return for each row the ids of the other rows that are its mirror image along the track.

    A trap that is symmetric along the track cannot separate them.

    within : distance of the contacts, and of the dimensions, m
    """

    def alike(one: Orientation, other: Orientation) -> bool:
        values = [
            (row.height, row.com_height, row.yaw.distance, row.length, row.width, row.wall_top)
            for row in (one, other)
        ]
        if np.abs(np.subtract(values[0], values[1])).max() > within:
            return False
        mirrored = shapely.transform(one.contact, lambda at: at * [-1.0, 1.0])
        return bool(shapely.hausdorff_distance(mirrored, other.contact) < within)

    return [
        tuple(other.id for other in rows if other is not row and alike(row, other)) for row in rows
    ]


def points_below(part: Part, corners: Array, height: float) -> Array:
    """Return points (n, 2) whose hull is the outline of what is lower than a height, m.

    corners : (v, 3) float
        Vertices of the mesh in the pose; their lowest z is the track.
    """
    z = corners[:, 2] - corners[:, 2].min()
    if height >= z.max():
        return np.asarray(corners[:, :2])
    low = z <= height
    one, two = part.faces[:, [0, 1, 2]].ravel(), part.faces[:, [1, 2, 0]].ravel()
    crossing = low[one] & ~low[two]
    one, two = one[crossing], two[crossing]
    share = ((height - z[one]) / (z[two] - z[one]))[:, None]
    cut = corners[one, :2] + share * (corners[two, :2] - corners[one, :2])
    return np.concatenate([corners[low, :2], cut])


def contact_region(part: Part, placed: Array) -> shapely.Geometry:
    """Return where the mesh touches the track: the union of triangles, edges and corners."""
    low = placed[:, 2] <= ON_TRACK * part.hull_radius + part.hull_error
    count = low[part.faces].sum(axis=1)
    flat = placed[part.faces[count == 3]][:, :, :2]
    pieces: list[shapely.Geometry] = []
    if len(flat):
        polygons = shapely.polygons(flat)
        pieces += polygons[shapely.area(polygons) > 0].tolist()
    two = part.faces[count == 2]
    if len(two):
        ends = placed[two[low[two]].reshape(-1, 2)][:, :, :2]
        pieces += shapely.linestrings(ends).tolist()
    pieces += shapely.points(placed[low][:, :2]).tolist()
    return shapely.union_all(pieces)


def same_orientation(
    one: Array, other: Array, symmetry: Symmetry | None, within: float = ALIKE
) -> bool:
    """Return whether a rotation of the part onto itself maps an orientation to the other, rad."""
    turn = Rotation.from_quat(one).inv() * Rotation.from_quat(other)
    return is_symmetry(symmetry, turn.as_rotvec(), within)


def _joined(one: Orientation, other: Orientation) -> Orientation:
    return replace(
        one,
        aspects=tuple(sorted({*one.aspects, *other.aspects})),
        probability=one.probability + other.probability,
        low=one.low + other.low,
        high=one.high + other.high,
        model=_added(one.model, other.model),
    )


def _added(
    one: tuple[float, float] | None, other: tuple[float, float] | None
) -> tuple[float, float] | None:
    if one is None or other is None:
        return None
    return one[0] + other[0], min(one[1] + other[1], 1.0)
