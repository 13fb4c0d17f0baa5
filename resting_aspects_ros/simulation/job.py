"""A run of drops: its description, its planning, and the job of the workers."""

import dataclasses
import math
import re
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from resting_aspects_ros import __version__
from resting_aspects_ros.arrays import Array
from resting_aspects_ros.aspects.find import JoinedMinima, join_minima
from resting_aspects_ros.aspects.landscape import Landscape, RestRule
from resting_aspects_ros.errors import EngineError, InvalidValueError, did_you_mean, shown
from resting_aspects_ros.part.hull import SAME_FACET
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.part.pieces import convex_pieces
from resting_aspects_ros.simulation.conditions import (
    BULLET,
    CUDA,
    KERNEL,
    MAX_SEED,
    NO_BULLET,
    DropConditions,
    HeightOf,
    check_drops,
    check_integer,
    check_seed,
)
from resting_aspects_ros.simulation.scene import Scene, make_scene
from resting_aspects_ros.simulation.starts import Starts
from resting_aspects_ros.statistics.intervals import check_precision

if TYPE_CHECKING:
    from resting_aspects_ros.simulation.actions import Step, Vibration

# -- Description ----------------------------------------------------------------------------------


_MAX_RUN_ID_LENGTH = 64
# The run id is a part of the name of the run's log.
_RUN_ID = re.compile(rf'[A-Za-z0-9][A-Za-z0-9_.-]{{0,{_MAX_RUN_ID_LENGTH - 1}}}')
# The version of the law and its numerical parameters: poses of another version can differ.
KERNEL_VERSION = '1'


@dataclass(frozen=True)
class RunDescription:
    """Drops of one part under one set of conditions and one seed; has the message's fields.

    ``time_step`` is in s, ``started`` in ns since the epoch.
    """

    run_id: str
    part: str
    part_sha256: str
    conditions: DropConditions
    seed: int
    first_drop: int
    drops: int
    precision: float
    engine: str
    engine_version: str
    suite_version: str
    time_step: float
    started: int

    @property
    def end(self) -> int:
        """Index after the last requested drop."""
        return self.first_drop + self.drops

    def document(self) -> dict[str, object]:
        """Return the description as plain JSON types."""
        values = {each.name: getattr(self, each.name) for each in dataclasses.fields(self)}
        return {**values, 'conditions': self.conditions.document()}

    def sequence(self) -> tuple[object, ...]:
        """Return the inputs that, together with a drop's index, determine its resting pose."""
        return (
            self.part_sha256,
            self.conditions.key(),
            self.seed,
            self.engine,
            self.engine_version,
            self.suite_version,
            self.time_step,
        )


def check_run_id(run_id: str) -> None:
    """Raise InvalidValueError if the run id is invalid; an empty one requests a new id."""
    if run_id and not _RUN_ID.fullmatch(run_id):
        raise InvalidValueError(
            f'invalid run_id {shown(run_id)}: expected up to {_MAX_RUN_ID_LENGTH} letters, '
            'digits, "_", "-" and ".", a letter or digit first'
        )


def check_first_drop(first_drop: int, drops: int) -> None:
    """Raise InvalidValueError if the first drop is out of bounds for this number of drops."""
    check_integer('first_drop', first_drop, 0, MAX_SEED - drops)


# -- Job ------------------------------------------------------------------------------------------


