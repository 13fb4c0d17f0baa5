"""Simulate an action on parts at rest in each aspect, and count the transitions."""

import dataclasses
import math
import time
import uuid
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from resting_aspects_ros.api.chunk_loop import given_workers
from resting_aspects_ros.api.condition_text import shipped_actions, shipped_surfaces
from resting_aspects_ros.api.drop import plan as plan_drops
from resting_aspects_ros.api.drop_counter import DropCounter
from resting_aspects_ros.api.load_part import load_part
from resting_aspects_ros.api.progress import DropProgress
from resting_aspects_ros.api.reorient_result import ReorientResult
from resting_aspects_ros.api.transition_counter import TransitionCounter, check_in_finer_steps
from resting_aspects_ros.core.aspects.aspect import find_aspects
from resting_aspects_ros.core.aspects.landscape import Landscape
from resting_aspects_ros.core.errors import InvalidValueError, warn
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.reorientation.transition_matrix import OUTCOMES, no_actions
from resting_aspects_ros.core.statistics.distribution import Distribution
from resting_aspects_ros.core.statistics.intervals import (
    CONFIDENCE,
    INTERVAL,
    check_confidence,
    check_method,
)
from resting_aspects_ros.core.statistics.stopping import drops_for
from resting_aspects_ros.simulation.actions import KINDS, Action, NamedAction
from resting_aspects_ros.simulation.chunks import Workers
from resting_aspects_ros.simulation.conditions import DropConditions
from resting_aspects_ros.simulation.drop_job import DropJob
from resting_aspects_ros.simulation.impulses import Nozzle
from resting_aspects_ros.simulation.plan import plan_run
from resting_aspects_ros.simulation.reorientation import action_starts
from resting_aspects_ros.simulation.run_description import (
    DEFAULT_DROPS,
    DEFAULT_SEED,
    MAX_DROPS,
    RunDescription,
)
from resting_aspects_ros.simulation.surfaces import DEFAULT_SURFACE

DEFAULT_ACTION = 'tap'
# 385 actions give intervals of about +-0.05 in the worst case.
DEFAULT_PER_ASPECT = 400
# Stronger actions than those that lift a part by so many hull radii are probably mistakes of the
# unit, and take minutes.
MAX_LIFT = 200
# Number of jets on each aspect with which is checked whether they meet the part.
JETS = 20


@dataclass(frozen=True)
class PlannedActions:
    """Actions that are ready to be simulated."""

    action: NamedAction
    job: DropJob
    run: RunDescription
    counter: TransitionCounter


def plan_actions(
    part: Part,
    action: NamedAction,
    conditions: DropConditions,
    *,
    per_aspect: int = DEFAULT_PER_ASPECT,
    precision: float = 0.0,
    seed: int = DEFAULT_SEED,
    interval: str = INTERVAL,
    confidence: float = CONFIDENCE,
    landscape: Landscape | None = None,
) -> PlannedActions:
    """Find the aspects of a part and plan an action from each; raises InvalidValueError.

    With a precision, ``per_aspect`` is the maximum number of actions; 0: as many as needed.
    """
    check_method(interval)
    check_confidence(confidence)
    landscape = Landscape(part) if landscape is None else landscape
    aspects = find_aspects(part, landscape)
    if not len(aspects):
        raise InvalidValueError(f'invalid part {part.name}: expected a part with an aspect')
    limit = MAX_DROPS // len(aspects)
    if precision > 0:
        columns = len(aspects) + len(OUTCOMES)
        per_aspect = drops_for(precision, per_aspect or limit, columns, interval, confidence)
    if not isinstance(per_aspect, int) or not 1 <= per_aspect <= limit:
        raise InvalidValueError(
            f'invalid number of actions per aspect {per_aspect!r}: expected 1 to {limit} for '
            f'{len(aspects)} aspects'
        )
    job, run = plan_run(
        part,
        conditions,
        seed=seed,
        drops=per_aspect * len(aspects),
        precision=precision,
        run_id=uuid.uuid4().hex[:12],
        started=time.time_ns(),
        landscape=landscape,
        starts=action_starts(part, aspects.aspects, action.action, conditions.gravity),
    )
    _check_speed(part, action, job)
    _warn_if_missed(action, job, len(aspects))
    empty = no_actions(
        aspects, interval=interval, confidence=confidence, by_precision=precision > 0
    )
    return PlannedActions(action, job, run, TransitionCounter(empty, run, precision))


