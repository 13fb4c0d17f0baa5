"""Drop a part, for the Python interface and the command line."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from resting_aspects_ros.api.chunk_loop import given_workers
from resting_aspects_ros.api.condition_text import given_conditions
from resting_aspects_ros.api.drop_counter import (
    Consumer,
    Convergence,
    DropCounter,
    check_in_finer_steps,
)
from resting_aspects_ros.api.drop_result import DropResult
from resting_aspects_ros.api.given_states import CountsByState, given_starts
from resting_aspects_ros.api.load_part import given_part, mesh_file
from resting_aspects_ros.api.plan_drops import plan_drops
from resting_aspects_ros.api.progress import DropProgress
from resting_aspects_ros.api.surroundings import warn_of_surroundings, with_surroundings
from resting_aspects_ros.errors import InvalidValueError, LogError
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.simulation.conditions import DEFAULT_SURFACE, DropConditions
from resting_aspects_ros.simulation.job import (
    DEFAULT_DROPS,
    DEFAULT_SEED,
)
from resting_aspects_ros.simulation.starts import GivenStates, Noise, Starts
from resting_aspects_ros.simulation.surroundings import Surroundings
from resting_aspects_ros.simulation.workers import Workers
from resting_aspects_ros.statistics.distribution import METHOD, ContactCounts
from resting_aspects_ros.statistics.intervals import (
    CONFIDENCE,
    INTERVAL,
)
from resting_aspects_ros.statistics.poses import RestingPoses

NO_NOISE = Noise()


def drop(
    part: Part | str | Path,
    drops: int | None = None,
    *,
    surface: str | DropConditions = DEFAULT_SURFACE,
    precision: float = 0.0,
    seed: int = DEFAULT_SEED,
    interval: str = INTERVAL,
    confidence: float = CONFIDENCE,
    initial_states: GivenStates | None = None,
    replicates: int = 1,
    noise: Noise = NO_NOISE,
    surroundings: str | Path | Surroundings | None = None,
    check_convergence: bool = False,
    engine: str = '',
    workers: int | Workers | None = None,
    keep_poses: bool = True,
    log: str | Path | None = None,
    progress: bool = False,
    **conditions: Any,
) -> DropResult:
    """Drop a part many times, and count in which aspects it comes to rest.

    The same part, conditions and seed give the same poses, bit for bit, for any number of
    workers. Ctrl-C raises KeyboardInterrupt after the workers have ended. A script needs no
    ``if __name__ == '__main__'``: a worker does not import it.

    Parameters
    ----------
    part : Part, str or Path
        A part, or what `load_part` accepts.
    drops : int, optional
        Number of drops, 1000 by default. With ``precision`` the maximum.
    surface : str or DropConditions
        Named conditions, or conditions.
    precision : float
        Maximum half width of the intervals at which the run stops; 0: make all drops.
    seed : int
        Seed of the random orientations and velocities at the release; not negative.
    interval : str
        'wilson': each interval holds by itself; 'simultaneous': all hold together.
    confidence : float
        Confidence of the intervals: more than 0.5 and less than 1.
    initial_states : GivenStates, optional
        States from which the parts start, instead of random releases; see
        `DropResult.by_state`. Height, speeds and spin of the conditions then have no effect.
    replicates : int
        Number of drops from each initial state.
    noise : Noise
        Errors of the initial states, independent for each replicate.
    surroundings : str, Path or Surroundings, optional
        Slopes, walls, chutes or a mesh instead of a level plane: a name, a YAML file, or the
        result of `surroundings`. See `DropResult.contacts`.
    check_convergence : bool
        Repeat the drops with half the time step; see `DropResult.convergence`.
    engine : str
        'kernel', 'cuda' (the kernel on a GPU), or 'bullet' as an independent check; '': the
        kernel, but Bullet where parts fall from an edge or touch blocks or a mesh.
    workers : int or Workers, optional
        Number of worker threads, or of processes of Bullet, one for each core by default; or
        workers to use, such as those of a Dask cluster, which are left running.
    keep_poses : bool
        Keep the resting poses, 74 bytes each; without them memory does not grow with ``drops``.
    log : str or Path, optional
        Folder of logs, in which a log of the run is written as drop_recorder writes it; see
        `DropResult.log`. Imports ROS.
    progress : bool
        Show progress on standard error.
    **conditions : float
        Conditions that differ from the surface, in SI units, such as ``height=0.1``.

    Returns
    -------
    DropResult

    Raises
    ------
    InvalidValueError
        A value is out of bounds, or a name is not known.
    EngineError
        Worker processes of Bullet cannot be started, or died repeatedly.
    LogError
        The log cannot be written.

    Examples
    --------
    >>> import resting_aspects_ros as ra
    >>> result = ra.drop('tetrahedron', drops=100, seed=1, height=0.05)
    >>> result.distribution.drops
    100
    >>> result.poses.position.shape
    (100, 3)
    """
    given = with_surroundings(given_conditions(surface, conditions), surroundings)
    mesh = mesh_file(part) if isinstance(part, str | Path) else None
    loaded = given_part(part)
    starts: Starts | None = None
    if initial_states is None and (replicates != 1 or noise != NO_NOISE):
        raise InvalidValueError('invalid replicates or noise: expected only with initial_states')
    if initial_states is not None:
        if drops is not None or precision or log is not None:
            raise InvalidValueError(
                'invalid initial_states: expected without drops, precision and log; replicates '
                'is the number of drops from each state'
            )
        starts, drops = given_starts(loaded, initial_states, noise, given, replicates)
    count = (0 if precision else DEFAULT_DROPS) if drops is None else drops
    planned = plan_drops(
        loaded,
        given,
        drops=count,
        seed=seed,
        precision=precision,
        interval=interval,
        confidence=confidence,
        starts=starts,
        engine=engine,
    )
    warn_of_surroundings(given, loaded.hull_radius)
    chunks: list[RestingPoses] = []
    consumers: list[Consumer] = [*planned.consumers]
    if keep_poses:
        consumers.append(lambda poses, _: chunks.append(poses))
    by_state: CountsByState | None = None
    if initial_states is not None:
        by_state = CountsByState.none(len(initial_states), len(planned.empty.aspects))
        consumers.append(by_state.add)
    counter = DropCounter(planned.empty, planned.run, precision, consumers=consumers)
    convergence: Convergence | None = None
    with given_workers(workers) as pool:
        with (
            recorded(log, loaded, counter, planned.contacts) as log_folder,
            DropProgress(loaded.name, planned.run.drops, shown=progress) as bar,
        ):
            counter.drop(planned.job, pool, bar.update)
            bar.end(counter.distribution.drops)
        if check_convergence:
            label = f'{loaded.name} with a finer time step'
            with DropProgress(label, counter.distribution.drops, shown=progress) as bar:
                _, convergence = check_in_finer_steps(counter, planned.job, pool, bar.update)
    return DropResult(
        counter.distribution,
        planned.run,
        loaded,
        METHOD,
        counter.complete,
        convergence,
        mesh,
        counter.history.points(),
        RestingPoses.join(chunks) if keep_poses else None,
        log_folder,
        by_state,
        planned.contacts,
    )


@contextmanager
def recorded(
    folder: str | Path | None,
    part: Part,
    counter: DropCounter,
    contacts: ContactCounts | None = None,
) -> Iterator[Path | None]:
    """Write a log of the drops that are counted inside the `with`, and yield its folder.

    Writes no log if ``folder`` is None. Closes the log even if the drops end early. Raises
    LogError if it cannot be written.
    """
    if folder is None:
        yield None
        return
    from resting_aspects_ros.run_logs.recorder import LocalRunLog

    log = LocalRunLog(Path(folder), part, counter.run)
    counter.consumers.append(log.add)
    try:
        yield log.folder
    except BaseException:
        with suppress(LogError):  # the first error is more informative
            log.close(counter.distribution, contacts)
        raise
    log.close(counter.distribution, contacts)


def read_log(log: str | Path) -> DropResult:
    """Read a log of a run, and count its drops.

    Imports ROS, which the rest of the Python interface does not need.

    Parameters
    ----------
    log : str or Path
        The folder of a run, or its .mcap file.

    Returns
    -------
    DropResult
        The result; ``poses`` is None if the log does not have all drops.

    Raises
    ------
    LogError
        The log cannot be read.
    InvalidValueError
        The file is not a log of a run with its part.
    """
    from resting_aspects_ros.run_logs.contents import logged_result

    return logged_result(Path(log), keep_poses=True)
