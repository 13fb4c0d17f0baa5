"""Simulate an action on parts at rest in each aspect, and count the transitions."""

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from resting_aspects_ros.api.conditions import given_conditions, with_surroundings
from resting_aspects_ros.api.drop import make_drops
from resting_aspects_ros.api.load_part import given_part
from resting_aspects_ros.api.plan import (
    DEFAULT_ACTION,
    DEFAULT_PER_ASPECT,
    PlannedActions,
    PlannedDrops,
    check_actions,
    named_action,
    plan_actions,
    plan_drops,
)
from resting_aspects_ros.api.reorient_result import ReorientResult
from resting_aspects_ros.api.runner import (
    MatrixConvergence,
    Progress,
    Runner,
    keep_result,
    make_runner,
    never,
    repeat_actions_in_finer_steps,
)
from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.aspects.landscape import Landscape
from resting_aspects_ros.errors import EngineError, StoppedError, warn
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.part.pieces import convex_pieces
from resting_aspects_ros.simulation.actions import NamedAction
from resting_aspects_ros.simulation.conditions import (
    DEFAULT_DROPS,
    DEFAULT_SEED,
    DEFAULT_SURFACE,
    DropConditions,
)
from resting_aspects_ros.simulation.starts import Action
from resting_aspects_ros.simulation.surroundings import Surroundings
from resting_aspects_ros.simulation.workers import Workers
from resting_aspects_ros.statistics.distribution import Distribution
from resting_aspects_ros.statistics.intervals import CONFIDENCE, INTERVAL
from resting_aspects_ros.statistics.poses import RestingPoses


def reorient(
    part: Part | str | Path,
    action: str | Action | NamedAction = DEFAULT_ACTION,
    per_aspect: int | None = None,
    *,
    surface: str | DropConditions = DEFAULT_SURFACE,
    precision: float = 0.0,
    drops: int = DEFAULT_DROPS,
    seed: int = DEFAULT_SEED,
    interval: str = INTERVAL,
    confidence: float = CONFIDENCE,
    surroundings: str | Path | Surroundings | None = None,
    check_convergence: bool = False,
    engine: str = '',
    workers: int | Workers | None = None,
    progress: Progress = False,
    stopped: Callable[[], bool] = never,
    **conditions: Any,
) -> ReorientResult:
    """Do an action many times to a part at rest in each aspect, and count where it comes to rest.

    The same part, action, conditions and seed give the same counts for any number of workers.

    Parameters
    ----------
    part : Part, str or Path
        A part, or what `load_part` accepts.
    action : str, Kick, Nozzle, Vibration, Step or NamedAction
        The name of an action of config/actions.yaml, or an action.
    per_aspect : int, optional
        Number of actions from each aspect, 400 by default. With ``precision`` the maximum.
    surface : str or DropConditions
        Named conditions, or conditions. Height, speeds and spin are those of the drops.
    precision : float
        Maximum half width of all intervals of the matrix at which the actions stop; 0: never.
    drops : int
        Number of drops, whose distribution replaces parts that leave the aspects.
    seed, interval, confidence, engine, workers, progress, stopped
        As for `drop`.
    surroundings : str, Path or Surroundings, optional
        As for `drop`. The actions then start from the resting poses of the drops, and the
        vibration shakes all bodies.
    check_convergence : bool
        Repeat the actions with half the time step.
    **conditions : float
        Conditions that differ from the surface, in SI units, such as ``friction=0.3``.

    Returns
    -------
    ReorientResult

    Raises
    ------
    InvalidValueError
        A value is out of bounds, a name is not known, or the part has no aspect.
    EngineError
        Worker processes of Bullet cannot be started, or died repeatedly. Its attribute ``result``
        is the result of the actions before, if there were any.

    Examples
    --------
    >>> import resting_aspects_ros as ra
    >>> result = ra.reorient('tetrahedron', 'tap', 30, drops=50, seed=1)
    >>> result.matrix.actions.tolist()
    [30, 30, 30, 30]
    """
    options: dict[str, Any] = {
        'precision': precision,
        'drops': drops,
        'seed': seed,
        'interval': interval,
        'confidence': confidence,
        'surroundings': surroundings,
        'engine': engine,
        **conditions,
    }
    planned = plan_reorient(part, [action], per_aspect, surface=surface, **options)
    with make_runner(workers, progress, stopped) as runner:
        try:
            return planned.make(runner, check=check_convergence)[0]
        except EngineError as error:
            error.result = error.result[0] if error.result else None
            raise


