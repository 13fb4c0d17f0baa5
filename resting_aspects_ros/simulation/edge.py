"""The edge of an upper belt, from which parts fall onto a lower belt."""

from dataclasses import dataclass

from resting_aspects_ros.core.rotations import Array


@dataclass(frozen=True, eq=False)
class Edge:
    """The end of an upper belt, as a part meets it. SI units.

    The upper belt moves in the direction x and turns down at x = 0, over a roller along y, whose
    surface moves with it. Below the roller is a vertical wall at x = 0. Velocities are relative to
    this wall; z = 0 is the lower belt.

    height : float
        Of the upper belt above the lower one.
    radius : float
        Of the roller.
    belt_speed, lower_speed : float
        Of the upper and of the lower belt.
    friction_factor, restitution_factor : float
        Friction and restitution of the upper belt, its roller and the wall, as multiples of the
        conditions, which are those of the lower belt.
    pieces : tuple of (k, 3) float
        Corners of convex pieces of the part, relative to its centre of mass, in part axes.
    """

    height: float
    radius: float
    belt_speed: float
    lower_speed: float
    friction_factor: float
    restitution_factor: float
    pieces: tuple[Array, ...]
