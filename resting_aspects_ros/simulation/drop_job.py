"""The input of a worker, in the part's own scale.

Lengths are in units of the hull radius R, times in units of T = sqrt(R / g), and the mass is 1.
Therefore g is 1.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.aspects.rest_rule import RestRule
from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.rotations import Array
from resting_aspects_ros.simulation.conditions import DropConditions
from resting_aspects_ros.simulation.edge import Edge
from resting_aspects_ros.simulation.motion import Motion
from resting_aspects_ros.simulation.run_description import BULLET, CUDA, KERNEL
from resting_aspects_ros.simulation.starts import Starts
from resting_aspects_ros.simulation.surroundings.scene import Scene

# Time steps per T of lasting contact in the kernel.
CONTACT_STEPS = 40
# Number of drops that a worker makes at once. It affects no pose.
CHUNKS = {KERNEL: 500, CUDA: 100_000, BULLET: 125}
# Bullet's minimum number of time steps per T. Finer steps change no probability of an L bracket by
# more than the sampling error.
STEPS_PER_T = 160
# The same while the surface moves. A plate that hardly tilts hits a part that lies flat with one
# corner after the other, which finer steps resolve. In the worst case found (a box with
# restitution 0.3 on a plate of 25 Hz, 1.5 mm and 0.001 rad), a share of 0.20 with 640 and 1280
# steps was 0.22 with 320 and 0.25 with 160 steps (standard error 0.01).
MOTION_STEPS_PER_T = 320
# The same for the first impacts of parts that fall from an edge. They hit the lower belt with two
# corners at almost the same time, because they turn about the edge. In the worst case found (a box
# that falls onto a side, n = 3000), a share of 0.021 with 2560 steps was 0.021 with 1280, 0.037
# with 640, 0.056 with 320 and 0.085 with 160 steps; the differences to 2560 steps have standard
# errors of 0.002 to 0.005. Other shares still change by up to 0.007 from 1280 to 2560 steps.
EDGE_STEPS_PER_T = 2560
# Checks per T of parts that move over an edge; a multiple of it is the number of steps per T.
EDGE_CHECKS_PER_T = 8
# Maximum distance, R, that a point of the part moves in one step at impact speed, for any height
# and for up to 3 standard deviations of speed and spin at release.
TRAVEL_PER_STEP = 0.05
# Maximum number of time steps while the surface moves.
MAX_MOTION_STEPS = 500_000
# Maximum time, T, in which an upper belt carries a part over its edge by the length R.
MAX_BELT_TIME = 100.0
# A part whose centre of mass is further than this, R, from the wall below an edge cannot touch it
# when it rolls to its minimum: it turns about a point that is less than R away, and reaches R.
WALL_DISTANCE = 2.0


@dataclass(frozen=True, eq=False)
class DropJob:
    """The data with which a worker simulates drops of a part; the same for every drop of a run.

    hull : (k, 3) float
        Hull vertices relative to the centre of mass, in principal axes and in units of R.
    moments : (3,) float
        Principal moments of inertia in units of mass x R^2.
    axes : (4,) float
        Unit quaternion xyzw, part from body. The axes of the body frame are the principal axes.
    centre_of_mass : (3,) float
        In the part frame, m.
    radius : float
        R, the hull radius, m.
    rest : RestRule
        Rule that decides the aspect from the energy, in the part frame.
    min_height : float
        Minimum height of the centre of mass at rest, R.
    rolling_length : float
        Length that scales the rolling friction, R; see `plan.rolling_length`.
    until_still : bool
        Continue until the part is still, even after the energy has decided the aspect. Used to
        verify the decision and to measure the time that it saves.
    refinement : int
        Factor by which the number of time steps is multiplied.
    starts : Starts or None
        Where and how the parts start; None if they are released as the conditions say.
    scene : Scene or None
        Surroundings; None: an infinite level plane.
    pieces : tuple of (k, 3) float
        Corners of convex pieces of the part, body axes, R, if edges or meshes touch it.
    engine : str
        KERNEL, CUDA or BULLET.

    Raises
    ------
    InvalidValueError
        If the surface moves for more than MAX_MOTION_STEPS time steps, without refinement, if an
        upper belt is too slow, or if its restitution is more than 1.
    """

    hull: Array
    moments: Array
    axes: Array
    centre_of_mass: Array
    radius: float
    conditions: DropConditions
    seed: int
    rest: RestRule
    min_height: float
    rolling_length: float
    until_still: bool = False
    refinement: int = 1
    starts: Starts | None = None
    scene: Scene | None = None
    pieces: tuple[Array, ...] = ()
    engine: str = KERNEL

    def __post_init__(self) -> None:
        if self.edge is not None:
            self._check_edge(self.edge)
        if self.motion is None:
            return
        step = min(self.time_step * self.refinement, self.motion.time_step)
        longest = MAX_MOTION_STEPS * step
        if self.motion.duration > longest:
            raise InvalidValueError(
                f'invalid duration {self.motion.duration:.4g} s: expected at most {longest:.4g} s '
                f'for this part, which is {MAX_MOTION_STEPS} time steps'
            )

    def _check_edge(self, edge: Edge) -> None:
        slowest = self.radius / (MAX_BELT_TIME * self.time_unit)
        if edge.belt_speed < slowest:
            raise InvalidValueError(
                f'invalid belt speed {edge.belt_speed:.4g} m/s: expected at least {slowest:.4g} '
                'm/s for this part'
            )
        restitution = self.conditions.restitution * edge.restitution_factor
        if restitution > 1:
            raise InvalidValueError(
                f'invalid restitution {restitution:.4g} of the upper belt, which follows from the '
                'restitution and the restitution factor: expected at most 1'
            )

    @property
    def chunk(self) -> int:
        """Number of drops that a worker makes at once."""
        return CHUNKS[self.engine]

    def clear_of_wall(self, x: Array, now: float) -> npt.NDArray[np.bool_]:
        """Return whether parts (n,) at x, R, cannot touch the wall below an edge when they roll.

        ``now`` is the time after they passed the edge, T. Without an edge there is no wall.
        """
        if self.edge is None:
            return np.ones(len(x), dtype=np.bool_)
        return np.asarray(x - self.wall_speed * now > WALL_DISTANCE)

    @property
    def wall_speed(self) -> float:
        """Speed of the wall below an edge in the frame of the lower belt, R / T; 0 without one."""
        return -self.lower_speed

    @property
    def lower_speed(self) -> float:
        """Speed of the belt below an edge, R / T; 0 without one."""
        return 0.0 if self.edge is None else self.edge.lower_speed * self.time_unit / self.radius

    @property
    def motion(self) -> Motion | None:
        """Motion of the surface after the start; None if it stays at rest."""
        return None if self.starts is None else self.starts.motion

    @property
    def edge(self) -> Edge | None:
        """Edge that the parts pass before they are on the surface; None without one."""
        return None if self.starts is None else self.starts.edge

    def in_motion(self, now: float) -> bool:
        """Return whether the surface still moves at ``now`` T after the start."""
        return self.motion is not None and now * self.time_unit < self.motion.duration

    def surface_states(self, made: int, steps: int) -> Iterator[tuple[list[float], ...]]:
        """Yield position, orientation, velocity and spin of the moving surface, in R and T.

        For the beginning of each of the steps after the first ``made`` steps, and for the end of
        the last. The velocity is that in the middle of a step, which leads from one position to
        the next.
        """
        assert self.motion is not None
        step = self.time_unit / self.steps_per_t
        times = np.arange(made, made + steps + 1, dtype=np.float64) * step
        position, orientation = self.motion.pose(times)
        velocity, spin = self.motion.velocity(times + step / 2)
        unit, radius = self.time_unit, self.radius
        scaled = (position / radius, orientation, velocity * (unit / radius), spin * unit)
        return zip(*(values.tolist() for values in scaled), strict=True)

    @property
    def time_unit(self) -> float:
        """T = sqrt(R / g), s."""
        return math.sqrt(self.radius / self.conditions.gravity)

    @property
    def down(self) -> Array:
        """(3,) direction of gravity, in the frame of the engine: that of the scene, if any."""
        return np.array([0.0, 0.0, -1.0]) if self.scene is None else self.scene.down

    @property
    def frame_velocity(self) -> Array:
        """(3,) velocity of the frame in which surroundings are simulated, R / T, scene frame."""
        if self.scene is None or self.motion is not None:
            return np.zeros(3)
        return self.scene.frame_velocity * (self.time_unit / self.radius)

    @property
    def impact_speed(self) -> float:
        """Speed at which the fastest point of the part hits the surface, m/s.

        Assumes 3 standard deviations of the speed and the spin at release. The horizontal speed
        is included, because friction converts it to spin.
        """
        if self.starts is not None:
            return self.starts.max_speed
        c = self.conditions
        fall = 2 * c.gravity * c.height
        thrown = math.hypot(3 * c.speed_horizontal, 3 * c.speed_vertical)
        belt = 0.0
        if self.scene is not None:
            belt = max(abs(body.contact.speed) for body in self.scene.bodies)
        return math.sqrt(fall + thrown**2) + 3 * c.spin * self.radius + belt

    @property
    def steps_per_t(self) -> int:
        """Number of Bullet's time steps per T; below an edge, that of the first impacts."""
        if self.motion is not None:
            resolved = math.ceil(self.time_unit / self.motion.time_step)
            return self.steps(max(MOTION_STEPS_PER_T, resolved))
        return self.steps(STEPS_PER_T if self.edge is None else EDGE_STEPS_PER_T)

    def steps(self, least: int) -> int:
        """Return the number of time steps per T, at least ``least`` and as the speed requires."""
        speed = self.impact_speed * self.time_unit / self.radius
        steps = max(least, math.ceil(speed / TRAVEL_PER_STEP))
        if self.edge is not None:
            steps = -(-steps // EDGE_CHECKS_PER_T) * EDGE_CHECKS_PER_T
        return steps * self.refinement

    @property
    def time_step(self) -> float:
        """Time step of the engine, s; the kernel makes such steps only in lasting contact."""
        if self.engine != BULLET:
            return self.time_unit / (CONTACT_STEPS * self.refinement)
        return self.time_unit / self.steps_per_t
