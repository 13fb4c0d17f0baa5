"""Initial states of parts that are not dropped: given states, and disturbed parts at rest.

The index of a drop decides its row and its replicate: with k rows, drop i is replicate i // k of
row i % k. So the first m drops of a run contain all rows equally often, except for the last few.
"""

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.rotations import Array, Random, canonical, product, rotate
from resting_aspects_ros.simulation.edge import Edge
from resting_aspects_ros.simulation.motion import Motion
from resting_aspects_ros.simulation.noise import Noise

Indices = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class States:
    """States of n parts, in SI units and tray axes.

    position, velocity : (n, 3)
        Of the centre of mass, m and m/s. A part that would be below the surface is lifted onto it.
    orientation : (n, 4)
        Unit quaternions xyzw, tray from part.
    spin : (n, 3)
        Angular velocity, rad/s.
    """

    position: Array
    orientation: Array
    velocity: Array
    spin: Array


class Starts(Protocol):
    """Where and how the parts of a run start; determined by the index and the random numbers."""

    @property
    def rows(self) -> int:
        """Number of different starts."""

    @property
    def max_speed(self) -> float:
        """Speed at which the fastest point of a part can hit the surface first, m/s."""

    @property
    def motion(self) -> Motion | None:
        """Motion of the surface, on which the positions then are; None: it stays at rest."""

    @property
    def edge(self) -> Edge | None:
        """Edge that the parts pass before they are on the surface; None: there is none."""

    def states(self, index: Indices, random: Random) -> States:
        """Return the states of the drops of a chunk, whose indices (n,) are consecutive."""


@dataclass(frozen=True, eq=False)
class GivenStates:
    """Recorded or computed states from which parts start, n of them.

    Parameters
    ----------
    position : (n, 3) array_like
        Centre of mass in the tray frame, m.
    orientation : (n, 4) array_like
        Quaternions xyzw, tray from part, of any length but zero.
    velocity : (n, 3) array_like
        Of the centre of mass, tray axes, m/s; zero by default.
    spin : (n, 3) array_like
        Angular velocity in the axes of the part, as an inertial sensor measures it, rad/s; zero
        by default.

    Raises
    ------
    InvalidValueError
        If a shape is wrong, a value is not finite, a quaternion is zero, or there is no state.
    """

    position: Array
    orientation: Array
    velocity: Any = None
    spin: Any = None

    def __post_init__(self) -> None:
        n = len(np.asarray(self.orientation))
        if n == 0:
            raise InvalidValueError('invalid initial states: expected at least one')
        for name, columns in (('position', 3), ('orientation', 4), ('velocity', 3), ('spin', 3)):
            given = getattr(self, name)
            array = np.array(np.zeros((n, 3)) if given is None else given, dtype=np.float64)
            if array.shape != (n, columns):
                raise InvalidValueError(
                    f'invalid shape {array.shape} of {name}: expected {(n, columns)}'
                )
            wrong = np.flatnonzero(~np.isfinite(array).all(axis=1))
            if len(wrong):
                raise InvalidValueError(
                    f'invalid {name} {array[wrong[0]].tolist()} of initial state '
                    f'{int(wrong[0])}: expected finite numbers'
                )
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        zero = np.flatnonzero(~self.orientation.any(axis=1))
        if len(zero):
            raise InvalidValueError(
                f'invalid orientation [0, 0, 0, 0] of initial state {int(zero[0])}: expected a '
                'quaternion'
            )
        object.__setattr__(self, 'orientation', canonical(self.orientation))

    def __len__(self) -> int:
        return len(self.orientation)


