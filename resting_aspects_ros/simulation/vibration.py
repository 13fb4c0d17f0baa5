"""A plate that vibrates below parts at rest."""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.rotations import Array, Random
from resting_aspects_ros.simulation.quantity import check_quantities, quantity
from resting_aspects_ros.simulation.starts import Body, Indices, States

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
class Vibration:
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
        check_quantities(self)
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
    def has_effect(self) -> bool:
        """Whether the plate can move a part."""
        return True

    @property
    def time_step(self) -> float:
        """See Motion."""
        return 1 / (STEPS_PER_PERIOD * self.frequency)

    def max_speed(self, _body: Body) -> float:
        """See Impulse; IMPACT_SPEED times that of the plate."""
        return IMPACT_SPEED * self._max_speed

    def applied(self, states: States, row: Indices, _body: Body, random: Random, /) -> States:
        """Return the states at random places of the plate; see Impulse."""
        place = states.position.copy()
        place[:, :2] = (random.random((len(row), 2)) - 0.5) * self.plate_size
        return States(place, states.orientation, states.velocity, states.spin)

    def pose(self, time: Array) -> tuple[Array, Array]:
        """See Motion."""
        vertical, horizontal, rocking = (part[0] for part in self._parts(time))
        angle = rocking * self._rocking / 2
        x, y = self.rocking_x / self._rocking, self.rocking_y / self._rocking
        zero = np.zeros(len(time))
        orientation = np.stack([np.sin(angle) * x, np.sin(angle) * y, zero, np.cos(angle)], -1)
        return self._at(horizontal, vertical), orientation

    def velocity(self, time: Array) -> tuple[Array, Array]:
        """See Motion."""
        vertical, horizontal, rocking = (part[1] for part in self._parts(time))
        zero = np.zeros(len(time))
        spin = np.stack([rocking * self.rocking_x, rocking * self.rocking_y, zero], -1)
        return self._at(horizontal, vertical), spin

    def left(self, position: Array) -> npt.NDArray[np.bool_]:
        """See Motion."""
        return np.asarray(np.abs(position[:, :2]).max(axis=1) > self.plate_size / 2)

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
