"""Impulses on parts at rest: kick, nozzle, and the disturbances of a retention curve."""

import math
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.rotations import Array, random_orientations, rotate
from resting_aspects_ros.simulation.quantity import check_quantities, quantities_of, quantity
from resting_aspects_ros.simulation.starts import Body, Indices, States

# Default spreads of a kick as shares of its speed.
SPEED_SPREAD = 0.2
HORIZONTAL_SPREAD = 0.1
# Number of orientations in which the speed after a jet is evaluated.
SAMPLE = 300
_CONJUGATE = np.array([-1.0, -1.0, -1.0, 1.0])


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

    def applied(
        self, states: States, row: Indices, _body: Body, generator: np.random.Generator, /
    ) -> States:
        """See Impulse."""
        n = len(row)
        spread = np.array([self.horizontal_spread, self.horizontal_spread, self.speed_spread])
        velocity = generator.standard_normal((n, 3)) * spread + [0.0, 0.0, self.speed]
        spin = generator.standard_normal((n, 3)) * self.spin
        return States(states.position, states.orientation, velocity, spin)


@dataclass(frozen=True)
class Nozzle:
    """A short jet of air: an impulse along a line, at the point where the line meets the part.

    The line rises by ``elevation`` in the direction in which the jet blows. It passes the vertical
    through the centre of mass at the height ``height`` above the surface, and at a random
    horizontal distance. Where it meets the convex hull first, the impulse acts. A part that the
    line does not meet stays where it is. Raises InvalidValueError if a value is out of bounds.
    """

    kind: ClassVar[str] = 'nozzle'

    impulse: float = quantity('impulse', 'N s', 'mean impulse of the jet on the part', high=1e3)
    height: float = quantity(
        'nozzle height',
        'm',
        'height above the surface at which the line of the jet passes the centre of mass',
        low=-100.0,
        high=100.0,
    )
    impulse_spread: float = quantity(
        'impulse spread', 'N s', 'standard deviation of the impulse', high=1e3, default=0.0
    )
    elevation: float = quantity(
        'elevation',
        'rad',
        'angle of the jet above the horizontal; negative: it blows downwards',
        low=-math.pi / 2,
        high=math.pi / 2,
        default=0.0,
    )
    place_spread: float = quantity(
        'place spread',
        'm',
        'standard deviation of the horizontal distance of the line from the centre of mass',
        high=100.0,
        default=0.0,
    )

    def __post_init__(self) -> None:
        check_quantities(self)

    @property
    def has_effect(self) -> bool:
        """Whether the jet can move a part."""
        return self.impulse > 0 or self.impulse_spread > 0

    def max_speed(self, body: Body) -> float:
        """See Impulse; for 3 standard deviations, the fastest of many random orientations."""
        generator = np.random.default_rng(0)
        zero = np.zeros((SAMPLE, 3))
        states = States(zero, random_orientations(generator, SAMPLE), zero, zero)
        strong = replace(self, impulse=self.impulse + 3 * self.impulse_spread, impulse_spread=0.0)
        after = strong.applied(states, np.arange(SAMPLE), body, generator)
        spin = rotate(after.orientation * _CONJUGATE, after.spin)
        turning = np.linalg.norm(np.cross(spin[:, None], body.corners), axis=2).max(axis=1)
        return float((np.linalg.norm(after.velocity, axis=1) + turning).max())

    def applied(
        self, states: States, row: Indices, body: Body, generator: np.random.Generator, /
    ) -> States:
        """See Impulse."""
        n = len(row)
        impulse = self.impulse + generator.standard_normal(n) * self.impulse_spread
        aside = generator.standard_normal(n) * self.place_spread
        point, along, met = self._hit(states, aside, body)
        push = np.where(met, np.maximum(impulse, 0.0), 0.0)[:, None] * along
        # In part axes, where the inertia is constant; solved row by row.
        torque = np.cross(point, push)
        spin = np.stack([(torque * row).sum(axis=1) for row in body.compliance], axis=-1)
        return States(
            states.position,
            states.orientation,
            rotate(states.orientation, push / body.mass),
            rotate(states.orientation, spin),
        )

    def _hit(
        self, states: States, aside: Array, body: Body
    ) -> tuple[Array, Array, npt.NDArray[np.bool_]]:
        """Return points and directions (n, 3) in part axes, and whether (n,) the part is hit."""
        n = len(aside)
        direction = np.array([math.cos(self.elevation), 0.0, math.sin(self.elevation)])
        height = self.height - _height(states.orientation, body)
        origin = np.stack([np.zeros(n), aside, height], axis=-1)
        inverse = states.orientation * _CONJUGATE
        along = rotate(inverse, np.tile(direction, (n, 1)))
        point, met = _first_hit(rotate(inverse, origin), along, body)
        return point, along, met


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

    def applied(
        self, states: States, row: Indices, body: Body, generator: np.random.Generator, /
    ) -> States:
        """See Impulse."""
        direction = generator.standard_normal((len(row), 6))
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


def _height(orientation: Array, body: Body) -> Array:
    """Return the heights (n,) of the centre of mass above the lowest point of the hull, m."""
    down = rotate(orientation * _CONJUGATE, np.tile([0.0, 0.0, -1.0], (len(orientation), 1)))
    x, y, z = down.T[:, :, None]
    hull = body.corners
    reach: Array = (x * hull[:, 0] + y * hull[:, 1] + z * hull[:, 2]).max(axis=1)
    return reach


def _first_hit(origin: Array, along: Array, body: Body) -> tuple[Array, npt.NDArray[np.bool_]]:
    """Return where lines first meet the convex hull (n, 3), and whether (n,) they do.

    Parameters
    ----------
    origin, along : (n, 3) float
        A point of each line, relative to the centre of mass, and its unit direction, part axes.
    """
    gap = body.offsets - _dot(origin, body.normals)
    rate = _dot(along, body.normals)
    with np.errstate(divide='ignore', invalid='ignore'):
        at = gap / rate
    enter = np.where(rate < 0, at, -np.inf).max(axis=1)
    leave = np.where(rate > 0, at, np.inf).min(axis=1)
    outside = ((rate == 0) & (gap < 0)).any(axis=1)
    met = (enter <= leave) & ~outside
    return origin + np.where(met, enter, 0.0)[:, None] * along, met


def _dot(vectors: Array, normals: Array) -> Array:
    """Return all scalar products, (n, f), with a rounding that does not depend on n."""
    x, y, z = vectors.T[:, :, None]
    return np.asarray(x * normals[:, 0] + y * normals[:, 1] + z * normals[:, 2])
