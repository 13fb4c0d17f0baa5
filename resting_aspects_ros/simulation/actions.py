"""What a feeder does to parts at rest: its actions, by kind and by name.

The kinds are in one module of more than 600 lines, because a new one changes nothing else.
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from resting_aspects_ros.arrays import Array, Flags, Indices
from resting_aspects_ros.aspects.aspect_set import Aspect
from resting_aspects_ros.errors import InvalidValueError, did_you_mean, shown
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.rotations import Random, random_orientations, rotate
from resting_aspects_ros.simulation.conditions import (
    DropConditions,
    Quantity,
    described_kind,
    made_from,
    quantities_of,
    quantity,
    read_entries,
)
from resting_aspects_ros.simulation.scene import HalfSpace, Scene, X, Z, depth_of
from resting_aspects_ros.simulation.starts import (
    Action,
    Body,
    RestStarts,
    States,
    rest_starts,
)

# -- Kicks ----------------------------------------------------------------------------------------


# Default spreads of a kick as shares of its speed.
SPEED_SPREAD = 0.2
HORIZONTAL_SPREAD = 0.1
# Maximum lift height of a disturbance, m.
MAX_LIFT = 1.0


@dataclass(frozen=True)
class Kick(Action):
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
        speed = quantities_of(self)['speed'].check('speed', self.speed)
        derived = {'speed_spread': SPEED_SPREAD, 'horizontal_spread': HORIZONTAL_SPREAD}
        for name, share in derived.items():
            if getattr(self, name) is None:
                object.__setattr__(self, name, share * speed)
        super().__post_init__()

    @property
    def has_effect(self) -> bool:
        """Whether the kick can move a part."""
        return any((self.speed, self.speed_spread, self.horizontal_spread, self.spin))

    def max_speed(self, at: RestStarts) -> float:
        """See Action; for 3 standard deviations."""
        up = self.speed + 3 * self.speed_spread
        return math.hypot(up, 3 * self.horizontal_spread) + 3 * self.spin * at.body.radius

    def applied(self, states: States, row: Indices, at: RestStarts, random: Random) -> States:
        """See Action."""
        del at
        n = len(row)
        spread = np.array([self.horizontal_spread, self.horizontal_spread, self.speed_spread])
        velocity = random.standard_normal((n, 3)) * spread + [0.0, 0.0, self.speed]
        spin = random.standard_normal((n, 3)) * self.spin
        return dataclasses.replace(states, velocity=states.velocity + velocity, spin=spin)


@dataclass(frozen=True, eq=False)
class Disturbance(Action):
    """Disturbances of fixed energy in random directions, for a retention curve.

    The direction is uniform on the unit sphere of the six mass-weighted velocities sqrt(m) v and
    sqrt(I_k) w_k, with v_z >= 0.

    lift : (rows,) float
        For each row of the starts the energy as a lift height: energy / (mass x gravity), m.
    """

    lift: Array

    def max_speed(self, at: RestStarts) -> float:
        """See Action; by the inequality of Cauchy and Schwarz."""
        body = at.body
        along = body.corners @ body.axes
        # The distances of the corners from the principal axes.
        levers = np.sqrt(np.maximum((along**2).sum(axis=1)[:, None] - along**2, 0.0))
        squares = 1 + (body.mass * levers**2 / body.moments).sum(axis=1).max()
        return math.sqrt(2 * at.gravity * float(self.lift.max()) * squares)

    def applied(self, states: States, row: Indices, at: RestStarts, random: Random) -> States:
        """See Action."""
        body = at.body
        direction = random.standard_normal((len(row), 6))
        direction /= np.sqrt((direction**2).sum(axis=1))[:, None]
        velocity = direction[:, :3] * np.sqrt(2 * at.gravity * self.lift[row])[:, None]
        velocity[:, 2] = np.abs(velocity[:, 2])
        moments, axes = body.moments, body.axes
        scale = np.sqrt(2 * body.mass * at.gravity * self.lift[row])[:, None] / np.sqrt(moments)
        rates = direction[:, 3:] * scale
        spin = np.stack([(rates * axis).sum(axis=1) for axis in axes], axis=-1)
        spin = rotate(states.orientation, spin)
        return dataclasses.replace(states, velocity=states.velocity + velocity, spin=spin)


def disturbance_starts(
    part: Part, aspects: Sequence[Aspect], lift: Array, conditions: DropConditions
) -> RestStarts:
    """Return a part at rest in these aspects, disturbed with the energy of each lift height.

    Parameters
    ----------
    lift : (a, m) float
        Lift heights of each of the a aspects, m. Row a * m + j of the starts has ``lift[a, j]``.
    """
    wrong = lift[~((lift > 0) & (lift <= MAX_LIFT))]
    if wrong.size:
        raise InvalidValueError(
            f'invalid lift height {wrong.flat[0]:g}: expected more than 0 and at most '
            f'{MAX_LIFT:g} m'
        )
    each = [aspect for aspect in aspects for _ in range(lift.shape[1])]
    return rest_starts(part, each, Disturbance(lift.ravel()), conditions)


# -- A jet of air ---------------------------------------------------------------------------------


# Number of orientations in which the speed after a jet is evaluated.
SAMPLE = 300
_CONJUGATE = np.array([-1.0, -1.0, -1.0, 1.0])


@dataclass(frozen=True)
class Nozzle(Action):
    """A short jet of air: an impulse along a line, at the point where the line meets the part.

    The line rises by ``elevation`` in the direction in which the jet blows. It passes the vertical
    through the centre of mass at the height ``height`` above the surface, and at a random
    horizontal distance. Where it meets the convex hull first, the impulse acts. A part that the
    line does not meet stays where it is. Raises InvalidValueError if a value is out of bounds.
    """

    kind: ClassVar[str] = 'nozzle'
    can_miss: ClassVar[bool] = True

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

    @property
    def has_effect(self) -> bool:
        """Whether the jet can move a part."""
        return self.impulse > 0 or self.impulse_spread > 0

    def max_speed(self, at: RestStarts) -> float:
        """See Action; for 3 standard deviations, the fastest of many random orientations."""
        random = np.random.default_rng(0)
        zero = np.zeros((SAMPLE, 3))
        states = States(zero, random_orientations(random, SAMPLE), zero, zero)
        strong = replace(self, impulse=self.impulse + 3 * self.impulse_spread, impulse_spread=0.0)
        after = strong.applied(states, np.arange(SAMPLE), at, random)
        spin = rotate(after.orientation * _CONJUGATE, after.spin)
        turning = np.linalg.norm(np.cross(spin[:, None], at.body.corners), axis=2).max(axis=1)
        return float((np.linalg.norm(after.velocity, axis=1) + turning).max())

    def applied(self, states: States, row: Indices, at: RestStarts, random: Random) -> States:
        """See Action."""
        n, body = len(row), at.body
        impulse = self.impulse + random.standard_normal(n) * self.impulse_spread
        aside = random.standard_normal(n) * self.place_spread
        direction = np.array([math.cos(self.elevation), 0.0, math.sin(self.elevation)])
        height = self.height - depth_of(states.orientation, body.corners)
        origin = np.stack([np.zeros(n), aside, height], axis=-1)
        inverse = states.orientation * _CONJUGATE
        along = rotate(inverse, direction)
        point, met = _first_hit(rotate(inverse, origin), along, body)
        push = np.where(met, np.maximum(impulse, 0.0), 0.0)[:, None] * along
        # In part axes, where the inertia is constant; solved row by row.
        torque = np.cross(point, push)
        spin = np.stack([(torque * row).sum(axis=1) for row in body.compliance], axis=-1)
        return dataclasses.replace(
            states,
            velocity=states.velocity + rotate(states.orientation, push / body.mass),
            spin=rotate(states.orientation, spin),
        )


def _first_hit(origin: Array, along: Array, body: Body) -> tuple[Array, Flags]:
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


# -- Vibration ------------------------------------------------------------------------------------


# Periods in which the amplitudes rise from zero, and in which they fall to zero. A sine that
# begins at full amplitude is a jump of the velocity. With 5 periods the acceleration exceeds that
# of the full amplitude by at most 0.2 % during a ramp, with 3 periods by 0.6 %.
RAMP_PERIODS = 5
# Minimum number of time steps per period.
STEPS_PER_PERIOD = 40
# Maximum acceleration of a point of the plate, m/s2: 100 g. Feeders have some g.
MAX_ACCELERATION = 981.0
# Minimum amplitude of the rocking, rad: 1 um at 100 mm. Less is below the errors of a simulation.
MIN_ROCKING = 1e-5
# Assumed speed of the fastest impacts as a multiple of the maximum speed of the plate. It limits
# the travel of a part per time step.
IMPACT_SPEED = 3.0


@dataclass(frozen=True)
class Vibration(Action):
    """A square plate that vibrates as a rigid body, with a horizontal surface at rest.

    The middle of the plate moves by ``vertical_amplitude`` x sin(2 pi f t) in z and by
    ``horizontal_amplitude`` x sin(2 pi f t + ``horizontal_phase``) in x. The plate turns about a
    fixed horizontal axis through its middle by the rotation vector (``rocking_x``, ``rocking_y``,
    0) x sin(2 pi f t + ``rocking_phase``). All amplitudes rise from zero in the first
    RAMP_PERIODS periods and fall to zero in the last. The parts start at uniformly random places
    of the plate, and are lost if their centre of mass passes its edge. The phase is that of the
    machine, the same for all parts.

    Raises InvalidValueError if a value is out of bounds, if the duration is shorter than the two
    ramps, if the plate does not rock, or if its acceleration exceeds MAX_ACCELERATION. A plate
    without rocking would turn over parts that lie flat only through rounding errors.
    """

    kind: ClassVar[str] = 'vibration'

    frequency: float = quantity(
        'frequency', 'Hz', 'frequency of the plate', high=1000.0, above=True
    )
    duration: float = quantity(
        'duration',
        's',
        f'from start to end of the motion, with two ramps of {RAMP_PERIODS} periods each',
        high=3600.0,
        above=True,
    )
    plate_size: float = quantity(
        'plate size', 'm', 'side of the square plate', high=100.0, above=True
    )
    vertical_amplitude: float = quantity(
        'vertical amplitude', 'm', 'half of the vertical travel', high=0.1, default=0.0
    )
    horizontal_amplitude: float = quantity(
        'horizontal amplitude', 'm', 'half of the horizontal travel', high=0.1, default=0.0
    )
    horizontal_phase: float = quantity(
        'horizontal phase',
        'rad',
        'phase of the horizontal motion relative to the vertical',
        low=-2 * math.pi,
        high=2 * math.pi,
        default=0.0,
    )
    rocking_x: float = quantity(
        'rocking about x',
        'rad',
        'amplitude of the rotation about the direction of the horizontal motion',
        high=0.1,
        default=0.0,
    )
    rocking_y: float = quantity(
        'rocking about y',
        'rad',
        'amplitude of the rotation about the other horizontal direction',
        high=0.1,
        default=0.0,
    )
    rocking_phase: float = quantity(
        'rocking phase',
        'rad',
        'phase of the rocking relative to the vertical motion',
        low=-2 * math.pi,
        high=2 * math.pi,
        default=0.0,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.duration < 2 * self._ramp:
            raise InvalidValueError(
                f'invalid duration {self.duration:g}: expected at least {2 * self._ramp:g} s, two '
                f'ramps of {RAMP_PERIODS} periods'
            )
        if self._rocking < MIN_ROCKING:
            raise InvalidValueError(
                f'invalid rocking {self._rocking:g}: expected rocking_x or rocking_y of at least '
                f'{MIN_ROCKING:g} rad, because a plate that does not tilt turns over parts that '
                'lie flat only through rounding errors'
            )
        acceleration = self._max_speed * self._rate
        if acceleration > MAX_ACCELERATION:
            raise InvalidValueError(
                f'invalid acceleration {acceleration:.4g} m/s2 of the plate, which follows from '
                f'its amplitudes, frequency and size: expected at most {MAX_ACCELERATION:g} m/s2'
            )

    @property
    def motion(self) -> 'Vibration':
        """The plate itself."""
        return self

    @property
    def time_step(self) -> float:
        """Maximum time step that resolves the motion, s."""
        return 1 / (STEPS_PER_PERIOD * self.frequency)

    def max_speed(self, at: RestStarts) -> float:
        """See Action; IMPACT_SPEED times that of the plate."""
        del at
        return IMPACT_SPEED * self._max_speed

    def applied(self, states: States, row: Indices, at: RestStarts, random: Random) -> States:
        """Return the states at random places of the plate; in surroundings, unchanged states."""
        if not at.scene.level:
            return states
        place = states.position.copy()
        place[:, :2] = (random.random((len(row), 2)) - 0.5) * self.plate_size
        return dataclasses.replace(states, position=place)

    def pose(self, time: Array) -> tuple[Array, Array]:
        """Return positions (n, 3), m, and quaternions (n, 4), tray from surface, at times (n,).

        Before the motion begins and after its end, the frame of the surface is the tray frame.
        """
        vertical, horizontal, rocking = (part[0] for part in self._parts(time))
        angle = rocking * self._rocking / 2
        x, y = self.rocking_x / self._rocking, self.rocking_y / self._rocking
        zero = np.zeros(len(time))
        orientation = np.stack([np.sin(angle) * x, np.sin(angle) * y, zero, np.cos(angle)], -1)
        return self._at(horizontal, vertical), orientation

    def velocity(self, time: Array) -> tuple[Array, Array]:
        """Return the derivatives: velocity (n, 3), m/s, and angular velocity (n, 3), rad/s.

        The velocity is that of the origin of the surface; both are in tray axes.
        """
        vertical, horizontal, rocking = (part[1] for part in self._parts(time))
        zero = np.zeros(len(time))
        spin = np.stack([rocking * self.rocking_x, rocking * self.rocking_y, zero], -1)
        return self._at(horizontal, vertical), spin

    def _at(self, horizontal: Array, vertical: Array) -> Array:
        x, z = horizontal * self.horizontal_amplitude, vertical * self.vertical_amplitude
        return np.stack([x, np.zeros(len(x)), z], axis=-1)

    def _parts(self, time: Array) -> list[tuple[Array, Array]]:
        """Return (n,) values and derivatives of vertical, horizontal and rocking motion.

        In units of their amplitudes, and in 1/s.
        """
        # A polynomial whose first two derivatives are zero at both ends of a ramp.
        u = np.clip(np.minimum(time, self.duration - time) / self._ramp, 0.0, 1.0)
        ramp = u**3 * (10 - 15 * u + 6 * u**2)
        rise = 30 * u**2 * (1 - u) ** 2 / self._ramp * np.sign(self.duration / 2 - time)
        angle = self._rate * time
        parts = []
        for phase in (0.0, self.horizontal_phase, self.rocking_phase):
            sine, cosine = np.sin(angle + phase), np.cos(angle + phase)
            parts.append((ramp * sine, rise * sine + ramp * self._rate * cosine))
        return parts

    @property
    def _rate(self) -> float:
        return 2 * math.pi * self.frequency

    @property
    def _ramp(self) -> float:
        """Duration of a ramp, s."""
        return RAMP_PERIODS / self.frequency

    @property
    def _rocking(self) -> float:
        return math.hypot(self.rocking_x, self.rocking_y)

    @property
    def _max_speed(self) -> float:
        """Upper bound of the speed of the corners of the plate at full amplitude, m/s."""
        amplitude = math.hypot(self.vertical_amplitude, self.horizontal_amplitude)
        return (amplitude + self._rocking * self.plate_size / math.sqrt(2)) * self._rate


# -- A step ---------------------------------------------------------------------------------------


# A part is put onto the upper belt this distance, R, before it would tilt over the edge, which is
# found by halving an interval of at most R.
START_DISTANCE = 0.02
HALVINGS = 6
# Height above the lowest corner, R, up to which a corner of a piece touches the belt. The pieces
# have errors of up to about 1e-3.
CONTACT = 2e-3
# Distance in surroundings between a part and the roller at the start, R; more than the minimum
# radius of a roller.
BEHIND = 0.05


@dataclass(frozen=True)
class Step(Action):
    """A belt that carries parts over its edge, and a second belt below it.

    The upper belt moves in the direction x and turns down at x = 0, over a roller along y, whose
    surface moves with it. Below the roller is a vertical wall at x = 0. Velocities are relative to
    this wall; z = 0 is the lower belt, which moves backwards if its speed is negative. Both have
    the friction and the restitution of the conditions. Raises InvalidValueError if a value is out
    of bounds, or if the edge is larger than the step.
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

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.edge_radius > self.step_height:
            raise InvalidValueError(
                f'invalid edge radius {self.edge_radius:g}: expected at most the step height, '
                f'{self.step_height:g} m'
            )

    @property
    def edge(self) -> 'Step':
        """The step itself."""
        return self

    def check(self, name: str, scene: Scene) -> None:
        """See Action: floor and walls must be the same above and below the edge."""
        floor = scene.bodies[0]
        level = isinstance(floor, HalfSpace) and np.array_equal(floor.normal, Z)
        if not (scene.flat and scene.free and level):
            raise InvalidValueError(
                f'invalid action {name} in surroundings: expected plane, slope, wall or chute, '
                'whose floor and walls are the same everywhere along x, so that they are the same '
                'above and below the edge; a fall into other surroundings is simulated by drops '
                'from initial states, those of parts that leave the upper belt'
            )
        speed = floor.contact.speed
        if speed not in (0.0, self.belt_speed):
            raise InvalidValueError(
                f'invalid belt speed {self.belt_speed:g} m/s of {name}: expected {speed:g} m/s, '
                f'the speed of the {floor.name} of the surroundings, which is the upper belt; the '
                'lower belt has the lower speed of the action'
            )

    def max_speed(self, at: RestStarts) -> float:
        """See Action: relative to the lower belt. A part also falls by its hull radius."""
        along = self.belt_speed - self.lower_speed
        fall = 2 * at.gravity * (self.step_height + at.body.radius)
        return max(math.sqrt(along**2 + fall), self.belt_speed)

    def applied(self, states: States, row: Indices, at: RestStarts, random: Random) -> States:
        """Return the states on the upper belt, relative to the wall below the edge."""
        del row, random
        place = self._before_edge if at.scene.level else self._behind_edge
        belt = at.scene.in_tray(self.belt_speed * X[None])
        return dataclasses.replace(
            states,
            position=place(states, at),
            velocity=np.tile(belt, (len(states.position), 1)),
        )

    def _before_edge(self, states: States, at: RestStarts) -> Array:
        """Return positions (n, 3), m, on a level belt, shortly before parts tilt over its edge."""
        found = np.zeros((len(states.orientation), 3))
        for row, orientation in zip(found, states.orientation, strict=True):
            pieces = [rotate(orientation, corners) for corners in at.pieces]
            distance, depth = _place(pieces, at.body.radius)
            clear = START_DISTANCE * at.body.radius
            row[[0, 2]] = -self.edge_radius - distance - clear, self.step_height + depth
        return found

    def _behind_edge(self, states: States, at: RestStarts) -> Array:
        """Return positions (n, 3), m, of parts in surroundings that are whole behind the edge."""
        scene = at.scene
        front = depth_of(states.orientation, at.body.corners, scene.in_tray(X[None])[0])
        place = scene.in_scene(states.position)
        place[:, 0] = -self.edge_radius - BEHIND * at.body.radius - front
        place[:, 2] += self.step_height
        return scene.in_tray(place)