def _check_speed(part: Part, action: NamedAction, job: DropJob) -> None:
    """Raise InvalidValueError if the action is so strong that it is probably a mistake."""
    limit = math.sqrt(2 * job.conditions.gravity * MAX_LIFT * part.hull_radius)
    if job.impact_speed > limit:
        raise InvalidValueError(
            f'invalid action {action.name}: it moves {part.name} with up to '
            f'{job.impact_speed:.3g} m/s; expected at most {limit:.3g} m/s, which lifts it by '
            f'{MAX_LIFT} times its radius; all values are in SI units unless they have a unit'
        )


def _warn_if_missed(action: NamedAction, job: DropJob, aspects: int) -> None:
    """Warn of aspects in which no jet of a nozzle meets the part."""
    if not isinstance(action.action, Nozzle) or not action.action.has_effect:
        return
    assert job.starts is not None
    index = np.arange(JETS * aspects)
    states = job.starts.states(index, np.random.default_rng(job.seed))
    met = (states.velocity != 0).any(axis=1).reshape(JETS, aspects).any(axis=0)
    if not met.all():
        ids = ', '.join(str(k + 1) for k in np.flatnonzero(~met).tolist())
        warn(f'the jet of {action.name} misses the part in aspect {ids}, where it has no effect')


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
    check_convergence: bool = False,
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
    seed, interval, confidence, workers, progress
        As for `drop`.
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
        The worker processes cannot be started, or died repeatedly.

    Examples
    --------
    >>> import resting_aspects_ros as ra
    >>> result = ra.reorient('tetrahedron', 'tap', 30, drops=50, seed=1)
    >>> result.matrix.actions.tolist()
    [30, 30, 30, 30]
    """
    given = surface if isinstance(surface, DropConditions) else shipped_surfaces().get(surface)
    given = given.changed(**conditions) if conditions else given
    loaded = part if isinstance(part, Part) else load_part(part)
    for warning in loaded.warnings:
        warn(warning)
    landscape = Landscape(loaded)
    planned = plan_actions(
        loaded,
        named_action(action),
        given,
        per_aspect=(0 if precision else DEFAULT_PER_ASPECT) if per_aspect is None else per_aspect,
        precision=precision,
        seed=seed,
        interval=interval,
        confidence=confidence,
        landscape=landscape,
    )
    with given_workers(workers) as pool:
        dropped = drop_for_start(loaded, given, drops, seed, pool, shown=progress)
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
        counter.matrix, planned.action, planned.run, part, dropped, counter.complete
    )


def drop_for_start(
    part: Part,
    conditions: DropConditions,
    drops: int,
    seed: int,
    workers: Workers,
    *,
    shown: bool,
    stopped: Callable[[], bool] = lambda: False,
) -> Distribution:
    """Return the distribution of dropped parts, with which parts that left are replaced."""
    planned = plan_drops(part, conditions, drops=drops, seed=seed)
    counter = DropCounter(planned.empty, planned.run)
    with DropProgress(part.name, drops, shown=shown) as bar:
        counter.drop(planned.job, workers, bar.update, stopped)
        bar.end(counter.distribution.drops)
    return counter.distribution


def named_action(action: str | Action | NamedAction) -> NamedAction:
    """Return an action with its name; raises InvalidValueError if the name is not known."""
    if isinstance(action, NamedAction):
        return action
    if isinstance(action, str):
        if action in KINDS:
            raise InvalidValueError(
                f'invalid action {action!r}, which is a kind of action: expected one with values, '
                f'such as ra.{KINDS[action].__name__}(...), or one of '
                f'{", ".join(shipped_actions().names())}'
            )
        return shipped_actions().get(action)
    if not isinstance(action, tuple(KINDS.values())):
        raise InvalidValueError(
            f'invalid action {action!r}: expected a name or one of {", ".join(KINDS)}'
        )
    return NamedAction(action.kind, action)
