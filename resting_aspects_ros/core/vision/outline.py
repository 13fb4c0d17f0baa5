"""Outlines: what a camera straight above sees of a part in each of its aspects."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import numpy.typing as npt
import shapely

from resting_aspects_ros.core.aspects.aspect_set import Aspect, AspectSet, Sweep
from resting_aspects_ros.core.aspects.symmetry import HIGHEST_ORDER, Symmetry
from resting_aspects_ros.core.geometry.hull import smallest_rectangle
from resting_aspects_ros.core.geometry.tessellation import sagittas
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.rotations import composed, rotate, turned_down
from resting_aspects_ros.core.vision.boundary import Boundary
from resting_aspects_ros.core.vision.fitting import shape_of
from resting_aspects_ros.core.vision.matching import mirrored, same_outline
from resting_aspects_ros.core.vision.silhouette import silhouette

Array = npt.NDArray[np.float64]

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
        core/aspects/heading.py. The exterior is counter-clockwise; through-holes are clockwise.
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
    return rolled(aspect, roll_between(aspect, down))


def roll_between(aspect: Aspect, down: Array) -> float:
    """Return by which angle the part rolls about its axis until ``down`` points down, rad."""
    axis, start = aspect.axis, aspect.down_in_part
    across = axis @ np.cross(down, start)
    return float(np.arctan2(across, down @ start - (axis @ down) * (axis @ start)))


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
    order = 1
    for prime in range(2, HIGHEST_ORDER + 1):
        if any(prime % smaller == 0 for smaller in range(2, prime)):
            continue
        power = prime
        while power <= HIGHEST_ORDER and boundary.has_order(power):
            power *= prime
        order *= power // prime
    # A circle that is stretched by less than the tolerance has every order.
    return order if order <= HIGHEST_ORDER else 0