def _place(pieces: list[Array], radius: float) -> tuple[float, float]:
    """Return how far in front of its centre of mass a part needs the belt, and its height, m."""
    depth = -min(float(corners[:, 2].min()) for corners in pieces)
    touching = [c[c[:, 2] < CONTACT * radius - depth, :2] for c in pieces]
    distance, clear = 0.0, START_DISTANCE * radius
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
    return distance, depth


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


# -- Named actions --------------------------------------------------------------------------------


KINDS: dict[str, type[Action]] = {each.kind: each for each in (Kick, Nozzle, Vibration, Step)}
# The time that an action takes, with the time until parts are at rest again.
TIME = Quantity('time', 's', 'time from one action to the next', high=3600.0, above=True)
DEFAULT_TIME = 1.0


@dataclasses.dataclass(frozen=True)
class NamedAction:
    """An action with its name and the time that it takes, s. ``source`` is that of its numbers."""

    name: str
    action: Action
    time: float = DEFAULT_TIME
    source: str = ''

    def __post_init__(self) -> None:
        if not isinstance(self.action, tuple(KINDS.values())):
            raise InvalidValueError(
                f'invalid action {shown(self.action)} of {self.name}: expected one of '
                f'{", ".join(each.__name__ for each in KINDS.values())}'
            )
        object.__setattr__(self, 'time', TIME.check('time', self.time))

    @property
    def moving_time(self) -> float:
        """Time in which the action moves parts, s: that of its motion, or all its time."""
        motion = self.action.motion
        return self.time if motion is None else min(motion.duration, self.time)

    @property
    def values(self) -> dict[str, Any]:
        """Name, kind, time and all numbers of the action, in SI units."""
        action = self.action
        return {'name': self.name, 'kind': action.kind, 'time': self.time, **action.numbers}

    @property
    def text(self) -> str:
        """The action in words: 'kick, speed 0.3 m/s, spin spread 10 rad/s'; zeros are left out."""
        parts = [self.action.kind]
        for name, each in quantities_of(self.action).items():
            if value := getattr(self.action, name):
                parts.append(f'{each.label} {value:g} {each.unit}'.rstrip())
        return ', '.join(parts)


