"""Outlines: what a camera straight above sees of a part in each of its aspects."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import combinations, product
from typing import Literal, NamedTuple

import contourpy
import numpy as np
import numpy.typing as npt
import shapely

from resting_aspects_ros.arrays import Array, Indices
from resting_aspects_ros.aspects.aspect_set import Aspect, AspectSet, Sweep
from resting_aspects_ros.aspects.symmetry import HIGHEST_ORDER, Symmetry, cyclic_order
from resting_aspects_ros.errors import PartError
from resting_aspects_ros.part.hull import smallest_rectangle
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.part.surface import triangle_edges
from resting_aspects_ros.part.tessellation import sagittas
from resting_aspects_ros.rotations import composed, rotate, turned_down
from resting_aspects_ros.vision.boundary import Boundary
from resting_aspects_ros.vision.fitting import best_overlap, mirrored, same_outline, shape_of

# -- Pixels ---------------------------------------------------------------------------------------


# Scan lines per pixel with which the covered share of a pixel is computed.
LINES = 8


def rings(polygon: shapely.Polygon) -> Iterator[Array]:
    """Yield the corners (n, 2) of the outer ring and of each hole, the first one not repeated."""
    for ring in (polygon.exterior, *polygon.interiors):
        yield np.asarray(ring.coords, dtype=np.float64)[:-1]


def covered_share(
    polygons: shapely.Polygon | Iterable[shapely.Polygon], width: int, height: int
) -> Array:
    """Return the share (height, width) of each pixel that polygons cover, 0 to 1.

    The polygons are in image coordinates (px, (0, 0) is the outer corner of the first pixel),
    inside the image, all with the same sense of their outer rings, and their holes have the
    opposite sense. The share is exact along each of LINES horizontal lines of a pixel, unless
    polygons overlap within a pixel.
    """
    if isinstance(polygons, shapely.Polygon):
        polygons = [polygons]
    step = np.zeros(height * (width + 2))
    for ring in (ring for polygon in polygons for ring in rings(polygon)):
        x, y = ring.T
        dx, dy = np.roll(x, -1) - x, np.roll(y, -1) - y
        ends = np.sort(np.stack([y, y + dy]) * LINES - 0.5, axis=0)
        first, end = np.ceil(ends).astype(np.int64)
        count = end - first
        edge = np.repeat(np.arange(len(x)), count)
        line = np.arange(len(edge)) - np.repeat(np.cumsum(count) - count - first, count)
        crossing = x[edge] + dx[edge] * ((line + 0.5) / LINES - y[edge]) / dy[edge]
        column = np.floor(crossing).astype(np.int64)
        pixel = line // LINES * (width + 2) + column
        sign = np.sign(dy[edge]) / LINES
        inside = column + 1 - crossing
        # Everything to the right of the crossing is inside, or outside again.
        np.add.at(step, pixel, sign * inside)
        np.add.at(step, pixel + 1, sign * (1 - inside))
    share = step.reshape(height, width + 2).cumsum(axis=1)[:, :width]
    np.abs(share, out=share)
    return np.asarray(np.minimum(share, 1.0, out=share))


# -- Union of triangles ---------------------------------------------------------------------------


# The first line is this far outside, in steps; it is not a simple fraction, so that the sides of
# most parts are between lines.
_MARGIN = 1.6180339887


def sampled_union(plane: Array, faces: Indices, step: float) -> shapely.Geometry:
    """Return the union of counter-clockwise triangles as a polygon or multipolygon.

    Parameters
    ----------
    plane : (n, 2) float
        Corners.
    faces : (m, 3) int
        At least one triangle with an area.
    step : float
        Distance of the lines of the grid, in the unit of ``plane``.
    """
    used = plane[faces].reshape(-1, 2)
    low = used.min(axis=0) - _MARGIN * step
    size = np.ceil((used.max(axis=0) - low) / step + _MARGIN).astype(np.int64)
    ends, weight = _border((plane - low) / step, faces)
    rows = _crossings(ends, size)
    columns = _crossings(ends[:, :, ::-1], size[::-1])
    covered = _covered(rows, weight, size)
    contours = contourpy.contour_generator(
        z=covered, name='serial', fill_type=contourpy.FillType.OuterOffset
    )
    polygons = []
    for points, offsets in zip(*contours.filled(0.5, 2.0), strict=True):
        on_row = points[:, 0] % 1 != 0  # else on a column
        points[on_row, 0] = _outermost(rows, points[on_row], covered)
        points[~on_row, 1] = _outermost(columns, points[~on_row, ::-1], covered.T)
        outer, *holes = np.split(points * step + low, offsets[1:-1])
        polygons.append(shapely.Polygon(outer, holes))
    return shapely.union_all(shapely.make_valid(polygons))


def _border(plane: Array, faces: Indices) -> tuple[Array, Indices]:
    """Return the edges (k, 2, 2) that do not cancel, and their weights (k,).

    The weight is the number of triangles that use the edge in its direction, minus the others.
    """
    edges = triangle_edges(faces)
    weight = np.bincount(edges.number, weights=edges.direction).astype(np.int64)
    use = np.empty_like(weight)
    use[edges.number] = np.arange(len(edges.number))
    use = use[weight != 0]  # one use of each edge that does not cancel
    ends = np.stack([faces.ravel()[use], np.roll(faces, -1, axis=1).ravel()[use]], axis=1)
    return plane[ends], (weight[edges.number] * edges.direction)[use]


class _Crossings(NamedTuple):
    """Where edges cross the rows y = 0, 1, 2, ... of a grid; sorted by edge."""

    edge: Indices  # (n,)
    upward: npt.NDArray[np.bool_]  # (n,)
    x: Array  # (n,)
    sample: Indices  # (n,), row * columns + column of the first sample at or after the crossing


def _crossings(ends: Array, size: Indices) -> _Crossings:
    """Return the crossings of edges (k, 2, 2) with a grid of ``size``, (columns, rows)."""
    upward = ends[:, 0, 1] <= ends[:, 1, 1]
    low = np.where(upward[:, None], ends[:, 0], ends[:, 1])
    high = np.where(upward[:, None], ends[:, 1], ends[:, 0])
    first = np.ceil(low[:, 1]).astype(np.int64)
    count = np.ceil(high[:, 1]).astype(np.int64) - first
    edge = np.repeat(np.arange(len(ends)), count)
    row = np.arange(len(edge)) - np.repeat(np.cumsum(count) - count - first, count)
    way = high - low
    slope = way[:, 0] / np.where(count > 0, way[:, 1], 1.0)
    x = low[edge, 0] + (row - low[edge, 1]) * slope[edge]
    return _Crossings(edge, upward[edge], x, row * size[0] + np.ceil(x).astype(np.int64))


def _covered(rows: _Crossings, weight: Indices, size: Indices) -> Array:
    """Return 1 for the samples (rows, columns) that a triangle covers, 0 for the others."""
    count = np.zeros(size[0] * size[1], dtype=np.int32)  # the grid is large, so in place
    np.add.at(count, rows.sample, np.where(rows.upward, -weight[rows.edge], weight[rows.edge]))
    count = count.reshape(size[1], size[0])
    np.cumsum(count, axis=1, out=count)
    return (count > 0).astype(np.float64)


def _outermost(rows: _Crossings, points: Array, covered: Array) -> Array:
    """Return x of the outermost crossing at points (n, 2) between two samples of a row.

    One of the two samples is covered. Where rounding hides the crossing, x is unchanged.
    """
    after, row = np.ceil(points[:, 0]).astype(np.int64), points[:, 1].astype(np.int64)
    sample = row * covered.shape[1] + after
    wanted = np.zeros(covered.size, dtype=bool)
    wanted[sample] = True
    here = np.flatnonzero(wanted[rows.sample])
    here = here[np.lexsort((rows.x[here], rows.sample[here]))]
    first = np.searchsorted(rows.sample[here], sample, side='left')
    last = np.searchsorted(rows.sample[here], sample, side='right') - 1
    found = last >= first
    enters = covered[row, after] > 0
    x: Array = points[:, 0].copy()
    x[found] = rows.x[here[np.where(enters, first, last)[found]]]
    return x


# -- Silhouettes ----------------------------------------------------------------------------------


# Gaps, slivers and deviations from a straight line up to this, R, are effects of rounding.
ROUNDING = 1e-5
# Coordinates of unions are rounded to this, R. Without a grid, a union can lose a polygon whose
# border differs from that of another one by 1e-16 (GEOS 3.14).
GRID = 1e-9
# Pieces of a silhouette are joined over gaps up to twice this, R, or left out if they are so
# small; holes that are so small are filled.
MAX_GAP = 1e-3
# The union of more triangles is found from samples, at this distance, R.
MANY_TRIANGLES, SAMPLE_STEP = 5_000, MAX_GAP / 2


def silhouette(corners: Array, faces: Indices, closed: bool, radius: float) -> shapely.Polygon:
    """Return the union of the projected triangles of a mesh as a polygon.

    Its exterior is counter-clockwise, its holes are clockwise. Gaps and slivers narrower than
    2 ROUNDING, and vertices closer than ROUNDING to a straight line, are removed. Pieces are
    joined over gaps of up to 2 MAX_GAP. If more than MANY_TRIANGLES are seen, corners are cut and
    gaps and slivers can be missed by up to SAMPLE_STEP.

    Parameters
    ----------
    corners : (n, 3) float
        m, with z up.
    faces : (m, 3) int
    closed : bool
        Whether the mesh is a closed solid with outward faces. Then upward faces are sufficient.
    radius : float
        R, m.

    Raises
    ------
    PartError
        If the silhouette has no area or several pieces.
    """
    plane = corners[:, :2] / radius
    a, b, c = (plane[faces[:, k]] for k in range(3))
    ab, ac = (b - a).T, (c - a).T
    twice = ab[0] * ac[1] - ab[1] * ac[0]
    if not closed:
        faces = np.where((twice < 0)[:, None], faces[:, ::-1], faces)
        twice = np.abs(twice)
    faces = faces[twice > ROUNDING**2 * 1e-3]
    if len(faces) > MANY_TRIANGLES:
        try:
            return _scaled(_cleaned(sampled_union(plane, faces, SAMPLE_STEP)), radius)
        except PartError:
            pass  # a foil seen from its edge can lie between the samples
    exact = shapely.union_all(shapely.polygons(plane[faces]), grid_size=GRID)
    return _scaled(_cleaned(exact), radius)


def _scaled(outline: shapely.Polygon, factor: float) -> shapely.Polygon:
    return shapely.geometry.polygon.orient(shapely.transform(outline, lambda xy: xy * factor))


def _cleaned(union: shapely.Geometry) -> shapely.Polygon:
    """Return a union, in units of R, as one polygon without effects of rounding."""
    outline = _offset(_closed(union.simplify(ROUNDING), ROUNDING), -ROUNDING)
    outline = _offset(outline, ROUNDING).simplify(ROUNDING)
    if shapely.get_num_geometries(outline) > 1:
        outline = _closed(outline, MAX_GAP).simplify(ROUNDING)
        pieces = shapely.get_parts(outline)
        large = pieces[shapely.area(pieces) > MAX_GAP**2]
        outline = large[0] if len(large) == 1 else outline
    if outline.is_empty:
        raise PartError('invalid outline: expected an area, but the mesh is seen from its edge')
    if not isinstance(outline, shapely.Polygon):
        raise PartError(
            f'invalid outline of {shapely.get_num_geometries(outline)} separate pieces: '
            f'expected a part whose outline is connected'
        )
    holes = [hole for hole in outline.interiors if shapely.Polygon(hole).area > MAX_GAP**2]
    return shapely.Polygon(outline.exterior, holes)


def _closed(shape: shapely.Geometry, gap: float) -> shapely.Geometry:
    return _offset(_offset(shape, gap), -gap)


def _offset(shape: shapely.Geometry, distance: float) -> shapely.Geometry:
    moved = shape.buffer(distance, join_style='mitre')
    if abs(moved.area - shape.area) > 2 * abs(distance) * shape.length:
        # A polygon was lost, as in a union without a grid.
        moved = shapely.set_precision(shape, GRID).buffer(distance, join_style='mitre')
    return moved


# -- Outlines -------------------------------------------------------------------------------------


# Maximum number of directions of a sweep whose outlines are found.
MAX_DIRECTIONS = 12
# Maximum sine of the angle between an axis of rolling and the axis of a body of revolution.
SAME_AXIS = 0.01


@dataclass(frozen=True, eq=False)
class Outline:
    """What a camera straight above sees of a part in the aspects of one symmetry class.

    Coordinates are in m, along the axes of the tray (x right, y up, seen from above). The origin
    is the projection of the centre of mass, not the centroid of the outline.

    symmetry_class : int
    aspects : tuple of int
        Ids of the aspects of the class, ascending; the first one is represented, `aspect`. The
        others have the same outline, rotated about the vertical.
    polygon : shapely.Polygon
        At yaw 0, which is the part in ``Aspect.orientation`` of `aspect`; see
        aspects/find.py. The exterior is counter-clockwise; through-holes are clockwise.
    height : float
        Height of the highest point above the tray, m.
    com_height : float
        Height of the centre of mass above the tray, m.
    orientation : (4,) float
        Unit quaternion xyzw, tray from part, at yaw 0.
    yaw_symmetry : int
        Maximum n for which a rotation by 360 / n degrees about the centroid does not change the
        outline; 1 without symmetry, 0 if it is round.
    mirror_symmetric : bool
        Whether the outline has a mirror axis, so that it equals its mirror image after a rotation.
    family : tuple of shapely.Polygon
        Outlines at other down directions of an aspect with a sweep (the part rolls or rocks), if
        they differ from `polygon` and from each other after any rotation about the vertical, by
        more than the effect of the mesh. Yaw 0 is that of `polygon`: the axis of the
        sweep has the same direction. Empty for round parts that roll.
    """

    symmetry_class: int
    aspects: tuple[int, ...]
    polygon: shapely.Polygon = field(repr=False)
    height: float
    com_height: float
    orientation: Array
    yaw_symmetry: int
    mirror_symmetric: bool
    family: tuple[shapely.Polygon, ...] = field(default=(), repr=False)

    @property
    def aspect(self) -> int:
        """Id of the aspect that the outline shows at yaw 0."""
        return self.aspects[0]

    @cached_property
    def area(self) -> float:
        """Area without through-holes, m^2."""
        return float(self.polygon.area)

    @cached_property
    def centroid(self) -> Array:
        """(2,) float: centroid of the area, m."""
        return np.array(self.polygon.centroid.coords[0])

    @cached_property
    def length(self) -> float:
        """Longer side of the rectangle of minimum area around the outline, m."""
        return float(np.linalg.norm(self._sides[0]))

    @cached_property
    def width(self) -> float:
        """Shorter side of the rectangle of minimum area around the outline, m."""
        return float(np.linalg.norm(self._sides[1]))

    @cached_property
    def long_axis(self) -> float:
        """Direction of `length` at yaw 0, rad, counter-clockwise from x, from 0 to below pi."""
        x, y = self._sides[0]
        angle = float(np.arctan2(y, x) % np.pi)
        return 0.0 if angle >= np.pi else angle

    @cached_property
    def _sides(self) -> Array:
        """(2, 2) float: the sides of the rectangle of minimum area, the longer one first."""
        return smallest_rectangle(shapely.get_coordinates(self.polygon))[1]


def find_outlines(part: Part, aspects: AspectSet) -> tuple[Outline, ...]:
    """Return the outlines of the symmetry classes of a part, in their order.

    The aspect with the lowest id represents its class. Raises PartError if an outline has no area
    or several pieces.
    """
    classes = aspects.classes()
    play = 0.0
    if any(_has_family(members[0], aspects.symmetry) for members in classes):
        # A curved side of few strips has different widths in different directions.
        play = float(sagittas(part.vertices, part.faces)[0].max())
    return tuple(_outline(part, aspects, members, play) for members in classes)


def seen_outline(part: Part, orientation: Array) -> shapely.Polygon:
    """Return the silhouette of a part in any orientation, seen from straight above.

    It is the union of the projections of all triangles, with through-holes, m, in the axes of the
    tray; the origin is the projection of the centre of mass. Raises PartError if it has no area or
    several pieces.

    Parameters
    ----------
    part : Part
    orientation : (4,) float
        Unit quaternion xyzw, tray from part.
    """
    corners = rotate(np.asarray(orientation), part.vertices - part.centre_of_mass)
    return silhouette(corners, part.faces, not np.isnan(part.volume), part.hull_radius)


def _outline(part: Part, aspects: AspectSet, members: tuple[Aspect, ...], play: float) -> Outline:
    aspect = members[0]
    has_family = _has_family(aspect, aspects.symmetry)
    polygon = seen_outline(part, aspect.orientation)
    up = rotate(aspect.orientation, part.hull_vertices - part.centre_of_mass)[:, 2].max()
    return Outline(
        symmetry_class=aspect.symmetry_class,
        aspects=tuple(each.id for each in members),
        polygon=polygon,
        height=aspect.com_height + float(up),
        com_height=aspect.com_height,
        orientation=aspect.orientation,
        yaw_symmetry=_yaw_symmetry(shape_of(polygon).boundary),
        mirror_symmetric=same_outline(mirrored(polygon), polygon),
        family=_family(part, aspect, polygon, play) if has_family else (),
    )


def _has_family(aspect: Aspect, symmetry: Symmetry | None) -> bool:
    """Return whether the outline can change while the part rolls or rocks."""
    return aspect.sweep is not Sweep.POINT and not rolls_round(symmetry, aspect)


def _family(
    part: Part, aspect: Aspect, main: shapely.Polygon, play: float
) -> tuple[shapely.Polygon, ...]:
    """Return the outlines at other directions of the sweep that differ from each other.

    play : float
        Difference of outlines that the tessellation can cause, m.
    """
    found = [main]
    for down in spread(aspect.directions)[1:]:
        polygon = seen_outline(part, rolled_down(aspect, down))
        if not any(same_outline(polygon, other, play) for other in found):
            found.append(polygon)
    return tuple(found[1:])


def rolls_round(symmetry: Symmetry | None, aspect: Aspect) -> bool:
    """Return whether a rotation of the part onto itself causes each direction of the sweep."""
    if symmetry is None or symmetry.axis is None:
        return symmetry is not None and symmetry.kind == 'spherical'
    about_axis = np.linalg.norm(np.cross(symmetry.axis, aspect.axis)) < SAME_AXIS
    return bool(about_axis) and aspect.sweep in {Sweep.RING, Sweep.ARC}


def rolled(aspect: Aspect, roll: float) -> Array:
    """Return the orientation (4,) after the part has rolled by an angle about the axis, rad.

    The axis of the sweep keeps its direction on the tray, so that the yaw is that of the aspect.
    """
    turn = np.append(np.sin(roll / 2) * aspect.axis, np.cos(roll / 2))
    return np.asarray(composed(aspect.orientation[None], turn)[0])


def rolled_down(aspect: Aspect, down: Array) -> Array:
    """Return the orientation (4,) after the part has rolled until ``down`` points down.

    In a dome, which has no axis, the way is the shortest.
    """
    if aspect.sweep not in (Sweep.ARC, Sweep.RING):
        return np.asarray(turned_down(aspect.orientation[None], down[None])[0])
    return rolled(aspect, angle_about(aspect.axis, down, aspect.down_in_part))


def angle_about(axis: Array, one: Array, other: Array) -> float:
    """Return the angle about an axis that brings a direction closest to another one, rad."""
    across = axis @ np.cross(one, other)
    return float(np.arctan2(across, one @ other - (axis @ one) * (axis @ other)))


def spread(directions: Array, count: int = MAX_DIRECTIONS) -> Array:
    """Return at most ``count`` directions, the first one and those far from each other."""
    chosen = [0]
    nearest = np.linalg.norm(directions - directions[0], axis=1)
    while len(chosen) < min(count, len(directions)):
        chosen.append(int(nearest.argmax()))
        nearest = np.minimum(nearest, np.linalg.norm(directions - directions[chosen[-1]], axis=1))
    return directions[chosen]


def _yaw_symmetry(boundary: Boundary) -> int:
    """Return the maximum order of rotation about the centroid, or 0 for a round outline."""
    if boundary.is_round():
        return 0
    order = cyclic_order(boundary.has_order)
    # A circle that is stretched by less than the tolerance has every order.
    return order if order <= HIGHEST_ORDER else 0


# -- Look-alikes ----------------------------------------------------------------------------------


@dataclass(frozen=True)
class LookAlike:
    """How well the outline of another symmetry class resembles an outline.

    symmetry_class : int
        The other class.
    overlap : float
        Maximum intersection over union over yaw and position.
    verdict : 'same', 'mirrored' or 'distinct'
        same: equal within SAME. mirrored: the mirror image is equal, but the outline is not.
    resolution : float
        Symmetric Hausdorff distance after the best alignment, m: a camera that does not resolve
        it cannot distinguish the outlines.
    """

    symmetry_class: int
    overlap: float
    verdict: Literal['same', 'mirrored', 'distinct']
    resolution: float


def look_alikes(outlines: Sequence[Outline]) -> dict[int, tuple[LookAlike, ...]]:
    """Return, by symmetry class, how well each other class resembles it, best overlap first.

    Of a class whose outline changes while the part rolls or rocks, the most similar one counts.
    """
    found: dict[int, list[LookAlike]] = {outline.symmetry_class: [] for outline in outlines}
    for one, other in combinations(outlines, 2):
        pairs = list(product((one.polygon, *one.family), (other.polygon, *other.family)))
        overlap, distance = _most_alike(pairs)
        verdict: Literal['same', 'mirrored', 'distinct'] = 'distinct'
        if any(same_outline(a, b) for a, b in pairs):
            verdict = 'same'
        elif any(same_outline(mirrored(a), b) for a, b in pairs):
            verdict = 'mirrored'
        for a, b in ((one, other), (other, one)):
            found[a.symmetry_class].append(LookAlike(b.symmetry_class, overlap, verdict, distance))
    return {k: tuple(sorted(each, key=lambda a: -a.overlap)) for k, each in found.items()}


def same_groups(found: Mapping[int, Sequence[LookAlike]]) -> list[tuple[int, ...]]:
    """Return all symmetry classes, those with the same outline in one group; both ascending.

    found : what `look_alikes` returns
    """
    groups: list[tuple[int, ...]] = []
    for number in sorted(found):
        same = {each.symmetry_class for each in found[number] if each.verdict == 'same'}
        for k, group in enumerate(groups):
            if same.issuperset(group):
                groups[k] = (*group, number)
                break
        else:
            groups.append((number,))
    return groups


def _most_alike(
    pairs: Sequence[tuple[shapely.Polygon, shapely.Polygon]],
) -> tuple[float, float]:
    """Return the maximum overlap of all pairs of a model and a seen outline, and its distance."""

    def bound(pair: tuple[shapely.Polygon, shapely.Polygon]) -> float:
        areas = sorted(each.area for each in pair)
        return float(areas[0] / areas[1])

    best = (0.0, np.inf)
    for model, seen in sorted(pairs, key=bound, reverse=True):
        if bound((model, seen)) > best[0]:
            best = max(best, best_overlap(model, seen), key=lambda found: found[0])
    return best
