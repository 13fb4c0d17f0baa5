"""Drop a part, or repeat the drops of a log; the result with its document and its page."""

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from resting_aspects_ros.api.conditions import (
    conditions_text,
    given_conditions,
    shipped_surfaces,
    simulated_pieces,
    with_surroundings,
)
from resting_aspects_ros.api.model_range import add_model_range, missing_in, model_range_text
from resting_aspects_ros.api.plan import (
    PlannedDrops,
    check_height,
    given_starts,
    plan_drops,
)
from resting_aspects_ros.api.result import Result
from resting_aspects_ros.api.runner import (
    Consumer,
    Convergence,
    Progress,
    Runner,
    StartTally,
    keep_result,
    make_runner,
    never,
    repeat_drops_in_finer_steps,
)
from resting_aspects_ros.arrays import Counts
from resting_aspects_ros.errors import InvalidValueError, LogError, warn
from resting_aspects_ros.part.library import given_part, mesh_file
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.simulation.conditions import (
    DEFAULT_DROPS,
    DEFAULT_SEED,
    DEFAULT_SURFACE,
    DropConditions,
    Noise,
    check_drops,
)
from resting_aspects_ros.simulation.job import RunDescription
from resting_aspects_ros.simulation.starts import GivenStates, Starts
from resting_aspects_ros.simulation.surroundings import Surroundings
from resting_aspects_ros.simulation.workers import Workers
from resting_aspects_ros.statistics.distribution import METHOD, Distribution, Placements
from resting_aspects_ros.statistics.intervals import CONFIDENCE, INTERVAL
from resting_aspects_ros.statistics.poses import RestingPoses
from resting_aspects_ros.statistics.transitions import OUTCOMES

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from resting_aspects_ros.api.counts import CountedDrops
    from resting_aspects_ros.report.page import Page


# -- Result ---------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class DropResult(Result):
    """The distribution of a run, with the run, its part and its poses.

    part
        None if only its name and hash are known.
    complete
        Whether all drops that were requested are counted.
    convergence
        How far the distribution moves with a finer time step, if that was checked.
    mesh_file
        The file from which the part was read, if it was given as a file.
    history : ((m,) int, (m, k) int)
        Numbers of drops, ascending, and the counts of the k aspects after each number.
    poses, log
        The resting poses, if they were kept, and the folder of the log, if one was written.
    by_state
        Counts by initial state, if the initial states were given.
    contacts
        Counts by what the parts touch, if the surroundings have walls.
    no_model_range
        Why the distribution has no model range, if one was requested.
    """

    distribution: Distribution
    run: RunDescription
    part: Part | None
    complete: bool
    convergence: Convergence | None = None
    mesh_file: Path | None = None
    history: tuple[Counts, Counts] | None = None
    poses: RestingPoses | None = None
    log: Path | None = None
    by_state: StartTally | None = None
    contacts: Placements | None = None
    no_model_range: str = ''

    @property
    def title(self) -> str:
        """Part, drops, surface and seed in one line."""
        return f'{self.run.part}, {self.subtitle}'

    @property
    def subtitle(self) -> str:
        """Number of drops (and how many were requested, if more), surface and seed."""
        surface = conditions_text(self.run.conditions)
        of = '' if self.complete else f' of {self.run.drops}'
        return f'{self.distribution.drops}{of} drops on {surface}, seed {self.run.seed}'

    @property
    def range_text(self) -> str:
        """What the model range covers, or why there is none; can be empty."""
        return model_range_text(self.distribution.model, self.no_model_range)

    def document(self) -> dict[str, object]:
        """Return the document that `resting_aspects drop --json` prints."""
        # A drop alone does not need the report.
        from resting_aspects_ros.report.document import distribution_document
        from resting_aspects_ros.report.drops import contact_rows

        fields: dict[str, object] = {
            **self.run.document(),
            'mesh_sha256': self.part.mesh_sha256 if self.part else None,
            'mesh_file': str(self.mesh_file.absolute()) if self.mesh_file else None,
            'unit': self.part.unit if self.part else None,
            'body': self.part.body or None if self.part else None,
            'method': METHOD,
            'complete': self.complete,
            'drops_asked': self.run.drops,
            'no_model_range': self.no_model_range or None,
            'history': self.history
            and [
                {'drops': n, 'counts': row}
                for n, row in zip(*(each.tolist() for each in self.history), strict=True)
            ],
        }
        if self.by_state is not None:
            fields['initial_states'] = {
                'columns': [*range(1, len(self.distribution.counts) + 1), *OUTCOMES],
                'counts': self.by_state.counts,
            }
        if pieces := simulated_pieces(self.part, self.run.conditions):
            fields['convex_pieces'] = pieces.summary()
        if self.contacts is not None:
            fields['contacts'] = contact_rows(self.contacts, self.distribution)
        if self.convergence is not None:
            fields['convergence'] = self.convergence
        return distribution_document(self.distribution, fields, self.part)

    def page(self, against: 'CountedDrops | None' = None) -> 'Page':
        """Return a page with pictures, charts and all numbers; beside other counts, if given."""
        # This import takes about a second.
        from resting_aspects_ros.api.pages import result_page

        return result_page(self, against)

    def figure(self) -> 'Figure':
        """Return a bar for each symmetry class, with a picture of the part in it."""
        from resting_aspects_ros.report.drop_figures import distribution_figure

        return distribution_figure(self.distribution, self.part, self.title, self.range_text)


