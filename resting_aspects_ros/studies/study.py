"""Study what the aspects of parts depend on: drops over ranges of conditions."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from pydantic import StrictInt, StrictStr

from resting_aspects_ros.api.result import Result, make_folder, whole_file, write_rows
from resting_aspects_ros.api.runner import DropProgress, Progress, given_workers, never
from resting_aspects_ros.arrays import Array, Counts
from resting_aspects_ros.errors import InvalidValueError, analysis, located, shown
from resting_aspects_ros.input_files import (
    FileModel,
    Number,
    named,
    read_yaml,
    validated,
    yaml_text,
)
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.simulation.actions import NamedAction
from resting_aspects_ros.simulation.conditions import (
    DEFAULT_SEED,
    DEFAULT_SURFACE,
    DropConditions,
    Surfaces,
    check_drops,
    check_seed,
)
from resting_aspects_ros.simulation.starts import Action
from resting_aspects_ros.simulation.surroundings import Surroundings
from resting_aspects_ros.simulation.workers import Workers, worker_versions
from resting_aspects_ros.statistics.distribution import OUTSIDE
from resting_aspects_ros.statistics.intervals import CONFIDENCE, bounds, check_confidence
from resting_aspects_ros.statistics.model_range import model_bounds
from resting_aspects_ros.studies.batch import load_parts, save_part
from resting_aspects_ros.studies.design import (
    DEFAULT_DESIGN,
    DEFAULT_POINTS,
    DESIGNS,
    Design,
    Factor,
    Setting,
    check_factors,
    given_setting,
    make_design,
    point_values,
    read_factor,
    read_setting,
)
from resting_aspects_ros.studies.effects import (
    FRESH_DROPS,
    Effects,
    Finding,
    effects_of,
    findings_of,
    fresh_points,
)
from resting_aspects_ros.studies.points import (
    STORE,
    Case,
    Monitor,
    PointStore,
    Simulation,
    counted,
    counts_by_class,
    point_key,
    point_seed,
    reasons,
    run_tasks,
)

if TYPE_CHECKING:
    from resting_aspects_ros.report.page import Page

SPEC, CSV, PAGE = 'study.yaml', 'results.csv', 'page.html'
# First line of a study.yaml that a study wrote, and may write again.
WRITTEN = '# To repeat the study: resting_aspects study study.yaml\n'
NOTE = '# The study may write this file again; without the line above, it never does.\n'
# Drops of all points together by default, with an action from each aspect a fifth of them; and the
# bounds of those of one point.
ALL_DROPS, MIN_DROPS, MAX_DROPS, ACTIONS = 120_000, 400, 10_000, 5
# A change of a share that matters to the reader of the page.
DEFAULT_TOLERANCE = 0.05
EXPECTED = {
    'parts': 'the name of a part, a mesh file or a list of them',
    'surface': 'the name of a surface',
    'conditions': 'a mapping of conditions to numbers, or texts with a unit',
    'vary': 'a mapping of factors to ranges',
    'design': f'one of {", ".join(DESIGNS)}',
    'points': 'a number of points',
}


@dataclass(frozen=True, eq=False)
class StudySpec:
    """Parts, factors, design and drops of a study.

    base : Setting
        What is simulated, but for the factors.
    design : str
        One of DESIGNS.
    points : int
        Number of base points; see `make_design`.
    drops : int
        Number of drops at each point; with an action, of actions from each aspect. 0: as many as
        ALL_DROPS allow.
    tolerance : float
        Change of a share that matters.

    Raises
    ------
    InvalidValueError
        If a value is out of bounds.
    """

    parts: tuple[Part, ...]
    base: Setting
    factors: tuple[Factor, ...]
    design: str = DEFAULT_DESIGN
    points: int = DEFAULT_POINTS
    drops: int = 0
    seed: int = DEFAULT_SEED
    tolerance: float = DEFAULT_TOLERANCE
    confidence: float = CONFIDENCE

    def __post_init__(self) -> None:
        check_factors(self.factors, self.base, self.parts)
        check_seed(self.seed)
        check_confidence(self.confidence)
        if not isinstance(self.tolerance, int | float) or not 0 < self.tolerance < 1:
            raise InvalidValueError(
                f'invalid tolerance {shown(self.tolerance)}: expected more than 0 and less than 1'
            )
        count = len(self.made_design().points)
        if self.drops == 0 and type(self.drops) is int:
            each = min(max(ALL_DROPS // count, MIN_DROPS), MAX_DROPS)
            each //= 1 if self.base.action is None else ACTIONS
            object.__setattr__(self, 'drops', each)
        check_drops(self.drops)

    def made_design(self) -> Design:
        """Return the points and lines; raises InvalidValueError."""
        return make_design(self.design, self.factors, self.points, self.seed)

    def write(self, folder: Path) -> None:
        """Write the parts and study.yaml, but not over one written by hand; raises OutputError."""
        path = folder / SPEC
        if path.is_file() and not path.read_bytes().startswith(WRITTEN.encode()):
            return
        document = {
            'parts': [save_part(part, folder) for part in self.parts],
            **self.base.document,
            'vary': {factor.name: factor.document for factor in self.factors},
            'design': self.design,
            'points': self.points,
            'drops': self.drops,
            'seed': self.seed,
            'tolerance': self.tolerance,
            'confidence': self.confidence,
            'part_sha256': [part.part_sha256 for part in self.parts],
            'versions': worker_versions(),
        }
        with whole_file(path) as file:
            file.write_text(WRITTEN + NOTE + yaml_text(document), encoding='utf-8')


class StudyFile(FileModel):
    """The file study.yaml; see StudySpec, which checks the bounds of the numbers."""

    parts: StrictStr | list[StrictStr]
    surface: StrictStr = ''
    conditions: dict[StrictStr, Number | StrictStr] | None = None
    surroundings: Any = None
    action: Any = None
    vary: dict[StrictStr, Any]
    design: Literal['curves', 'factorial'] = 'curves'
    points: StrictInt = DEFAULT_POINTS
    drops: StrictInt | None = None
    seed: StrictInt = DEFAULT_SEED
    tolerance: Number = DEFAULT_TOLERANCE
    confidence: Number = CONFIDENCE
    # What a study was made with.
    versions: Any = None
    part_sha256: Any = None


def read_spec(
    path: Path, changes: Mapping[str, Any] | None = None, surfaces: Surfaces | None = None
) -> StudySpec:
    """Read a study from a file; ``changes`` replace its values. Raises InvalidValueError.

    The surface is one of ``surfaces``, by default of the suite.
    """
    document = read_yaml(path, 'study')
    with located(named('study', path)):
        if not isinstance(document, dict):
            raise InvalidValueError('expected a mapping with parts and vary')
        given = validated(StudyFile, {**document, **(changes or {})}, expected=EXPECTED)
        base = read_setting(
            given.surface,
            given.conditions or {},
            given.surroundings,
            given.action,
            path.parent,
            surfaces,
        )
        if given.drops is not None:
            check_drops(given.drops)
        return StudySpec(
            tuple(load_parts(given.parts, path.parent)),
            base,
            tuple(read_factor(name, each, base) for name, each in given.vary.items()),
            given.design,
            given.points,
            given.drops or 0,
            given.seed,
            given.tolerance,
            given.confidence,
        )


@dataclass(frozen=True, eq=False)
class StudyResult(Result):
    """The counts of a study, and what they depend on.

    Attributes
    ----------
    spec : StudySpec
        Parts, factors, design and drops.
    design : Design
        Points in the unit cube, and lines along each factor; see ``values``.
    cases : tuple of Case
        Counts by part and, for actions, by the class from which they start.
    complete : bool
        Whether all drops are made, except at impossible points.
    """

    spec: StudySpec
    design: Design
    cases: tuple[Case, ...]
    complete: bool

    @property
    def values(self) -> list[dict[str, float]]:
        """Values of the factors at each point, SI units."""
        return point_values(self.spec.factors, self.design.points)

    @cached_property
    def effects(self) -> list[Effects | None]:
        """Curves, Sobol indices and largest changes of each case; None if nothing can vary."""
        found: list[Effects | None] = [None] * len(self.cases)
        for k, case in enumerate(self.cases):
            with analysis(f'what the shares of {case.name} depend on'):
                found[k] = effects_of(case, self.design, self.spec.seed, self.spec.confidence)
        return found

    @cached_property
    def findings(self) -> list[Finding]:
        """What each factor does to each case, and whether measuring it is worth while."""
        spec = self.spec
        return [
            finding
            for case, effects in zip(self.cases, self.effects, strict=True)
            for finding in findings_of(
                case, effects, self.design, spec.factors, spec.tolerance, spec.confidence
            )
        ]

    def model_ranges(self, case: Case) -> Array | None:
        """Return where the shares of a case are on a real surface, (m, c, 2) by symmetry class.

        The conditions of each point are taken as exact. None if it is not known; see
        `Setting.no_model_range`.
        """
        if self.spec.base.no_model_range:
            return None
        counts = case.classes
        drops = np.repeat(case.drops, counts.shape[1])
        found = model_bounds(counts.ravel(), drops, 0.0, self.spec.confidence)
        return found.reshape(*counts.shape, 2)

    @property
    def rows(self) -> Iterator[dict[str, Any]]:
        """Rows of the table of results: one for each point, case and class."""
        values = self.values
        for case in self.cases:
            table = np.column_stack([case.classes, case.other.sum(axis=1)])
            lower, upper = bounds(table, case.drops, confidence=self.spec.confidence)
            ranges = self.model_ranges(case)
            names = [*case.class_names, 'elsewhere']
            for point, count in np.ndindex(table.shape):
                drops = int(case.drops[point])
                low, high = None, None
                if ranges is not None and drops and count < len(case.class_names):
                    low, high = ranges[point, count].tolist()
                yield {
                    'point': point,
                    **values[point],
                    'part': case.part.name,
                    'from_class': case.start,
                    'aspects': names[count],
                    'class': count + 1 if count < len(names) - 1 else None,
                    'count': int(table[point, count]),
                    'drops': drops,
                    'probability': float(table[point, count] / drops) if drops else None,
                    'lower': float(lower[point, count]),
                    'upper': float(upper[point, count]),
                    'model_lower': low,
                    'model_upper': high,
                    'skipped': case.skipped.get(point, ''),
                }

    def save_tables(self, folder: str | Path) -> Path:
        """Write the rows as results.csv, and return its path; raises OutputError."""
        path = Path(folder) / CSV
        write_rows(path, list(self.rows))
        return path

    def page(self) -> 'Page':
        """Return a page with curves, indices and findings."""
        # This import takes about a second.
        from resting_aspects_ros.studies.pages import study_page

        return study_page(self, PAGE)


def study(
    parts: Part | str | Path | Sequence[Part | str | Path],
    vary: Mapping[str, Any],
    *,
    surface: str | DropConditions = DEFAULT_SURFACE,
    surroundings: str | Path | Surroundings | None = None,
    action: str | Action | NamedAction | None = None,
    design: str = DEFAULT_DESIGN,
    points: int = DEFAULT_POINTS,
    drops: int | None = None,
    seed: int = DEFAULT_SEED,
    tolerance: float = DEFAULT_TOLERANCE,
    confidence: float = CONFIDENCE,
    out: str | Path | None = None,
    workers: int | Workers | None = None,
    progress: Progress = False,
    stopped: Callable[[], bool] = never,
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
    action : str, Action or NamedAction, optional
        Do this to parts at rest in each aspect, instead of dropping them.
    design : str
        'curves' (over each factor, from each base point) or 'factorial'.
    points : int
        Number of base points; a factorial design has none.
    drops : int, optional
        Number of drops at each point; with an action, of actions from each aspect. By default
        about 120,000 drops, or 24,000 actions from each aspect, are divided among the points.
    seed : int
        Seed of the design and of the drops.
    tolerance : float
        Change of a share that matters to you, for the verdict in `StudyResult.findings`.
    confidence : float
        Confidence of the intervals.
    out : str or Path, optional
        Folder of the study. Points that are finished there are not simulated again.
    workers, progress, stopped
        As for `drop`.
    **conditions : float
        Conditions that differ from the surface, in SI units.

    Raises
    ------
    InvalidValueError
        A value is out of bounds, a name is not known, or the points in the folder were made with
        other versions.
    EngineError
        Worker processes of Bullet cannot be started, or died repeatedly.
    OutputError
        A file cannot be written, for example because the disk is full. Finished points are kept.

    Examples
    --------
    >>> import resting_aspects_ros as ra
    >>> result = ra.study('cylinder_d20_h20', {'restitution': '0.2:0.6:4'}, drops=50)
    >>> result.cases[0].drops.tolist()
    [50, 50, 50, 50]
    """
    base = given_setting(surface, conditions, surroundings, action)
    if drops is not None:
        check_drops(drops)
    spec = StudySpec(
        tuple(load_parts(parts)),
        base,
        tuple(read_factor(name, each, base) for name, each in vary.items()),
        design,
        points,
        drops or 0,
        seed,
        tolerance,
        confidence,
    )
    folder = None if out is None else Path(out)
    return run_study(spec, folder, workers=workers, progress=progress, stopped=stopped)


