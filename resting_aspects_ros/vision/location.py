"""The 6D poses of a part that a camera sees in an aspect at (x, y, yaw)."""

import math
import sys
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from resting_aspects_ros.arrays import Array
from resting_aspects_ros.aspects.aspect_set import Aspect, AspectSet
from resting_aspects_ros.aspects.symmetry import Symmetry
from resting_aspects_ros.errors import InvalidValueError, shown
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.rotations import (
    LENGTH_TOLERANCE,
    canonical,
    rotation_between,
    turned_down,
)
from resting_aspects_ros.vision.outline import Outline, angle_about

# Maximum angle between equal directions, rad.
SAME_DIRECTION = 0.01


def rotation_to(symmetry: Symmetry | None, one: Array, other: Array) -> Array:
    """Return the rotation (3, 3) of the part onto itself that comes closest to one -> other."""
    if symmetry is None:
        return np.eye(3)
    if symmetry.kind == 'spherical':
        return Rotation.from_quat(rotation_between(one, other)).as_matrix()
    rotations = symmetry.rotations
    if symmetry.axis is not None:
        axis = symmetry.axis
        angles = [angle_about(axis, r @ one, other) for r in rotations]
        rotations = Rotation.from_rotvec(np.outer(angles, axis)).as_matrix() @ rotations
    return np.asarray(rotations[(rotations @ one @ other).argmax()])


def is_symmetry(symmetry: Symmetry | None, vector: Array, tolerance: float) -> bool:
    """Return whether the turn of a rotation vector (3,) maps the part onto itself."""
    turn = Rotation.from_rotvec(vector).as_matrix()
    if symmetry is None:
        return bool(np.linalg.norm(vector) <= tolerance)
    if symmetry.kind == 'spherical':
        return True
    if symmetry.axis is not None:
        image = turn @ symmetry.axis
        cosines = symmetry.rotations @ symmetry.axis @ image
        return bool(cosines.max() >= np.cos(tolerance))
    traces = np.einsum('kij,ij->k', symmetry.rotations, turn)
    return bool((traces.max() - 1) / 2 >= np.cos(tolerance))


def _is_round(symmetry: Symmetry | None, down: Array, tolerance: float) -> bool:
    """Return whether all turns about a direction map the part onto itself."""
    return all(is_symmetry(symmetry, angle * down, tolerance) for angle in (1.0, 2.2))


def vertical_order(symmetry: Symmetry | None, down: Array) -> int:
    """Return how many rotations about a direction map the part onto itself; 0 if all do."""
    if symmetry is None:
        return 1
    if _is_round(symmetry, down, SAME_DIRECTION):
        return 0
    if symmetry.axis is not None:  # of a body of revolution, beside the direction
        return 2 if is_symmetry(symmetry, np.pi * down, SAME_DIRECTION) else 1
    moved = np.linalg.norm(symmetry.rotations @ down - down, axis=1)
    return int((moved < SAME_DIRECTION).sum())


# A turn of the outline comes from the part if a rotation of the part differs by less, rad, and by
# less than this share of the step of the outline.
SAME_TURN, SAME_SHARE = 0.05, 0.25


@dataclass(frozen=True, eq=False)
class Pose:
    """A pose of a part on the tray.

    aspect : int
    position : (3,) float
        Position of the part frame in the tray frame, m.
    orientation : (4,) float
        Unit quaternion xyzw, tray from part.
    yaw_known : bool
        False if the outline is round and the part is not: then the yaw of the pose is arbitrary,
        and the part may be turned by any angle about the centroid of the outline.
    """

    aspect: int
    position: Array
    orientation: Array
    yaw_known: bool = True