class GivenStarts:
    """Given states with noise. Every replicate of a state has its own noise."""

    motion: Motion | None = None
    edge: Edge | None = None

    def __init__(self, given: GivenStates, noise: Noise, gravity: float, radius: float) -> None:
        self._states = States(
            given.position,
            given.orientation,
            given.velocity,
            rotate(given.orientation, given.spin),
        )
        self._noise = noise
        self.rows = len(given)
        velocity = np.linalg.norm(given.velocity, axis=1) + 3 * noise.velocity
        spin = np.linalg.norm(given.spin, axis=1) + 3 * noise.spin
        fall = 2 * gravity * np.maximum(given.position[:, 2], 0)
        self.max_speed = float((np.sqrt(velocity**2 + fall) + spin * radius).max())

    def states(self, index: Indices, random: Random) -> States:
        """Return the states of some drops; see Starts."""
        row, s = index % self.rows, self._states
        chosen = States(s.position[row], s.orientation[row], s.velocity[row], s.spin[row])
        return _with_noise(chosen, self._noise, random)


def _with_noise(states: States, noise: Noise, random: Random) -> States:
    """Return the states with independent errors."""
    shape = states.position.shape
    turn = random.standard_normal(shape) * noise.orientation
    velocity = states.velocity + random.standard_normal(shape) * noise.velocity
    spin = states.spin + random.standard_normal(shape) * noise.spin
    angle = np.linalg.norm(turn, axis=1, keepdims=True)
    # sinc(x) is sin(pi x) / (pi x), which has no division by zero.
    vector = turn / 2 * np.sinc(angle / 2 / np.pi)
    orientation = product(np.hstack([vector, np.cos(angle / 2)]), states.orientation)
    return States(states.position, orientation, velocity, spin)


@dataclass(frozen=True, eq=False)
class Body:
    """What an impulse acts on: a part, in SI units and part axes.

    inertia : (3, 3)
        About the centre of mass.
    corners : (k, 3)
        Of the convex hull, relative to the centre of mass.
    normals, offsets : (f, 3) and (f,)
        Planes of the convex hull: points inside have ``normals @ x <= offsets``, relative to the
        centre of mass.
    radius : float
        Hull radius R, m.
    moments, axes : (3,) and (3, 3)
        Principal moments of inertia, and the principal axes as columns.
    compliance : (3, 3)
        Inverse of the inertia.
    """

    mass: float
    inertia: Array
    corners: Array
    normals: Array
    offsets: Array
    radius: float
    moments: Array
    axes: Array
    compliance: Array


class Impulse(Protocol):
    """A disturbance that changes velocity and spin at once, or where the surface moves, places."""

    def max_speed(self, body: Body) -> float:
        """Return the speed that the fastest point of the part can have after it, m/s."""

    def applied(self, states: States, row: Indices, body: Body, random: Random, /) -> States:
        """Return the states after the disturbance; ``row`` (n,) are the rows of the starts."""


@dataclass(frozen=True, eq=False)
class RestStarts:
    """Parts at rest in aspects, with a uniform yaw, to which an impulse is applied.

    orientations : tuple of (m, 4) float
        For each row the orientations, tray from part, in which a part can rest: one, or for a
        rolling part one for each direction of its sweep.
    weights : tuple of (m,) float
        Their probabilities.
    impulse : Impulse
    body : Body
    motion : Motion or None
    edge : Edge or None
    """

    orientations: tuple[Array, ...]
    weights: tuple[Array, ...]
    impulse: Impulse
    body: Body
    motion: Motion | None = None
    edge: Edge | None = None

    @property
    def rows(self) -> int:
        """Number of different starts."""
        return len(self.orientations)

    @property
    def max_speed(self) -> float:
        """See Starts."""
        return self.impulse.max_speed(self.body)

    def states(self, index: Indices, random: Random) -> States:
        """Return the states of some drops; see Starts."""
        row = index % self.rows
        n = len(index)
        share, half_yaw = random.random(n), random.random(n) * np.pi
        orientation = np.empty((n, 4))
        for r in np.unique(row).tolist():
            here = row == r
            # The last interval is open, so that rounding in the sum leaves no gap.
            chosen = np.searchsorted(np.cumsum(self.weights[r])[:-1], share[here], side='right')
            orientation[here] = self.orientations[r][chosen]
        zero = np.zeros(n)
        yaw = np.stack([zero, zero, np.sin(half_yaw), np.cos(half_yaw)], axis=-1)
        none = np.zeros((n, 3))
        states = States(none, product(yaw, orientation), none, none)
        return self.impulse.applied(states, row, self.body, random)