class Actions:
    """The named actions of a file of the form of config/actions.yaml.

    Raises InvalidValueError if the file cannot be used.
    """

    def __init__(self, path: Path) -> None:
        self._actions = read_entries(path, 'actions file', 'an action', 'actions', _named_action)

    def names(self) -> list[str]:
        """Return all names, in the order of the file."""
        return list(self._actions)

    def get(self, name: str) -> NamedAction:
        """Return a named action; raises InvalidValueError."""
        if name not in self._actions:
            expected = self.names()
            if name not in KINDS:  # where a kind is an action, too, its name does not come here
                expected = [*KINDS, *(each for each in expected if each not in KINDS)]
            raise InvalidValueError(
                f'invalid action {shown(name)}: expected one of {", ".join(expected)}'
                f'{did_you_mean(name, expected)}'
            )
        return self._actions[name]


def make_action(kind: str, values: Mapping[str, Any]) -> Action:
    """Return the action of a kind with these values; raises InvalidValueError.

    Values that are left out have their defaults.
    """
    return made_from(KINDS, 'action', kind, values)


def _named_action(name: str, entry: Any) -> NamedAction:
    kind, values, source = described_kind('action', entry, KINDS)
    time = values.pop('time', DEFAULT_TIME)
    return NamedAction(name, make_action(kind, values), time, source)
