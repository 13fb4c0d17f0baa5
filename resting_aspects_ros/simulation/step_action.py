"""A step down: parts move with a belt over its edge and fall onto a second belt."""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.rotations import Array, Random, rotate
from resting_aspects_ros.simulation.edge import Edge
from resting_aspects_ros.simulation.quantity import check_quantities, quantity
from resting_aspects_ros.simulation.starts import Body, Indices, States

# A part is put onto the upper belt this distance, R, before it would tilt over the edge, which is
# found by halving an interval of at most R.
START_DISTANCE = 0.02
HALVINGS = 6
# Height above the lowest corner, R, up to which a corner of a piece touches the belt. The pieces
# have errors of up to about 1e-3.
CONTACT = 2e-3


@dataclass(frozen=True)
class Step:
    """A belt that carries parts over its edge, and a second belt below it.

    Both belts move along the same line; the lower one moves backwards if its speed is negative. It
    has the friction and the restitution of the conditions. Raises InvalidValueError if a value is
    out of bounds, or if the edge is larger than the step.
    """

    kind: ClassVar[str] = 'step'

    belt_speed: float = quantity(
        'belt speed', 'm/s', 'speed of the upper belt towards the edge', high=100.0, above=True
    )
    step_height: float = quantity(
        'step height', 'm', 'height of the upper belt above the lower', high=100.0, above=True
    )
    lower_speed: float = quantity(
        'lower belt speed',
        'm/s',
        'speed of the lower belt in the same direction; negative: backwards',
        low=-100.0,
        high=100.0,
        default=0.0,
    )
    edge_radius: float = quantity(
        'edge radius',
        'm',
        'radius of the roller over which the upper belt turns; 0: a sharp edge',
        high=10.0,
        default=0.0,
    )
    friction_factor: float = quantity(
        'friction factor',
        '',
        'friction of the upper belt as a multiple of that of the conditions',
        high=100.0,
        default=1.0,
    )
    restitution_factor: float = quantity(
        'restitution factor',
        '',
        'restitution of the upper belt as a multiple of that of the conditions',
        high=100.0,
        default=1.0,
    )

    def __post_init__(self) -> None:
        check_quantities(self)
        if self.edge_radius > self.step_height:
            raise InvalidValueError(
                f'invalid edge radius {self.edge_radius:g}: expected at most the step height, '
                f'{self.step_height:g} m'
            )

    @property
    def has_effect(self) -> bool:
        """Whether the belt can move a part."""
        return True

    def edge(self, pieces: tuple[Array, ...]) -> Edge:
        """Return the edge for a part with these convex pieces; see Edge."""
        return Edge(
            height=self.step_height,
            radius=self.edge_radius,
            belt_speed=self.belt_speed,
            lower_speed=self.lower_speed,
            friction_factor=self.friction_factor,
            restitution_factor=self.restitution_factor,
            pieces=pieces,
        )


def fall_speed(edge: Edge, gravity: float, radius: float) -> float:
    """Return the speed that a part can have relative to the lower belt, m/s.

    ``radius`` is its hull radius, m, by which it falls in addition to the height of the step.
    """
    along = edge.belt_speed - edge.lower_speed
    return math.sqrt(along**2 + 2 * gravity * (edge.height + radius))


@dataclass(frozen=True, eq=False)
class OnBelt:
    """Puts parts at rest onto the upper belt in front of an edge, with the speed of the belt."""

    edge: Edge
    gravity: float

    def max_speed(self, body: Body) -> float:
        """See Impulse."""
        return fall_speed(self.edge, self.gravity, body.radius)

    def applied(self, states: States, row: Indices, body: Body, random: Random, /) -> States:
        """Return the states relative to the wall below the edge; see Impulse and Edge."""
        del row, random
        position = states.position + 0.0
        for k, orientation in enumerate(states.orientation):
            x, z = self._place(orientation, body)
            position[k] = [x, 0.0, z]
        velocity = states.velocity + np.array([self.edge.belt_speed, 0.0, 0.0])
        return States(position, states.orientation, velocity, states.spin)

    def _place(self, orientation: Array, body: Body) -> tuple[float, float]:
        """Return x and z of the centre of mass of a part on the belt in an orientation (4,)."""
        pieces = [rotate(orientation, corners) for corners in self.edge.pieces]
        depth = -min(float(corners[:, 2].min()) for corners in pieces)
        touching = [c[c[:, 2] < CONTACT * body.radius - depth, :2] for c in pieces]
        distance, clear = 0.0, START_DISTANCE * body.radius
        if not _supported(touching, clear):
            # The part tilts before its centre of mass is at the edge.
            supported = max(clear, *(float(c[:, 0].max()) for c in touching if len(c)))
            for _ in range(HALVINGS):
                middle = (distance + supported) / 2
                if _supported(touching, middle):
                    supported = middle
                else:
                    distance = middle
            distance = supported
        return -self.edge.radius - distance - clear, self.edge.height + depth


def _supported(touching: list[Array], distance: float) -> bool:
    """Return whether a part rests on the contacts behind a line in front of its centre of mass.

    touching : list of (k, 2) float
        Corners of the convex areas in contact, relative to the centre of mass, m.
    distance : float
        Of the line across x from the centre of mass, m.
    """
    points = []
    for corners in touching:
        behind = corners[:, 0] <= distance
        points.append(corners[behind])
        for a in corners[behind]:
            beyond = corners[~behind]
            share = (distance - a[0]) / (beyond[:, 0] - a[0])
            points.append(a + share[:, None] * (beyond - a))
    x, y = np.concatenate(points).T
    # The centre of mass is inside the hull of the points if no angle between neighbours, seen
    # from it, exceeds a half turn.
    angles = np.sort(np.arctan2(y, x))
    gaps = np.diff(angles, append=angles[:1] + 2 * np.pi)
    return bool(len(angles) and gaps.max() < np.pi)
