"""Study what the aspects of parts depend on, for the Python interface."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from resting_aspects_ros.api.condition_text import given_conditions
from resting_aspects_ros.api.plan_actions import named_action
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.statistics.intervals import CONFIDENCE
from resting_aspects_ros.simulation.actions import Action, NamedAction
from resting_aspects_ros.simulation.chunks import Workers
from resting_aspects_ros.simulation.conditions import DEFAULT_SURFACE, DropConditions
from resting_aspects_ros.simulation.run_description import DEFAULT_SEED
from resting_aspects_ros.simulation.surroundings.description import Surroundings
from resting_aspects_ros.simulation.surroundings.library import (
    named_surroundings,
    surroundings_from,
)
from resting_aspects_ros.studies.design import Setting, read_factor
from resting_aspects_ros.studies.designs import DEFAULT_DESIGN, DEFAULT_POINTS
from resting_aspects_ros.studies.part_files import load_parts
from resting_aspects_ros.studies.study_result import StudyResult
from resting_aspects_ros.studies.study_run import run_study
from resting_aspects_ros.studies.study_spec import (
    DEFAULT_STUDY_DROPS,
    DEFAULT_TOLERANCE,
    StudySpec,
)


def study(
    parts: Part | str | Path | Sequence[Part | str | Path],
    vary: Mapping[str, Any],
    *,
    surface: str | DropConditions = DEFAULT_SURFACE,
    surroundings: str | Path | Surroundings | None = None,
    action: str | Action | NamedAction | None = None,
    design: str = DEFAULT_DESIGN,
    points: int = DEFAULT_POINTS,
    drops: int = DEFAULT_STUDY_DROPS,
    seed: int = DEFAULT_SEED,
    tolerance: float = DEFAULT_TOLERANCE,
    confidence: float = CONFIDENCE,
    out: str | Path | None = None,
    workers: int | Workers | None = None,
    progress: bool = False,
    **conditions: Any,
) -> StudyResult:
    """Drop parts at many points of some conditions, and find what the shares depend on.

    The same points give the same counts, bit for bit, for any number of workers and regardless of
    the other points. Points at which a part cannot be dropped are skipped; see
    `StudyResult.cases`.

    Parameters
    ----------
    parts : Part, str, Path or sequence of them
        Parts, or what `load_part` accepts; a folder stands for the mesh files in it.
    vary : mapping of str to str or mapping
        Range of each factor, such as ``{'height': '20mm:200mm:7', 'restitution': '0.3:0.8'}``. A
        factor is a condition, a value of the surroundings such as 'surroundings.angle', or of the
        action such as 'action.speed'.
    surface, surroundings
        As for `drop`.
    action : str, Kick, Nozzle, Vibration, Step or NamedAction, optional
        Do this to parts at rest in each aspect, instead of dropping them.
    design : str
        'sobol', 'lhs' (Latin hypercube) or 'factorial'.
    points : int
        Number of points; a factorial design has its own.
    drops : int
        Number of drops at each point; with an action, of actions from each aspect.
    seed : int
        Seed of the design and of the drops.
    tolerance : float
        Change of a share that matters to you, for the verdict in `StudyResult.findings`.
    confidence : float
        Confidence of the intervals.
    out : str or Path, optional
        Folder of the study. A study in it is continued: only points that are missing are
        simulated.
    workers, progress
        As for `drop`.
    **conditions : float
        Conditions that differ from the surface, in SI units.

    Raises
    ------
    InvalidValueError
        A value is out of bounds, a name is not known, or the folder has another study.
    EngineError
        Worker processes of Bullet cannot be started, or died repeatedly.
    OutputError
        A file cannot be written, for example because the disk is full. Finished points are kept.

    Examples
    --------
    >>> import resting_aspects_ros as ra
    >>> result = ra.study('cylinder_d20_h20', {'restitution': '0.2:0.6'}, points=4, drops=50)
    >>> result.cases[0].drops.tolist()
    [50, 50, 50, 50]
    """
    given = given_conditions(surface, conditions)
    around = surroundings
    if around is None and given.surroundings:
        around = surroundings_from(given.surroundings)
    if around is not None and not isinstance(around, Surroundings):
        around = named_surroundings(around)
    base = Setting(
        given.changed(surroundings=''), around, None if action is None else named_action(action)
    )
    several = [parts] if isinstance(parts, Part | str | Path) else list(parts)
    spec = StudySpec(
        tuple(load_parts(several)),
        base,
        tuple(read_factor(name, each, base) for name, each in vary.items()),
        design,
        (points,),
        drops,
        seed,
        tolerance,
        confidence,
    )
    folder = None if out is None else Path(out)
    return run_study(spec, folder, workers=workers, progress=progress)
