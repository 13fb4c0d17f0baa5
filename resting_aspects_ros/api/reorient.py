"""Simulate an action on parts at rest in each aspect, and count the transitions."""

import dataclasses
import functools
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from resting_aspects_ros.api.chunk_loop import given_workers
from resting_aspects_ros.api.condition_text import given_conditions
from resting_aspects_ros.api.drop_counter import Consumer, DropCounter
from resting_aspects_ros.api.load_part import given_part
from resting_aspects_ros.api.plan_actions import (
    DEFAULT_ACTION,
    DEFAULT_PER_ASPECT,
    PlannedActions,
    check_actions,
    named_action,
    plan_actions,
)
from resting_aspects_ros.api.plan_drops import plan_drops
from resting_aspects_ros.api.progress import DropProgress
from resting_aspects_ros.api.reorient_result import ReorientResult
from resting_aspects_ros.api.surroundings import warn_of_surroundings, with_surroundings
from resting_aspects_ros.api.transition_counter import check_in_finer_steps
from resting_aspects_ros.aspects.landscape import Landscape
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.part.pieces import convex_pieces
from resting_aspects_ros.simulation.actions import NamedAction
from resting_aspects_ros.simulation.conditions import DEFAULT_SURFACE, DropConditions
from resting_aspects_ros.simulation.job import (
    DEFAULT_DROPS,
    DEFAULT_SEED,
)
from resting_aspects_ros.simulation.starts import Action
from resting_aspects_ros.simulation.surroundings import Surroundings
from resting_aspects_ros.simulation.workers import Workers
from resting_aspects_ros.statistics.distribution import Distribution
from resting_aspects_ros.statistics.intervals import (
    CONFIDENCE,
    INTERVAL,
)
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
    progress: bool = False,
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
    seed, interval, confidence, engine, workers, progress
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
        Worker processes of Bullet cannot be started, or died repeatedly.

    Examples
    --------
    >>> import resting_aspects_ros as ra
    >>> result = ra.reorient('tetrahedron', 'tap', 30, drops=50, seed=1)
    >>> result.matrix.actions.tolist()
    [30, 30, 30, 30]
    """
    given = with_surroundings(given_conditions(surface, conditions), surroundings)
    loaded = given_part(part)
    values: Mapping[str, Any] = {
        'per_aspect': (0 if precision else DEFAULT_PER_ASPECT)
        if per_aspect is None
        else per_aspect,
        'precision': precision,
        'interval': interval,
        'confidence': confidence,
        'landscape': Landscape(loaded),
    }
    requested = named_action(action)
    plan = functools.partial(
        plan_actions, loaded, requested, given, seed=seed, engine=engine, **values
    )
    # Wrong input is refused before the first drop.
    if given.surroundings is not None:
        check_actions(loaded, requested, given, **values)
    planned = None if given.surroundings is not None else plan()
    with given_workers(workers) as pool:
        dropped, rests = drop_for_start(
            loaded, given, drops, seed, pool, engine=engine, shown=progress
        )
        planned = plan(rests=rests) if planned is None else planned
        return make_actions(
            planned, loaded, dropped, pool, check=check_convergence, shown=progress
        )


def make_actions(
    planned: PlannedActions,
    part: Part,
    dropped: Distribution,
    workers: Workers,
    *,
    check: bool,
    shown: bool,
    stopped: Callable[[], bool] = lambda: False,
) -> ReorientResult:
    """Make planned actions and, if ``check``, repeat them with half the time step."""
    counter, convergence = planned.counter, None
    label = f'{part.name}, {planned.action.name}'
    with DropProgress(label, planned.run.drops, 'actions', shown=shown) as bar:
        counter.make(planned.job, workers, bar.update, stopped)
        bar.end(counter.done)
    if check and not stopped():
        label = f'{label} with a finer time step'
        with DropProgress(label, counter.done, 'actions', shown=shown) as bar:
            convergence = check_in_finer_steps(counter, planned.job, workers, bar.update, stopped)
    return dataclasses.replace(counted_result(planned, part, dropped), convergence=convergence)


def counted_result(planned: PlannedActions, part: Part, dropped: Distribution) -> ReorientResult:
    """Return the result of the actions that were counted so far."""
    counter = planned.counter
    return ReorientResult(
        counter.matrix,
        planned.action,
        planned.run,
        part,
        dropped,
        counter.complete,
        pieces=convex_pieces(part) if planned.action.action.has_edge else None,
    )


def drop_for_start(
    part: Part,
    conditions: DropConditions,
    drops: int,
    seed: int,
    workers: Workers,
    *,
    shown: bool,
    engine: str = '',
    stopped: Callable[[], bool] = lambda: False,
) -> tuple[Distribution, RestingPoses]:
    """Return the distribution of dropped parts, with which parts that left are replaced.

    Also returns the poses, from which actions in surroundings start.
    """
    planned = plan_drops(part, conditions, drops=drops, seed=seed, engine=engine)
    warn_of_surroundings(conditions, part.hull_radius)
    chunks: list[RestingPoses] = []
    consumers: list[Consumer] = [*planned.consumers, lambda poses, _: chunks.append(poses)]
    counter = DropCounter(planned.empty, planned.run, consumers=consumers)
    with DropProgress(part.name, drops, shown=shown) as bar:
        counter.drop(planned.job, workers, bar.update, stopped)
        bar.end(counter.distribution.drops)
    dropped = counter.distribution
    if planned.contacts is not None:
        dropped = dataclasses.replace(dropped, contacts=planned.contacts.counted)
    return dropped, RestingPoses.join([RestingPoses.none(0), *chunks])