@dataclass(frozen=True, eq=False)
class Placement:
    """All poses of a part that look like an outline at x = y = yaw = 0.

    They are the aspects of the class, which rotations of the part map onto each other, each with
    those rotations of the outline onto itself that no rotation of the part causes. Poses that
    differ by a rotation of the part onto itself are given once for each aspect.
    """

    part: Part
    aspects: AspectSet
    outline: Outline

    @cached_property
    def members(self) -> Array:
        """(k, 3, 3) float: tray from part for each aspect of the class, in the order of ids."""
        first = self._aspect(self.outline.aspect)
        start = Rotation.from_quat(self.outline.orientation).as_matrix()
        symmetry = self.aspects.symmetry
        found = []
        for number in self.outline.aspects:
            down = self._aspect(number).down_in_part
            turn = rotation_to(symmetry, first.down_in_part, down)
            almost = Rotation.from_matrix(start @ turn.T).as_quat()
            exact = turned_down(almost[None], down[None])[0]
            found.append(Rotation.from_quat(exact).as_matrix())
        return np.array(found)

    @cached_property
    def turns(self) -> Array:
        """(n,) float: angles about the centroid, 0 first, that only the outline allows, rad."""
        order = self.outline.yaw_symmetry
        if order < 2:
            return np.zeros(1)
        step = 2 * np.pi / order
        tolerance = min(SAME_TURN, SAME_SHARE * step)
        down = self._aspect(self.outline.aspect).down_in_part
        kept = [0.0]
        for angle in step * np.arange(1, order):
            # Seen from above, a turn by an angle is one by the opposite angle about `down`.
            if not any(
                is_symmetry(self.aspects.symmetry, -(angle - other) * down, tolerance)
                for other in kept
            ):
                kept.append(float(angle))
        return np.array(kept)

    @cached_property
    def yaw_known(self) -> bool:
        """Whether the outline determines the yaw up to rotations of the part onto itself."""
        down = self._aspect(self.outline.aspect).down_in_part
        is_round = _is_round(self.aspects.symmetry, down, SAME_TURN)
        return self.outline.yaw_symmetry > 0 or is_round

    def poses(
        self, x: float, y: float, yaw: float, orientation: Array | None = None
    ) -> tuple[Pose, ...]:
        """Return the poses of the part for a camera pose of the outline.

        The first is that of the representative aspect without a turn; the solutions of all
        aspects for one turn precede those for the next.

        Parameters
        ----------
        x, y : float
            Projection of the centre of mass, m, tray frame.
        yaw : float
            Counter-clockwise seen from above, rad.
        orientation : (4,) float, optional
            Tray from part at yaw 0 of a part that has rolled; see `outline.rolled`.

        Raises
        ------
        InvalidValueError
            A value is not a finite number.
        """
        for name, value in (('x', x), ('y', y), ('yaw', yaw)):
            if isinstance(value, bool) or not isinstance(value, int | float | np.number):
                raise InvalidValueError(f'invalid {name} {shown(value)}: expected a number')
            if not -sys.float_info.max <= value <= sys.float_info.max:  # also refuses nan
                raise InvalidValueError(f'invalid {name} {shown(value)}: expected a finite number')
        if orientation is not None:
            return self._rolled(x, y, yaw, orientation)
        centroid = np.asarray(self.outline.centroid)
        found = []
        for turn in self.turns:
            # The outline turns about its centroid, so the centre of mass moves.
            moved = _turn(yaw)[:2, :2] @ centroid - _turn(yaw + turn)[:2, :2] @ centroid
            for number, start in zip(self.outline.aspects, self.members, strict=True):
                place = np.array([x + moved[0], y + moved[1], self._aspect(number).com_height])
                found.append(self._pose(number, place, _turn(yaw + turn) @ start))
        return tuple(found)

    def _rolled(self, x: float, y: float, yaw: float, orientation: Array) -> tuple[Pose, ...]:
        """Return the poses of a part that has rolled, one for each aspect of the class."""
        rotation = Rotation.from_quat(orientation).as_matrix()
        start = Rotation.from_quat(self.outline.orientation).as_matrix()
        heights = (self.part.hull_vertices - self.part.centre_of_mass) @ rotation[2]
        place = np.array([x, y, -heights.min()])
        return tuple(
            self._pose(number, place, _turn(yaw) @ rotation @ start.T @ member)
            for number, member in zip(self.outline.aspects, self.members, strict=True)
        )

    def _pose(self, number: int, centre: Array, rotation: Array) -> Pose:
        return Pose(
            number,
            centre - rotation @ self.part.centre_of_mass,
            canonical(Rotation.from_matrix(rotation).as_quat()),
            self.yaw_known,
        )

    def _aspect(self, number: int) -> Aspect:
        return self.aspects[number - 1]


def checked_pose(
    position: npt.ArrayLike, orientation: npt.ArrayLike, of: str
) -> tuple[Array, Array]:
    """Return a position (3,), m, and a canonical quaternion (4,) xyzw; InvalidValueError.

    ``of`` states in the error what they are of, such as ' of a grasp'.
    """
    place, xyzw = np.asarray(position, float), np.asarray(orientation, float)
    if place.shape != (3,) or not np.isfinite(place).all():
        raise InvalidValueError(
            f'invalid position {shown(place.tolist())}{of}: expected x, y, z in m'
        )
    if xyzw.shape != (4,) or not abs(math.hypot(*xyzw) - 1) <= LENGTH_TOLERANCE:
        raise InvalidValueError(
            f'invalid orientation {shown(xyzw.tolist())}{of}: expected a unit quaternion xyzw'
        )
    return place, canonical(xyzw)


def _turn(yaw: float) -> Array:
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
