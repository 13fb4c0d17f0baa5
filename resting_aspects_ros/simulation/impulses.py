"""Impulses on parts at rest: kicks, and the disturbances of a retention curve."""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from resting_aspects_ros.core.rotations import Array, Random, rotate
from resting_aspects_ros.simulation.quantity import check_quantities, quantities_of, quantity
from resting_aspects_ros.simulation.starts import Body, Indices, States

# Default spreads of a kick as shares of its speed.
SPEED_SPREAD = 0.2
HORIZONTAL_SPREAD = 0.1


@dataclass(frozen=True)
class Kick:
    """A velocity and a spin at once: a tap from below, or any other short disturbance.

    ``speed_spread`` and ``horizontal_spread`` follow from the speed if they are None. Raises
    InvalidValueError if a value is out of bounds.
    """

    kind: ClassVar[str] = 'kick'

    speed: float = quantity(
        'speed', 'm/s', 'mean of the vertical speed after the kick', high=100.0, default=0.0
    )
    speed_spread: float = quantity(
        'speed spread',
        'm/s',
        f'standard deviation of the vertical speed ({SPEED_SPREAD:g} x speed)',
        high=100.0,
        default=None,
    )
    horizontal_spread: float = quantity(
        'horizontal speed spread',
        'm/s',
        'standard deviation of each horizontal component of the speed '
        f'({HORIZONTAL_SPREAD:g} x speed)',
        high=100.0,
        default=None,
    )
    spin: float = quantity(
        'spin spread',
        'rad/s',
        'standard deviation of each component of the spin',
        high=1e4,
        default=0.0,
    )

    def __post_init__(self) -> None:
        quantities_of(self)['speed'].check('speed', self.speed)
        derived = {'speed_spread': SPEED_SPREAD, 'horizontal_spread': HORIZONTAL_SPREAD}
        for name, share in derived.items():
            if getattr(self, name) is None:
                object.__setattr__(self, name, share * self.speed)
        check_quantities(self)

    @property
    def has_effect(self) -> bool:
        """Whether the kick can move a part."""
        return any((self.speed, self.speed_spread, self.horizontal_spread, self.spin))

    def max_speed(self, body: Body) -> float:
        """See Impulse; for 3 standard deviations."""
        up = self.speed + 3 * self.speed_spread
        return math.hypot(up, 3 * self.horizontal_spread) + 3 * self.spin * body.radius

    def applied(self, states: States, row: Indices, _body: Body, random: Random, /) -> States:
        """See Impulse."""
        n = len(row)
        spread = np.array([self.horizontal_spread, self.horizontal_spread, self.speed_spread])
        velocity = random.standard_normal((n, 3)) * spread + [0.0, 0.0, self.speed]
        spin = random.standard_normal((n, 3)) * self.spin
        return States(states.position, states.orientation, velocity, spin)


@dataclass(frozen=True, eq=False)
class Disturbance:
    """Disturbances of fixed energy in random directions, for a retention curve.

    The direction is uniform on the unit sphere of the six mass-weighted velocities sqrt(m) v and
    sqrt(I_k) w_k, with v_z >= 0.

    lift : (rows,) float
        For each row of the starts the energy as a lift height: energy / (mass x gravity), m.
    gravity : float
        m/s2.
    """

    lift: Array
    gravity: float

    def max_speed(self, body: Body) -> float:
        """See Impulse; by the inequality of Cauchy and Schwarz."""
        moments, levers = _moments_and_levers(body)
        squares = 1 + (body.mass * levers**2 / moments).sum(axis=1).max()
        return math.sqrt(2 * self.gravity * float(self.lift.max()) * squares)

    def applied(self, states: States, row: Indices, body: Body, random: Random, /) -> States:
        """See Impulse."""
        direction = random.standard_normal((len(row), 6))
        direction /= np.sqrt((direction**2).sum(axis=1))[:, None]
        velocity = direction[:, :3] * np.sqrt(2 * self.gravity * self.lift[row])[:, None]
        velocity[:, 2] = np.abs(velocity[:, 2])
        moments, axes = body.moments, body.axes
        scale = np.sqrt(2 * body.mass * self.gravity * self.lift[row])[:, None] / np.sqrt(moments)
        rates = direction[:, 3:] * scale
        spin = np.stack([(rates * axis).sum(axis=1) for axis in axes], axis=-1)
        return States(
            states.position, states.orientation, velocity, rotate(states.orientation, spin)
        )


def _moments_and_levers(body: Body) -> tuple[Array, Array]:
    """Return the principal moments (3,) and the distances (k, 3) of the corners to their axes."""
    along = body.corners @ body.axes
    squares = (along**2).sum(axis=1)[:, None] - along**2
    return body.moments, np.sqrt(np.maximum(squares, 0.0))