def run_study(
    spec: StudySpec,
    folder: Path | None,
    *,
    workers: int | Workers | None = None,
    progress: Progress = False,
    stopped: Callable[[], bool] = never,
) -> StudyResult:
    """Make a study or continue it; see study."""
    if folder is not None:
        make_folder('--out', folder)
    store = PointStore(folder and folder / STORE, worker_versions())
    if folder is not None:
        spec.write(folder)
    made = spec.made_design()
    settings = [spec.base.at(each) for each in point_values(spec.factors, made.points)]
    with given_workers(workers) as pool:
        make = partial(_made, spec.seed, store, pool, progress, stopped)
        simulations = [Simulation.of(part, pool) for part in spec.parts]
        wanted = [[_Wanted(each, at, spec.drops) for at in settings] for each in simulations]
        found = make('points', wanted)
        complete = _complete(found)
        pairs = [
            (simulation, case)
            for simulation, own in zip(simulations, found, strict=True)
            for case in _cases(simulation, own, acted=spec.base.action is not None)
        ]
        cases = [case for _, case in pairs]
        if complete:
            drops, points = FRESH_DROPS * spec.drops, [fresh_points(each, made) for each in cases]
            wanted = [
                [_Wanted(each, settings[k], drops, case.start_ids, 'fresh') for k in own]
                for (each, case), own in zip(pairs, points, strict=True)
            ]
            found = make('points, fresh drops', wanted)
            complete = _complete(found)
            cases = [
                replace(case, fresh=_fresh(case, dict(zip(own, counts, strict=True))))
                for case, own, counts in zip(cases, points, found, strict=True)
            ]
    return StudyResult(spec, made, tuple(cases), complete)


