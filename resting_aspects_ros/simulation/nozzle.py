"""A short jet of air: an impulse where its line meets the part."""

import math
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.rotations import Array, Random, random_orientations, rotate
from resting_aspects_ros.simulation.quantity import check_quantities, quantity
from resting_aspects_ros.simulation.starts import Body, Indices, States

# Number of orientations in which the speed after a jet is evaluated.
SAMPLE = 300
_CONJUGATE = np.array([-1.0, -1.0, -1.0, 1.0])


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
        random = np.random.default_rng(0)
        zero = np.zeros((SAMPLE, 3))
        states = States(zero, random_orientations(random, SAMPLE), zero, zero)
        strong = replace(self, impulse=self.impulse + 3 * self.impulse_spread, impulse_spread=0.0)
        after = strong.applied(states, np.arange(SAMPLE), body, random)
        spin = rotate(after.orientation * _CONJUGATE, after.spin)
        turning = np.linalg.norm(np.cross(spin[:, None], body.corners), axis=2).max(axis=1)
        return float((np.linalg.norm(after.velocity, axis=1) + turning).max())

    def applied(self, states: States, row: Indices, body: Body, random: Random, /) -> States:
        """See Impulse."""
        n = len(row)
        impulse = self.impulse + random.standard_normal(n) * self.impulse_spread
        aside = random.standard_normal(n) * self.place_spread
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