# -- Drops ----------------------------------------------------------------------------------------


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
    model_range: bool = True,
    engine: str = '',
    workers: int | Workers | None = None,
    keep_poses: bool = True,
    log: str | Path | None = None,
    consumers: Sequence[Consumer] = (),
    progress: Progress = False,
    stopped: Callable[[], bool] = never,
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
    model_range : bool
        Also find where the probabilities on a real surface are, with 8000 drops over the
        uncertainty of the surface; see `Distribution.model`.
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
    consumers : sequence of callable
        Called with each chunk of poses, in order, and the ids of their aspects, 0 for none.
    progress : bool or callable
        Show progress on standard error; or a function, which is called often with the numbers of
        drops made and in total.
    stopped : callable
        Called often; the drops end when it returns True, and the result is not ``complete``.
    **conditions : float
        Conditions that differ from the surface, in SI units, such as ``height=0.1``.

    Raises
    ------
    InvalidValueError
        A value is out of bounds, or a name is not known.
    EngineError
        Worker processes of Bullet cannot be started, or died repeatedly. Its attribute ``result``
        is the result of the drops before, as that of a LogError.
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
    loaded = given_part(part)
    starts: Starts | None = None
    by_state: StartTally | None = None
    if initial_states is None:
        if replicates != 1 or noise != NO_NOISE:
            raise InvalidValueError(
                'invalid replicates or noise: expected only with initial_states'
            )
        check_height(loaded, given.height)
        if drops is not None:
            check_drops(drops)
        count = drops or (0 if precision else DEFAULT_DROPS)
    else:
        if drops is not None or precision or log is not None:
            raise InvalidValueError(
                'invalid initial_states: expected without drops, precision and log; replicates '
                'is the number of drops from each state'
            )
        starts, count = given_starts(loaded, initial_states, noise, given, replicates)
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
    if initial_states is not None:
        by_state = StartTally(planned.tally.aspects, len(initial_states), count)
    with make_runner(workers, progress, stopped) as runner:
        return make_drops(
            runner,
            planned,
            loaded,
            by_state=by_state,
            check=check_convergence,
            model_range=model_range,
            keep_poses=keep_poses,
            log=log,
            consumers=consumers,
            mesh=mesh_file(part) if isinstance(part, str | Path) else None,
        )


def repeat_log(
    log: str | Path | tuple[Part, RunDescription],
    *,
    interval: str = INTERVAL,
    confidence: float = CONFIDENCE,
    check_convergence: bool = False,
    model_range: bool = True,
    engine: str = '',
    workers: int | Workers | None = None,
    keep_poses: bool = True,
    consumers: Sequence[Consumer] = (),
    progress: Progress = False,
    stopped: Callable[[], bool] = never,
) -> DropResult:
    """Repeat the drops that a log has, with its part, conditions and seed; imports ROS.

    Warns if the engine, a version or the time step differs from that of the log. ``log`` is the
    folder of a run, its .mcap file, or what `logged_drops` returned; the other arguments and the
    errors are those of `drop`.
    """
    part, run = log if isinstance(log, tuple) else logged_drops(log)
    known = shipped_surfaces().recorded_uncertainty(run.conditions)
    planned = plan_drops(
        part,
        dataclasses.replace(run.conditions, uncertainty=known or ()),
        drops=run.drops,
        seed=run.seed,
        first_drop=run.first_drop,
        precision=run.precision,
        interval=interval,
        confidence=confidence,
        engine=engine,
    )
    planned.tally.precision = 0.0  # all drops are repeated
    _warn_of_another_engine(run, planned.run)
    for warning in part.warnings:
        warn(warning)
    with make_runner(workers, progress, stopped) as runner:
        result = make_drops(
            runner,
            planned,
            part,
            check=check_convergence,
            model_range=model_range and known is not None,
            keep_poses=keep_poses,
            consumers=consumers,
        )
    if model_range and not result.no_model_range:
        result = dataclasses.replace(result, no_model_range=missing_in(run))
    return result