@dataclass(frozen=True, eq=False)
class _Wanted:
    """Drops of a part, or actions from each of some aspects, by default of all.

    setting : Setting or str
        A text is the reason why it is impossible.
    purpose : str
        Drops for another purpose are independent.
    """

    simulation: Simulation
    setting: Setting | str
    drops: int
    ids: tuple[int, ...] = ()
    purpose: str = ''

    def key(self, seed: int) -> str:
        """Return what determines the counts, but for the number of drops."""
        assert isinstance(self.setting, Setting)
        key = point_key(self.simulation.part, self.setting)
        words = [str(seed), key, self.purpose, '-'.join(map(str, self.ids))]
        return ' '.join(filter(None, words))

    @property
    def total(self) -> int:
        """Number of drops, or of actions from all aspects together."""
        if isinstance(self.setting, str) or self.setting.action is None:
            return self.drops
        return self.drops * (len(self.ids) or len(self.simulation.aspects))

    def counts(self, seed: int, monitor: Monitor) -> Counts:
        """Return counts (r, k + 5) of drops, r = 1, or of actions from each aspect."""
        assert isinstance(self.setting, Setting)
        own = point_seed(seed, self.simulation.part, self.setting, self.purpose)
        if self.setting.action is None:
            return self.simulation.dropped(self.setting, self.drops, own, monitor)[None]
        return self.simulation.acted(self.setting, self.drops, own, monitor, self.ids)


