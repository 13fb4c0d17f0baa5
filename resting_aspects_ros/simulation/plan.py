"""Planning of a run: from a request to the job of the workers and the run description."""

from importlib.metadata import version

import numpy as np
from scipy.spatial.transform import Rotation

from resting_aspects_ros import __version__
from resting_aspects_ros.core.aspects.joining import JoinedMinima, join_minima
from resting_aspects_ros.core.aspects.landscape import Landscape
from resting_aspects_ros.core.aspects.rest_rule import RestRule
from resting_aspects_ros.core.errors import InvalidValueError, did_you_mean, shown
from resting_aspects_ros.core.geometry.decomposition import convex_pieces
from resting_aspects_ros.core.geometry.polyhedron import SAME_FACET
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.rotations import Array
from resting_aspects_ros.core.statistics.stopping import check_precision
from resting_aspects_ros.simulation.conditions import DropConditions, HeightOf
from resting_aspects_ros.simulation.drop_job import DropJob
from resting_aspects_ros.simulation.run_description import (
    BULLET,
    CUDA,
    KERNEL,
    KERNEL_VERSION,
    RunDescription,
    check_drops,
    check_first_drop,
    check_seed,
)
from resting_aspects_ros.simulation.starts import Starts
from resting_aspects_ros.simulation.surroundings.floor_step import below_edge
from resting_aspects_ros.simulation.surroundings.scene import Scene

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
    scene = None
    pieces: tuple[Array, ...] = ()
    if conditions.surroundings is not None:
        scene = conditions.surroundings.scene(conditions, radius)
        if starts is not None and starts.edge is not None:
            scene = below_edge(scene, starts.edge)
        if not scene.flat:
            pieces = tuple(
                (corners - part.centre_of_mass) @ part.principal_axes / radius
                for corners in convex_pieces(part).corners
            )
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
        pieces=pieces,
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
    if scene is not None:
        _check_belts(job, scene)
    return job


def engine_version(engine: str) -> str:
    """Return the version of an engine; it is not imported, because only the workers need it."""
    return version('pybullet') if engine == BULLET else KERNEL_VERSION


def _engine(wanted: str, scene: Scene | None, starts: Starts | None) -> str:
    """Return the engine of a job; raises InvalidValueError if it cannot simulate it."""
    if wanted not in {'', KERNEL, CUDA, BULLET}:
        raise InvalidValueError(
            f'invalid engine {shown(wanted)}: expected {KERNEL}, {CUDA} or {BULLET}'
            f'{did_you_mean(wanted, [KERNEL, CUDA, BULLET])}'
        )
    edges = starts is not None and starts.edge is not None
    if edges or not (scene is None or scene.flat):
        if wanted in {KERNEL, CUDA}:
            raise InvalidValueError(
                f'invalid engine {wanted}: expected {BULLET} where parts fall from an edge, or '
                'touch blocks or a mesh'
            )
        return BULLET
    return wanted or KERNEL


def _check_belts(job: DropJob, scene: Scene) -> None:
    """Raise InvalidValueError if a surface moves faster than the time step resolves."""
    fastest = MAX_BELT * job.radius / job.time_unit
    for body in scene.bodies:
        if abs(body.contact.speed) > fastest:
            raise InvalidValueError(
                f'invalid speed {body.contact.speed:g} m/s of the {body.name}: expected at most '
                f'{fastest:.3g} m/s for the size of this part and gravity'
            )


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
