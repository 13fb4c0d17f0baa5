"""Simulate an action on parts at rest in each aspect; the transitions, and the best plan."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from resting_aspects_ros.api.conditions import conditions_text, given_conditions, with_surroundings
from resting_aspects_ros.api.drop import make_drops
from resting_aspects_ros.api.plan import (
    DEFAULT_ACTION,
    DEFAULT_PER_ASPECT,
    PlannedActions,
    check_actions,
    named_action,
    plan_actions,
    plan_drops,
)
from resting_aspects_ros.api.result import Result
from resting_aspects_ros.api.runner import (
    Convergence,
    Progress,
    Runner,
    keep_result,
    make_runner,
    never,
    repeat_actions_in_finer_steps,
)
from resting_aspects_ros.arrays import Array
from resting_aspects_ros.aspects.landscape import Landscape
from resting_aspects_ros.errors import EngineError, InvalidValueError, StoppedError, analysis, warn
from resting_aspects_ros.part.library import given_part
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.part.pieces import ConvexPieces, convex_pieces
from resting_aspects_ros.report.document import SCHEMA_VERSION, aspect_fields, plain, share_fields
from resting_aspects_ros.report.transitions import (
    long_run_fields,
    matrix_fields,
    transition_figure,
)
from resting_aspects_ros.simulation.actions import NamedAction
from resting_aspects_ros.simulation.conditions import (
    DEFAULT_DROPS,
    DEFAULT_SEED,
    DEFAULT_SURFACE,
    DropConditions,
)
from resting_aspects_ros.simulation.job import RunDescription
from resting_aspects_ros.simulation.starts import Action
from resting_aspects_ros.simulation.surroundings import Surroundings
from resting_aspects_ros.simulation.workers import Workers
from resting_aspects_ros.statistics.distribution import OUTSIDE, Distribution
from resting_aspects_ros.statistics.intervals import CONFIDENCE, INTERVAL
from resting_aspects_ros.statistics.markov import (
    LongRun,
    Plan,
    best_plan,
    long_run,
    long_run_bounds,
    reach,
    wanted_mask,
    with_replacement,
)
from resting_aspects_ros.statistics.transitions import TransitionMatrix

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from resting_aspects_ros.report.page import Page


# -- Results --------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class ReorientResult(Result):
    """The transitions that an action causes, with the drops that replace parts that left.

    Attributes
    ----------
    matrix : TransitionMatrix
        Counts, probabilities and intervals from each aspect.
    action : NamedAction
    run : RunDescription
        Conditions, seed, engine and versions; ``drops`` is the number of requested actions.
    part : Part
    drop : Distribution
        Where parts come to rest that are dropped under the same conditions.
    complete : bool
        Whether all actions that were requested are counted.
    convergence : Convergence or None
        How far the matrix moves with a finer time step, if that was checked.
    pieces : ConvexPieces or None
        The convex pieces of the part that meet an edge, and their difference from it; None for
        actions without an edge, and in a result that was read from a log.
    """

    matrix: TransitionMatrix
    action: NamedAction
    run: RunDescription
    part: Part
    drop: Distribution
    complete: bool
    convergence: Convergence | None = None
    pieces: ConvexPieces | None = None

    @property
    def title(self) -> str:
        """Part, action, surface and seed in one line."""
        return (
            f'{self.run.part}, {self.action.name} on {conditions_text(self.run.conditions)}, '
            f'seed {self.run.seed}'
        )

    def by_class(self) -> 'ReorientResult':
        """Return the result over symmetry classes; their numbers replace the ids of aspects."""
        return self._by_class

    @cached_property
    def _by_class(self) -> 'ReorientResult':
        return dataclasses.replace(self, matrix=self.matrix.by_class(), drop=self.drop.by_class())

    @property
    def drop_shares(self) -> Array:
        """(k,) share of each aspect in the drops."""
        return np.asarray(self.drop.counts / max(self.drop.drops, 1))

    @cached_property
    def long_run(self) -> LongRun | None:
        """The mix that repeated actions lead to; None if actions or drops are missing for it."""
        if not (self.matrix.actions > 0).all() or not self.drop.counts.any():
            return None
        found: LongRun | None = None
        with analysis(f'the long-run shares of {self.action.name}'):
            found = long_run(self.matrix.transitions, self.matrix.left, self.drop_shares)
        return found  # noqa: RET504 the analysis can fail

    @cached_property
    def long_run_bounds(self) -> tuple[Array, Array]:
        """Lower and upper bounds (k,) of the long-run shares."""
        generator = np.random.default_rng(self.run.seed)
        m = self.matrix
        return long_run_bounds(m.counts, self.drop_shares, m.confidence, generator)

    @property
    def chain(self) -> Array:
        """(k, k) transitions in which parts that left the aspects are replaced by dropped parts.

        Raises InvalidValueError if actions or drops are missing for it.
        """
        if self.long_run is None:
            raise InvalidValueError(
                f'invalid result of {self.action.name}: expected actions from each aspect, and '
                'drops that come to rest in an aspect'
            )
        return with_replacement(self.matrix.transitions, self.matrix.left, self.drop_shares)

    def reach(self, wanted: Sequence[int]) -> tuple[Array, Array]:
        """Return how likely repeated actions lead to wanted aspects, and after how many.

        Parameters
        ----------
        wanted : sequence of int
            Ids of aspects.

        Returns
        -------
        probability, actions : (k,) float
            For each aspect the probability to reach a wanted aspect before leaving the aspects,
            and the expected number of actions if it is reached; NaN if it never is.

        Raises
        ------
        InvalidValueError
            If an id is not known, or if actions are missing.
        """
        mask = wanted_mask(wanted, len(self.matrix.counts))
        if not (self.matrix.actions > 0).all():
            raise InvalidValueError('invalid result: expected actions from each aspect')
        return reach(self.matrix.transitions, mask)

    def document(self, wanted: Sequence[int] = ()) -> dict[str, object]:
        """Return the document that `resting_aspects reorient --json` prints."""
        run = self.run.document()
        actions, by_precision = run.pop('drops'), run.pop('precision')
        rows = zip(self.drop.aspects, self.drop.counts, self.drop.intervals(), strict=True)
        matrix = matrix_fields(self.matrix)
        document: dict[str, object] = {
            'schema_version': SCHEMA_VERSION,
            **run,
            'mesh_sha256': self.part.mesh_sha256,
            'precision': by_precision,
            'action': plain(self.action.values),
            'actions_asked': actions,
            'complete': self.complete,
            'energy_growth': self.matrix.energy_growth,
            'confidence': self.matrix.confidence,
            'interval': self.matrix.interval,
            'aspects': [
                aspect_fields(aspect, self.part) | share_fields(int(count), interval)
                for aspect, count, interval in rows
            ],
            'drop': {
                'drops': self.drop.drops,
                'counts': plain(self.drop.counts),
                **{name: getattr(self.drop, name) for name in OUTSIDE},
            },
            **matrix,
            'long_run': None,
        }
        if self.run.conditions.surroundings is not None:
            document['sliding'] = self.matrix.sliding
        view = self.by_class()
        if self.long_run is not None and view.long_run is not None:
            with analysis('the bounds of the long-run shares'):
                aspects = self.matrix.aspects
                document |= long_run_fields(self.long_run, *self.long_run_bounds, aspects)
                lower, upper = view.long_run_bounds
                document['classes'] = {
                    **matrix['classes'],
                    'long_run': plain(view.long_run.shares),
                    'long_run_lower': plain(lower),
                    'long_run_upper': plain(upper),
                }
        if wanted and (self.matrix.actions > 0).all():
            probability, number = self.reach(wanted)
            document['wanted'] = {
                'aspects': sorted(set(wanted)),
                'probability': plain(probability),
                'actions': plain(number),
            }
        if self.convergence is not None:
            document['convergence'] = plain(self.convergence)
        if self.pieces is not None:
            document['convex_pieces'] = self.pieces.summary()
        return document

    def page(self, wanted: Sequence[int] = ()) -> 'Page':
        """Return a page with the heat map and all numbers."""
        from resting_aspects_ros.api.pages import reorientation_page

        return reorientation_page([self], wanted=wanted)

    def figure(self) -> 'Figure':
        """Return the heat map of the transitions."""
        return transition_figure(self.matrix, self.part, self.title)


@dataclass(frozen=True, eq=False)
class PlanResult:
    """The best action in each aspect, for the least expected time to wanted aspects.

    Attributes
    ----------
    names : tuple of str
        Names of the actions, to which the indices of ``plan`` refer.
    wanted : tuple of int
        Ids of the wanted aspects.
    plan : Plan
    """

    names: tuple[str, ...]
    wanted: tuple[int, ...]
    plan: Plan

    def document(self) -> Mapping[str, object]:
        """Return a plan as plain JSON types: an action and a time, s, for each aspect by id.

        The action is null in wanted aspects and where none leads to them with certainty; the time
        is then 0 or null.
        """
        actions = [self.names[k] if k >= 0 else None for k in self.plan.action.tolist()]
        return {
            'wanted': list(self.wanted),
            'action': actions,
            'expected_time': plain(self.plan.time),
        }


def plan_reorientation(results: Sequence[ReorientResult], wanted: Sequence[int]) -> PlanResult:
    """Return which action to take in which aspect, for the least expected time to wanted aspects.

    A part that leaves the aspects is replaced by a dropped part, which takes no time. If whole
    symmetry classes are wanted, the plan is that of the transitions by class.

    Parameters
    ----------
    results : sequence of ReorientResult
        Results by aspect of different actions on the same part under the same conditions.
    wanted : sequence of int
        Ids of aspects.

    Raises
    ------
    InvalidValueError
        If there is no result, the parts differ, two actions have the same name, or an id is not
        known.
    """
    if not results:
        raise InvalidValueError('invalid results: expected at least one')
    first = results[0].matrix.aspects
    for each in results:
        if each.matrix.aspects.part_sha256 != first.part_sha256:
            raise InvalidValueError(
                f'invalid result of part {each.run.part}: expected {results[0].run.part}'
            )
    names = tuple(each.action.name for each in results)
    if len(set(names)) < len(names):
        raise InvalidValueError(f'invalid actions {", ".join(names)}: expected different names')
    mask = wanted_mask(wanted, len(first))
    times = np.array([each.action.time for each in results])
    classes = [[aspect.id - 1 for aspect in members] for members in first.classes()]
    if all(mask[members].all() or not mask[members].any() for members in classes):
        # The aspects of a class have the same plan, which their common counts determine best.
        chains = np.stack([each.by_class().chain for each in results])
        found = best_plan(chains, times, np.array([mask[members[0]] for members in classes]))
        number = np.empty(len(first), dtype=np.int64)
        for k, members in enumerate(classes):
            number[members] = k
        plan = Plan(found.action[number], found.time[number])
    else:
        plan = best_plan(np.stack([each.chain for each in results]), times, mask)
    return PlanResult(names, tuple(sorted(set(wanted))), plan)


# -- Actions --------------------------------------------------------------------------------------


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
    action : str, Action or NamedAction
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
    try:
        return reorient_each(
            part,
            [action],
            per_aspect,
            surface=surface,
            precision=precision,
            drops=drops,
            seed=seed,
            interval=interval,
            confidence=confidence,
            surroundings=surroundings,
            check_convergence=check_convergence,
            engine=engine,
            workers=workers,
            progress=progress,
            stopped=stopped,
            **conditions,
        )[0]
    except EngineError as error:
        error.result = error.result[0] if error.result else None
        raise


def reorient_each(
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
    check_convergence: bool = False,
    engine: str = '',
    workers: int | Workers | None = None,
    progress: Progress = False,
    stopped: Callable[[], bool] = never,
    **conditions: Any,
) -> list[ReorientResult]:
    """Do each of several actions as `reorient` does, after the same drops.

    All input is checked before the first drop. The attribute ``result`` of an EngineError has the
    results before, the last one incomplete.
    """
    given = with_surroundings(given_conditions(surface, conditions), surroundings)
    loaded = given_part(part)
    if per_aspect is None:
        per_aspect = 0 if precision else DEFAULT_PER_ASPECT
    options: dict[str, Any] = {
        'per_aspect': per_aspect,
        'precision': precision,
        'interval': interval,
        'confidence': confidence,
        'landscape': Landscape(loaded),
    }
    named = [named_action(action) for action in actions]
    run_options: dict[str, Any] = {'seed': seed, 'engine': engine, **options}
    planned = []
    for action in named:
        if given.surroundings is None:
            planned.append(plan_actions(loaded, action, given, **run_options))
        else:  # planned later: the actions start from the poses of the drops
            check_actions(loaded, action, given, **options)
    dropping = plan_drops(loaded, given, drops=drops, seed=seed, engine=engine)
    results: list[ReorientResult] = []
    with make_runner(workers, progress, stopped) as runner, keep_result(lambda: results):
        first = make_drops(runner, dropping, loaded)
        dropped = first.distribution  # with which parts that left are replaced
        if dropping.contacts is not None:
            dropped = dataclasses.replace(dropped, contacts=dropping.contacts.counted)
        if given.surroundings is not None:
            if runner.stopped():
                raise StoppedError('interrupted before the first action')
            rests = first.poses
            planned = [
                plan_actions(loaded, action, given, rests=rests, **run_options) for action in named
            ]
        for each in planned:
            _act(runner, each, loaded, dropped, results, check=check_convergence)
    for each in planned:
        if each.tally.complete and each.tally.precision > 0 and not each.tally.precise:
            warn(
                f'precision {each.tally.precision:g} was not reached in {each.tally.done} '
                f'actions of {each.action.name}, the requested maximum'
            )
    return results


def _act(
    runner: Runner,
    planned: PlannedActions,
    part: Part,
    dropped: Distribution,
    results: list[ReorientResult],
    *,
    check: bool,
) -> None:
    """Do planned actions and append their result, even if the work ends before."""
    action, run, tally = planned.action, planned.run, planned.tally
    label = f'{part.name}, {action.name}'
    convergence = None
    try:
        runner.count(planned.job, run, tally, label=label, unit='actions')
        if check and not runner.stopped():
            convergence = repeat_actions_in_finer_steps(runner, planned.job, run, tally, label)
    finally:
        pieces = convex_pieces(part) if action.action.edge else None
        results.append(
            ReorientResult(
                tally.matrix, action, run, part, dropped, tally.complete, convergence, pieces
            )
        )