# Time steps per T of lasting contact in the kernel.
CONTACT_STEPS = 40
# Number of drops that a worker makes at once. It affects no pose.
CHUNKS = {KERNEL: 500, CUDA: 200_000, BULLET: 125}
# Bullet's minimum number of time steps per T. Finer steps change no probability of an L bracket by
# more than the sampling error.
STEPS_PER_T = 160
# The same while the surface moves: a plate that hardly tilts hits a part that lies flat with one
# corner after the other. In the worst case found, a share of 0.20 with 640 steps was 0.22 with
# these and 0.25 with 160.
MOTION_STEPS_PER_T = 320
# The same for the first impacts of parts that fall from an edge: they hit the lower belt with two
# corners at almost the same time. See docs/explanation/reorientation.md.
EDGE_STEPS_PER_T = 2560
# Checks per T of parts that move over an edge; a multiple of it is the number of steps per T.
EDGE_CHECKS_PER_T = 8
# Maximum distance, R, that a point of the part moves in one step at impact speed, for any height
# and for up to 3 standard deviations of speed and spin at release.
TRAVEL_PER_STEP = 0.05
# A part in surroundings that is faster than this, R / T, and than this multiple of the speed of
# its first impact slides for ever: it has come down by at least 50 R.
MAX_SPEED, MAX_SPEEDUP = 10.0, 3.0
# Maximum number of time steps while the surface moves.
MAX_MOTION_STEPS = 500_000
# Maximum time, T, in which an upper belt carries a part over its edge by the length R.
MAX_BELT_TIME = 100.0


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
    scene : Scene
        What the parts can touch; below an edge, with the lower floor.
    pieces : tuple of (k, 3) float
        Corners of convex pieces of the part, body axes, R, if edges or meshes touch it.
    engine : str
        KERNEL, CUDA or BULLET.

    Raises InvalidValueError if the surface moves for more than MAX_MOTION_STEPS time steps,
    without refinement, or if an upper belt is too slow.
    """

    hull: Array
    moments: Array
    axes: Array
    centre_of_mass: Array
    radius: float
    conditions: DropConditions
    seed: int
    scene: Scene
    rest: RestRule
    min_height: float
    rolling_length: float
    until_still: bool = False
    refinement: int = 1
    starts: Starts | None = None
    pieces: tuple[Array, ...] = ()
    engine: str = KERNEL

    def __post_init__(self) -> None:
        edge, motion = self.edge, self.motion
        slowest = self.radius / (MAX_BELT_TIME * self.time_unit)
        if edge is not None and edge.belt_speed < slowest:
            raise InvalidValueError(
                f'invalid belt speed {edge.belt_speed:.4g} m/s: expected at least {slowest:.4g} '
                'm/s for this part'
            )
        if motion is not None:
            step = min(self.time_step * self.refinement, motion.time_step)
            longest = MAX_MOTION_STEPS * step
            if motion.duration > longest:
                raise InvalidValueError(
                    f'invalid duration {motion.duration:.4g} s: expected at most {longest:.4g} s '
                    f'for this part, which is {MAX_MOTION_STEPS} time steps'
                )

    @property
    def lower_speed(self) -> float:
        """Speed of the belt below an edge, R / T; 0 without one."""
        return 0.0 if self.edge is None else self.edge.lower_speed * self.time_unit / self.radius

    @property
    def motion(self) -> 'Vibration | None':
        """Motion of the surface after the start; None if it stays at rest."""
        return None if self.starts is None else self.starts.motion

    @property
    def edge(self) -> 'Step | None':
        """Edge that the parts pass before they are on the surface; None without one."""
        return None if self.starts is None else self.starts.edge

    def in_motion(self, now: float) -> bool:
        """Return whether the surface still moves at ``now`` T after the start."""
        return self.motion is not None and now * self.time_unit < self.motion.duration

    @property
    def time_unit(self) -> float:
        """T = sqrt(R / g), s."""
        return math.sqrt(self.radius / self.conditions.gravity)

    @property
    def frame_velocity(self) -> Array:
        """(3,) velocity of the frame in which Bullet simulates surroundings, R / T, scene frame.

        That of the first body, if the scene is the same everywhere in that direction: friction on
        bodies at rest is more accurate, and takes less time.
        """
        velocity = self.scene.bodies[0].velocity
        if self.motion is not None or not self.scene.same_along(velocity):
            return np.zeros(3)
        return velocity * (self.time_unit / self.radius)

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
        belt = max(abs(body.contact.speed) for body in self.scene.bodies)
        return math.sqrt(fall + thrown**2) + 3 * c.spin * self.radius + belt

    @property
    def max_speed(self) -> float:
        """Speed above which a part in surroundings slides or rolls for ever, R / T."""
        return max(MAX_SPEED, MAX_SPEEDUP * self.impact_speed * (self.time_unit / self.radius))

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


# -- Planning -------------------------------------------------------------------------------------


# A flat side is narrow if an edge is closer than this, R, to the point below the centre of mass.
NARROW = 0.15
# Faster impacts, R / T, are rejected: their many small steps would occupy a worker for hours.
MAX_IMPACT = 100.0
# Faster belts in surroundings, R / T, are rejected: the time steps that resolve their contact with
# a part would be as many as for such an impact, but until the part is at rest.
MAX_BELT = 20.0


def plan_run(
    part: Part,
    conditions: DropConditions,
    *,
    seed: int,
    drops: int,
    run_id: str,
    started: int,
    first_drop: int = 0,
    precision: float = 0.0,
    landscape: Landscape | None = None,
    starts: Starts | None = None,
    engine: str = '',
) -> tuple[DropJob, RunDescription]:
    """Return the job and the description of a run; raises InvalidValueError.

    Parameters
    ----------
    precision : float
        Half width of the intervals at which the run stops; 0 if it simulates all its drops.
    landscape : Landscape or None
        Landscape of the part, if it was already computed.
    starts : Starts or None
        Where and how the parts start; None: they are released as the conditions say.
    engine : str
        'kernel', 'cuda' (the kernel on a GPU), 'bullet', or '': the kernel for everything that it
        can simulate.
    """
    check_drops(drops)
    if precision != 0:
        check_precision(precision)
        if first_drop != 0:
            raise InvalidValueError(
                f'invalid first_drop {first_drop}: expected 0 for a run that stops at a precision'
            )
    check_seed(seed)
    check_first_drop(first_drop, drops)
    job = make_job(part, conditions, seed, landscape=landscape, starts=starts, engine=engine)
    return job, RunDescription(
        run_id=run_id,
        part=part.name,
        part_sha256=part.part_sha256,
        conditions=conditions,
        seed=seed,
        first_drop=first_drop,
        drops=drops,
        precision=precision,
        engine=job.engine,
        engine_version=engine_version(job.engine),
        suite_version=__version__,
        time_step=job.time_step,
        started=started,
    )


def make_job(
    part: Part,
    conditions: DropConditions,
    seed: int,
    *,
    until_still: bool = False,
    refinement: int = 1,
    landscape: Landscape | None = None,
    starts: Starts | None = None,
    engine: str = '',
) -> DropJob:
    """Return the job for a part; InvalidValueError if the conditions do not fit the part.

    See DropJob for ``until_still`` and ``refinement``, and plan_run for the others.
    """
    radius = part.hull_radius
    released = starts is None
    if (
        released
        and conditions.height_of is HeightOf.CENTRE_OF_MASS
        and conditions.height <= radius
    ):
        raise InvalidValueError(
            f'invalid height of the centre of mass {conditions.height:g} m: expected more than '
            f'{radius:.4g} m for {part.name}, which could otherwise touch the surface at release'
        )
    landscape = Landscape(part) if landscape is None else landscape
    aspects = join_minima(landscape)
    scene = make_scene(conditions, radius)
    if starts is not None and starts.edge is not None:
        scene = scene.with_floor_speed(starts.edge.lower_speed)
    job = DropJob(
        hull=(part.hull_vertices - part.centre_of_mass) @ part.principal_axes / radius,
        moments=part.principal_moments / (part.mass * radius**2),
        axes=Rotation.from_matrix(part.principal_axes).as_quat(),
        centre_of_mass=part.centre_of_mass,
        radius=radius,
        conditions=conditions,
        seed=seed,
        rest=RestRule(landscape, aspects),
        min_height=float(landscape.heights.min()) / radius,
        rolling_length=rolling_length(landscape, aspects),
        until_still=until_still,
        refinement=refinement,
        starts=starts,
        scene=scene,
        pieces=() if scene.flat else pieces_of(part),
        engine=_engine(engine, scene, starts),
    )
    fastest = MAX_IMPACT * job.radius / job.time_unit
    if job.impact_speed > fastest:
        source = 'height, speed and spin at release' if released else 'the state at the start'
        raise InvalidValueError(
            f'invalid impact speed {job.impact_speed:.4g} m/s of {part.name}, which follows from '
            f'{source}: expected at most '
            f'{fastest:.4g} m/s for its size and gravity'
        )
    fastest = MAX_BELT * job.radius / job.time_unit
    for body in scene.bodies:
        if abs(body.contact.speed) > fastest and not scene.level:
            raise InvalidValueError(
                f'invalid speed {body.contact.speed:g} m/s of the {body.name}: expected at most '
                f'{fastest:.3g} m/s for the size of this part and gravity'
            )
    return job


def pieces_of(part: Part) -> tuple[Array, ...]:
    """Return the corners (k, 3) of convex pieces of a part, body axes, R."""
    axes, radius = part.principal_axes, part.hull_radius
    pieces = convex_pieces(part).corners
    return tuple((c - part.centre_of_mass) @ axes / radius for c in pieces)


def engine_version(engine: str) -> str:
    """Return the version of an engine; it is not imported, because only the workers need it.

    Raises EngineError if Bullet is not installed.
    """
    if engine != BULLET:
        return KERNEL_VERSION
    try:
        return version('pybullet')
    except PackageNotFoundError:
        raise EngineError(NO_BULLET) from None


def _engine(wanted: str, scene: Scene, starts: Starts | None) -> str:
    """Return the engine of a job; raises InvalidValueError if it cannot simulate it."""
    if wanted not in {'', KERNEL, CUDA, BULLET}:
        raise InvalidValueError(
            f'invalid engine {shown(wanted)}: expected {KERNEL}, {CUDA} or {BULLET}'
            f'{did_you_mean(wanted, [KERNEL, CUDA, BULLET])}'
        )
    edges = starts is not None and starts.edge is not None
    if edges or not scene.flat:
        if wanted in {KERNEL, CUDA}:
            raise InvalidValueError(
                f'invalid engine {wanted}: expected {BULLET} where parts fall from an edge, or '
                'touch blocks or a mesh'
            )
        return BULLET
    return wanted or KERNEL


def rolling_length(landscape: Landscape, aspects: list[JoinedMinima]) -> float:
    """Return the length that scales the rolling friction, R: 1 except for slender parts.

    Rolling friction stops rolling parts. For a slender part, a fraction of R is a lever arm that
    could hold the part tilted on an edge. Its length is therefore proportional to its narrowest
    flat side, but not less than the minimum height of the centre of mass, which is the radius on
    which a slender roller rolls.
    """
    hull = landscape.hull
    flat = landscape.minima[[a.minima[0] for a in aspects if not a.curved]]
    at_edges = np.isin(hull.sides, flat) & (hull.angles > SAME_FACET)[:, None]
    narrowest = hull.margins[at_edges].min() if at_edges.any() else 0.0
    lowest = landscape.heights.min() / landscape.radius
    return float(min(1.0, max(narrowest / NARROW, lowest)))