_Found = list[list[Counts | str | None]]


def _made(
    seed: int,
    store: PointStore,
    workers: Workers,
    progress: Progress,
    stopped: Callable[[], bool],
    label: str,
    wanted: Sequence[Sequence[_Wanted]],
) -> _Found:
    """Simulate and store what is missing.

    Returns the counts (r, k + 5) of each, why it is impossible, or None if it was stopped.
    """
    found: _Found = [
        [
            w.setting if isinstance(w.setting, str) else store.counts(w.key(seed), w.drops)
            for w in own
        ]
        for own in wanted
    ]
    places = [(j, k) for j, own in enumerate(found) for k, each in enumerate(own) if each is None]
    missing = [wanted[j][k] for j, k in places]
    total = sum(w.total for w in missing)
    known = 'missing ' if len(missing) < sum(map(len, wanted)) else ''
    label = f'{len(missing)} {known}{label}'
    with DropProgress(label, total, shown=total > 0 and progress) as bar:
        made = run_tasks(
            [partial(w.counts, seed) for w in missing],
            workers,
            bar.update,
            stopped,
            lambda k, counts: store.add(missing[k].key(seed), missing[k].drops, counts),
        )
        bar.end(bar.done)
    for (j, k), counts in zip(places, made, strict=True):
        found[j][k] = counts
    return found