def logged_drops(log: str | Path) -> tuple[Part, RunDescription]:
    """Return the part of a log, and the run of exactly the drops in it; InvalidValueError."""
    # This imports ROS, which is not needed without a log.
    from resting_aspects_ros.run_logs import LoggedRun

    try:
        logged = LoggedRun(Path(log))
    except LogError as error:
        raise InvalidValueError(str(error)) from None
    part, drops = logged.part, logged.seen.ranges
    if logged.run is None or not drops:
        raise InvalidValueError(f'invalid log {str(log)!r}: expected a log with drops')
    if part is None or part.part_sha256 != logged.run.part_sha256:
        raise InvalidValueError(
            f'invalid log {str(log)!r}: expected a log with the description of its part'
        )
    logged.warn_if_unfinished()
    assert logged.known_run is not None
    run, first = logged.known_run, drops[0][0]
    return part, dataclasses.replace(run, first_drop=first, drops=logged.seen.end - first)


def _warn_of_another_engine(before: RunDescription, now: RunDescription) -> None:
    if now.sequence() != before.sequence():
        first, second = (
            f'{each.engine} {each.engine_version}, resting_aspects_ros {each.suite_version}, '
            f'time step {each.time_step:.6g} s'
            for each in (before, now)
        )
        warn(
            f'the log was recorded with {first}, and this is {second}: the poses can differ, the '
            'probabilities should not'
        )


def make_drops(
    runner: Runner,
    planned: PlannedDrops,
    part: Part,
    *,
    by_state: StartTally | None = None,
    check: bool = False,
    model_range: bool = False,
    keep_poses: bool = True,
    log: str | Path | None = None,
    consumers: Sequence[Consumer] = (),
    mesh: Path | None = None,
) -> DropResult:
    """Make planned drops; see `drop`. With ``check``, repeat them with half the time step."""
    tally = planned.tally
    chunks: list[RestingPoses] = []
    nothing = RestingPoses.none(planned.run.first_drop)
    kept = [lambda poses, _: chunks.append(poses)] if keep_poses else []
    counts = [each.add for each in (planned.contacts, by_state) if each is not None]
    folder: Path | None = None
    convergence: Convergence | None = None
    reason = ''

    def result() -> DropResult:
        return DropResult(
            tally.distribution,
            planned.run,
            part,
            tally.complete,
            convergence,
            mesh,
            tally.history.points(),
            RestingPoses.join([nothing, *chunks]) if keep_poses else None,
            folder,
            by_state,
            planned.contacts,
            reason,
        )

    with keep_result(result):
        with recorded(log, part, planned) as (folder, to_log):
            everything = [*counts, *kept, *to_log, *consumers]
            runner.count(planned.job, planned.run, tally, everything)
            if model_range:
                tally.distribution, reason = add_model_range(
                    tally.distribution, part, planned.job, runner.workers, runner.stopped
                )
        if check and not runner.stopped():
            convergence = repeat_drops_in_finer_steps(
                runner, planned.job, planned.run, tally.distribution
            )
    if tally.complete:
        warn_if_not_precise(tally.distribution, tally.precision)
    return result()


def warn_if_not_precise(distribution: Distribution, precision: float) -> None:
    """Warn if the precision was not reached in the maximum number of drops."""
    if not precision:
        return
    half = max((each.upper - each.lower) / 2 for each in distribution.intervals())
    if precision < half:
        warn(
            f'precision {precision:g} was not reached in {distribution.drops} drops, the '
            f'requested maximum: the widest interval is +-{half:.2g}'
        )


@contextmanager
def recorded(
    folder: str | Path | None, part: Part, planned: PlannedDrops
) -> Iterator[tuple[Path | None, list[Consumer]]]:
    """Write a log of drops inside the `with`; yields its folder and what consumes the drops.

    Writes no log if ``folder`` is None. Closes the log even if the drops end early. Raises
    LogError if it cannot be written.
    """
    if folder is None:
        yield None, []
        return
    from resting_aspects_ros.run_logs import LocalRunLog

    log = LocalRunLog(Path(folder), part, planned.run)
    try:
        yield log.folder, [log.add]
    except BaseException:
        with suppress(LogError):  # the first error is more informative
            log.close(planned.tally.distribution, planned.contacts)
        raise
    log.close(planned.tally.distribution, planned.contacts)


def read_log(log: str | Path) -> DropResult:
    """Read a log, the folder of a run or its .mcap file, and count its drops; imports ROS.

    ``poses`` of the result is None if the log does not have all drops. Raises LogError if the log
    cannot be read, and InvalidValueError if it has no run with its part.
    """
    from resting_aspects_ros.run_logs import logged_result

    return logged_result(Path(log))