def reorient_each(
    part: Part | str | Path,
    actions: Sequence[str | Action | NamedAction],
    per_aspect: int | None = None,
    *,
    check_convergence: bool = False,
    workers: int | Workers | None = None,
    progress: Progress = False,
    stopped: Callable[[], bool] = never,
    **options: Any,
) -> list[ReorientResult]:
    """Do each of several actions as `reorient` does, after the same drops.

    All input is checked before the first drop. ``options`` are the other arguments of `reorient`.
    The attribute ``result`` of an EngineError has the results before, the last one incomplete.
    """
    planned = plan_reorient(part, actions, per_aspect, **options)
    with make_runner(workers, progress, stopped) as runner:
        return planned.make(runner, check=check_convergence)


def plan_reorient(
    part: Part | str | Path,
    actions: Sequence[str | Action | NamedAction],
    per_aspect: int | None = None,
    *,
    surface: str | DropConditions = DEFAULT_SURFACE,
    precision: float = 0.0,
    drops: int = DEFAULT_DROPS,
    seed: int = DEFAULT_SEED,
    interval: str = INTERVAL,
    confidence: float = CONFIDENCE,
    surroundings: str | Path | Surroundings | None = None,
    engine: str = '',
    **conditions: Any,
) -> 'PlannedReorient':
    """Check and plan drops of a part and actions on it; see `reorient` for the arguments."""
    given = with_surroundings(given_conditions(surface, conditions), surroundings)
    loaded = given_part(part)
    if per_aspect is None:
        per_aspect = 0 if precision else DEFAULT_PER_ASPECT
    values: dict[str, Any] = {
        'per_aspect': per_aspect,
        'precision': precision,
        'interval': interval,
        'confidence': confidence,
        'landscape': Landscape(loaded),
    }
    named = [named_action(action) for action in actions]

    def plan(action: NamedAction, rests: RestingPoses | None = None) -> PlannedActions:
        options = {**values, 'seed': seed, 'engine': engine, 'rests': rests}
        return plan_actions(loaded, action, given, **options)

    planned = None
    if given.surroundings is None:
        planned = [plan(action) for action in named]
    else:
        for action in named:
            check_actions(loaded, action, given, **values)
    dropping = plan_drops(loaded, given, drops=drops, seed=seed, engine=engine)
    return PlannedReorient(loaded, dropping, named, planned, plan)


@dataclass(frozen=True)
class PlannedReorient:
    """Drops and actions that are checked.

    planned : list of PlannedActions or None
        None in surroundings, where the actions start from the poses of the drops.
    plan : callable
        Plans an action from resting poses.
    """

    part: Part
    dropping: PlannedDrops
    actions: list[NamedAction]
    planned: list[PlannedActions] | None
    plan: Callable[..., PlannedActions]

    @property
    def aspects(self) -> AspectSet:
        """The aspects of the part that are counted."""
        return self.dropping.empty.aspects

    def make(self, runner: Runner, *, check: bool = False) -> list[ReorientResult]:
        """Make the drops and the actions; with ``check``, repeat these with half the time step."""
        results: list[ReorientResult] = []
        with keep_result(lambda: results):
            dropped, rests = drop_for_start(runner, self.dropping, self.part)
            planned = self.planned
            if planned is None:
                if runner.stopped():
                    raise StoppedError('interrupted before the first action')
                planned = [self.plan(action, rests=rests) for action in self.actions]
            for each in planned:
                convergence = None
                try:
                    convergence = _act(runner, each, self.part, check=check)
                finally:
                    results.append(_result(each, self.part, dropped, convergence))
        for each in planned:
            if each.tally.complete and each.tally.precision > 0 and not each.tally.precise:
                warn(
                    f'precision {each.tally.precision:g} was not reached in {each.tally.done} '
                    f'actions of {each.action.name}, the requested maximum'
                )
        return results


def _act(
    runner: Runner, planned: PlannedActions, part: Part, *, check: bool
) -> MatrixConvergence | None:
    """Make planned actions; returns how the matrix changes with half the time step, if asked."""
    label = f'{part.name}, {planned.action.name}'
    runner.count(planned.job, planned.run, planned.tally, label=label, unit='actions')
    if not check or runner.stopped():
        return None
    return repeat_actions_in_finer_steps(runner, planned.job, planned.run, planned.tally, label)


def _result(
    planned: PlannedActions,
    part: Part,
    dropped: Distribution,
    convergence: MatrixConvergence | None,
) -> ReorientResult:
    return ReorientResult(
        planned.tally.matrix,
        planned.action,
        planned.run,
        part,
        dropped,
        planned.tally.complete,
        pieces=convex_pieces(part) if planned.action.action.has_edge else None,
        convergence=convergence,
    )


def drop_for_start(
    runner: Runner, planned: PlannedDrops, part: Part
) -> tuple[Distribution, RestingPoses]:
    """Return the distribution of dropped parts, with which parts that left are replaced.

    Also returns the poses, from which actions in surroundings start.
    """
    result = make_drops(runner, planned, part)
    dropped = result.distribution
    if planned.contacts is not None:
        dropped = dataclasses.replace(dropped, contacts=planned.contacts.counted)
    assert result.poses is not None
    return dropped, result.poses