def _complete(found: _Found) -> bool:
    return not any(each is None for own in found for each in own)


def _cases(
    simulation: Simulation, found: Sequence[Counts | str | None], *, acted: bool
) -> Iterator[Case]:
    """Yield the counts of a part at all points, by the class from which actions start."""
    part, aspects, k = simulation.part, simulation.aspects, len(simulation.aspects)
    counts = counted(found, k if acted else 1, k + len(OUTSIDE))
    classes, other = counts_by_class(aspects, counts[..., :k]), counts[..., k:]
    skipped = reasons(found)
    if not acted:
        yield Case(part, aspects, classes[:, 0], other[:, 0], skipped=skipped)
        return
    for number, members in enumerate(aspects.classes(), 1):
        own = [aspect.id - 1 for aspect in members]
        ends = classes[:, own].sum(axis=1), other[:, own].sum(axis=1)
        yield Case(part, aspects, *ends, number, skipped)


def _fresh(case: Case, found: Mapping[int, Counts | str | None]) -> dict[int, Counts]:
    """Return counts (r, k + 5) at points as counts (c + 1,) by class, and elsewhere."""
    k, fresh = len(case.aspects), {}
    for point, counts in found.items():
        # In surroundings, an aspect in which no drop ends has no actions.
        if isinstance(counts, np.ndarray) and counts.any():
            total = counts.sum(axis=0)
            fresh[point] = np.append(counts_by_class(case.aspects, total[:k]), total[k:].sum())
    return fresh
