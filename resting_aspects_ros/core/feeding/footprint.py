"""Footprints of parts and grippers on a tray, and the gaps between them."""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.errors import InvalidValueError, shown
from resting_aspects_ros.core.statistics.intervals import Array

Poses = npt.NDArray[np.float64]
# Longer sides of a tray are probably given in mm, m.
MAX_SIDE = 50.0
# Signs of the corners along the length and along the width.
_SIGNS = np.array([[1.0, 1.0, -1.0, -1.0], [1.0, -1.0, 1.0, -1.0]])


@dataclass(frozen=True)
class Footprint:
    """A rectangle, a disc, or a rectangle with round edges: all points within a distance of it.

    length, width : float
        Sides of the rectangle, m; both 0 for a disc.
    radius : float
        Distance from the rectangle, m; 0 for a rectangle with sharp corners.
    grips : tuple of Grip
        Where the gripper can take the part; one without other parts in its footprint is
        sufficient. Without any, the tray states what the gripper needs.
    """

    length: float
    width: float
    radius: float = 0.0
    grips: 'tuple[Grip, ...]' = ()

    def __post_init__(self) -> None:
        if not all(0 <= value < math.inf for value in (self.length, self.width, self.radius)):
            raise InvalidValueError(
                f'invalid footprint {self.length!r} x {self.width!r} m, radius {self.radius!r} m: '
                'expected lengths of 0 m or more'
            )

    @property
    def values(self) -> Array:
        """(3,) half length, half width and radius, m."""
        return np.array([self.length / 2, self.width / 2, self.radius])

    @property
    def reach(self) -> float:
        """Largest distance from the centre, m."""
        return math.hypot(self.length, self.width) / 2 + self.radius

    @property
    def perimeter(self) -> float:
        """Perimeter, m."""
        return 2 * (self.length + self.width) + 2 * math.pi * self.radius

    @property
    def area(self) -> float:
        """Area, m2."""
        band = 2 * (self.length + self.width) * self.radius + math.pi * self.radius**2
        return self.length * self.width + band

    @property
    def text(self) -> str:
        """Length and width in mm, or the diameter, for messages."""
        sides = [1000 * (side + 2 * self.radius) for side in (self.length, self.width)]
        if self.length == self.width == 0:
            return f'{sides[0]:.4g} mm in diameter'
        return f'{sides[0]:.4g} x {sides[1]:.4g} mm'


@dataclass(frozen=True)
class Grip:
    """What a gripper covers when it takes a part.

    footprint : Footprint
    x, y : float
        Centre relative to that of the part's footprint, along its length and its width, m.
    yaw : float
        Angle from the length of the part's footprint to that of the gripper's, rad.
    """

    footprint: Footprint
    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0

    @property
    def reach(self) -> float:
        """Largest distance from the centre of the part's footprint, m."""
        return math.hypot(self.x, self.y) + self.footprint.reach


@dataclass(frozen=True)
class Tray:
    """The tray and the room that the gripper needs.

    A part is free if no other part is closer to it than the clearance, and none reaches into the
    footprint of the gripper.

    size : tuple of float
        Width and depth of the rectangle, m, within which all parts lie.
    clearance : float
        Minimum distance between the outline of a free part and any other outline, m.
    gripper : Footprint or None
        What the gripper covers, centred on the part and turned with it, so that its length is
        along that of the part, for footprints of parts without grips; None: only the clearance
        matters.
    """

    size: tuple[float, float]
    clearance: float
    gripper: Footprint | None = None

    def __post_init__(self) -> None:
        if not all(0 < side <= MAX_SIDE for side in self.size):
            raise InvalidValueError(
                f'invalid tray {shown(self.size)} m: expected two sides of more than 0 and at '
                f'most {MAX_SIDE:g} m'
            )
        if not 0 <= self.clearance <= max(self.size):
            raise InvalidValueError(
                f'invalid clearance {self.clearance!r} m: expected 0 m or more, and at most the '
                f'longer side of the tray, {max(self.size):g} m'
            )

    @property
    def area(self) -> float:
        """Area, m2."""
        return self.size[0] * self.size[1]


def gap(poses: Poses, size: Array, other_poses: Poses, other_size: Array) -> Array:
    """Return the distances (n,) between n pairs of footprints, m; negative if they overlap.

    Where rectangles overlap, the value is minus the sum of the radii, or at most -1e-12.

    Parameters
    ----------
    poses, other_poses : (n, 4) float
        Position, m, and cosine and sine of the yaw.
    size, other_size : (n, 3) float
        Values of the footprints.
    """
    apart = np.zeros(len(poses), dtype=np.bool_)
    nearest = np.full(len(poses), np.inf)
    pairs = ((poses, size, other_poses, other_size), (other_poses, other_size, poses, size))
    for one, box, other, other_box in pairs:
        x, y = _corners(one, other, other_box)
        a, b = box[:, :1], box[:, 1:2]
        outside = np.maximum(np.abs(x) - a, 0) ** 2 + np.maximum(np.abs(y) - b, 0) ** 2
        nearest = np.minimum(nearest, np.sqrt(outside.min(axis=1)))
        # All corners of the other rectangle are beyond the line of a side of this one.
        for along, half in ((x, a[:, 0]), (y, b[:, 0])):
            apart |= (along.min(axis=1) >= half) | (along.max(axis=1) <= -half)
    rounded = size[:, 2] + other_size[:, 2]
    return np.where(apart, nearest - rounded, -np.maximum(rounded, 1e-12))


def _corners(one: Poses, other: Poses, size: Array) -> tuple[Array, Array]:
    """Return x and y (n, 4) of the corners of other rectangles, in the axes of these ones."""
    (dx, dy), (cos, sin) = (other[:, :2] - one[:, :2]).T, one[:, 2:].T
    turn_cos = cos * other[:, 2] + sin * other[:, 3]
    turn_sin = cos * other[:, 3] - sin * other[:, 2]
    a, b = size[:, 0], size[:, 1]
    x = (cos * dx + sin * dy)[:, None] + (turn_cos * a)[:, None] * _SIGNS[0]
    y = (cos * dy - sin * dx)[:, None] + (turn_sin * a)[:, None] * _SIGNS[0]
    return x - (turn_sin * b)[:, None] * _SIGNS[1], y + (turn_cos * b)[:, None] * _SIGNS[1]
