"""Find the conditions with the most of the wanted aspects, or with the least entropy."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from resting_aspects_ros.api.chunk_loop import given_workers
from resting_aspects_ros.api.condition_text import given_conditions
from resting_aspects_ros.api.load_part import given_part
from resting_aspects_ros.api.plan_actions import named_action
from resting_aspects_ros.api.progress import DropProgress
from resting_aspects_ros.core.aspects.aspect import find_aspects
from resting_aspects_ros.core.aspects.aspect_set import AspectSet
from resting_aspects_ros.core.aspects.landscape import Landscape
from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.statistics.intervals import CONFIDENCE
from resting_aspects_ros.simulation.actions import Action, NamedAction
from resting_aspects_ros.simulation.chunks import Workers
from resting_aspects_ros.simulation.conditions import DEFAULT_SURFACE, DropConditions
from resting_aspects_ros.simulation.run_description import (
    DEFAULT_SEED,
)
from resting_aspects_ros.simulation.surroundings.description import Surroundings
from resting_aspects_ros.simulation.surroundings.library import named_surroundings
from resting_aspects_ros.studies.design import Setting, read_factor
from resting_aspects_ros.studies.objectives import make_objective
from resting_aspects_ros.studies.optimisation import Optimisation
from resting_aspects_ros.studies.optimise_result import OptimiseResult
from resting_aspects_ros.studies.optimum_problem import (
    BUDGET,
    DEFAULT_DROPS,
    DEFAULT_POINTS,
    Amounts,
)
from resting_aspects_ros.studies.wanted_contacts import (
    WantedContacts,
    finder_in,
    read_contacts,
)


def optimise(
    part: Part | str | Path,
    vary: Mapping[str, Any],
    *,
    wanted: Sequence[int] | None = None,
    wanted_classes: Sequence[int] | None = None,
    wanted_contacts: Sequence[str | Mapping[str, Any]] = (),
    minimise_entropy: bool = False,
    surface: str | DropConditions = DEFAULT_SURFACE,
    surroundings: str | Path | Surroundings | None = None,
    action: str | Action | NamedAction | None = None,
    points: int = DEFAULT_POINTS,
    drops: int = DEFAULT_DROPS,
    budget: int | None = None,
    seed: int = DEFAULT_SEED,
    confidence: float = CONFIDENCE,
    workers: int | Workers | None = None,
    progress: bool = False,
    **conditions: Any,
) -> OptimiseResult:
    """Find the conditions with the most of the wanted aspects, or with the least entropy.

    Drops at the points of a Sobol design, a surrogate of the shares, and rounds of further drops
    where draws of the surrogate have their best points. Fresh drops at the best conditions, at the
    second best and at the given conditions then show how certain the answer is. The same arguments
    give the same result for any number of workers.

    Parameters
    ----------
    part : Part, str or Path
        A part, or what `load_part` accepts.
    vary : mapping of str to str, (float, float) or mapping
        Ranges of the factors: conditions, ``surroundings.angle`` or ``action.speed``; a text such
        as '20mm:200mm' or '20mm:200mm:7' (7 levels), or the two ends in SI units.
    wanted, wanted_classes : sequence of int, optional
        Wanted aspects or symmetry classes, whose share is maximised.
    wanted_contacts : sequence of str or mapping, optional
        In surroundings with walls: contacts such as ``{'belt': 1, 'wall': 'edge'}``; a part
        must have those of one entry. With planes that are not named, any contact is accepted.
    minimise_entropy : bool
        Minimise the entropy of the distribution over the symmetry classes instead.
    surface : str or DropConditions
        Named conditions, or conditions, of everything that does not vary.
    surroundings : str, Path or Surroundings, optional
        As for `drop`. Aspects are counted on the first plane.
    action : str, Action or NamedAction, optional
        What is done once to each part that was dropped, before it is counted.
    points, drops : int
        Number of points of the design, and of drops at each point.
    budget : int, optional
        Maximum number of all drops; by default twice those of the design. A quarter of them are
        fresh drops.
    seed, workers, progress
        As for `drop`.
    confidence : float
        Of the intervals.
    **conditions : float
        Conditions that differ from the surface, in SI units; what varies starts from them.

    Returns
    -------
    OptimiseResult

    Raises
    ------
    InvalidValueError
        A value is out of bounds, a name is not known, or nearly all points are impossible.
    EngineError
        Worker processes of Bullet cannot be started, or died repeatedly.

    Examples
    --------
    >>> import resting_aspects_ros as ra
    >>> found = ra.optimise('tetrahedron', {'height': '20mm:60mm'}, wanted=[1], points=4, drops=20)
    >>> 0.02 <= found.best.values['height'] <= 0.06
    True
    """
    loaded = given_part(part)
    base = Setting(
        given_conditions(surface, conditions),
        None if surroundings is None else _surroundings(surroundings),
        None if action is None else named_action(action),
    )
    factors = [read_factor(name, _range(given), base) for name, given in vary.items()]
    landscape = Landscape(loaded)
    aspects = find_aspects(loaded, landscape)
    objective = make_objective(
        aspects,
        wanted,
        wanted_classes,
        minimise_entropy=minimise_entropy,
        contacts=contacts_wanted(wanted_contacts, loaded, base, aspects),
    )
    amounts = Amounts(points, drops, BUDGET * points * drops if budget is None else budget)
    with (
        given_workers(workers) as pool,
        DropProgress(loaded.name, amounts.total, shown=progress) as bar,
    ):
        optimisation = Optimisation(
            loaded,
            factors,
            base,
            objective,
            amounts,
            seed,
            pool,
            landscape=landscape,
            confidence=confidence,
            progress=bar.update,
        )
        optimisation.run()
        bar.end(optimisation.drops)
    result = optimisation.result()
    assert result is not None  # nothing ends a search early here
    return result


def contacts_wanted(
    given: Sequence[str | Mapping[str, Any]], part: Part, base: Setting, aspects: AspectSet
) -> list[WantedContacts]:
    """Return wanted contacts with the planes of a setting; raises InvalidValueError."""
    if not given:
        return []
    if base.action is not None:
        raise InvalidValueError('invalid wanted contacts: expected only without an action')
    planes = [plane.name for plane in finder_in(part, base.drop_conditions, aspects).planes]
    return [read_contacts(each, planes, aspects) for each in given]


def _surroundings(given: str | Path | Surroundings) -> Surroundings:
    return given if isinstance(given, Surroundings) else named_surroundings(given)


def _range(given: Any) -> Any:
    """Return a range as `read_factor` accepts it."""
    if isinstance(given, tuple | list) and len(given) == 2:
        return {'low': given[0], 'high': given[1]}
    return given
