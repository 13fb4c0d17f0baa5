"""Calibrate a surface to counts: the drops, and the result with its texts and its picture."""

import dataclasses
import math
import textwrap
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from resting_aspects_ros.api.conditions import surface_entry
from resting_aspects_ros.api.result import Result
from resting_aspects_ros.api.runner import DropProgress, Progress, given_workers, never
from resting_aspects_ros.arrays import Array, Counts
from resting_aspects_ros.aspects.landscape import Landscape
from resting_aspects_ros.errors import InvalidValueError, StoppedError
from resting_aspects_ros.report.figure import TEXT, new_figure, plain_axes
from resting_aspects_ros.simulation.conditions import (
    DEFAULT_SEED,
    QUANTITIES,
    DropConditions,
    check_integer,
    check_seed,
)
from resting_aspects_ros.simulation.workers import Workers
from resting_aspects_ros.studies.calibration.counts_file import (
    SurfaceCounts,
    make_surface_counts,
    read_surface_counts,
)
from resting_aspects_ros.studies.calibration.posterior import (
    REPEATED,
    ROUNDS,
    Estimate,
    Fit,
    FitTest,
    Prediction,
    correlation,
    find_discrepancy,
    find_estimates,
    find_fit_test,
    fit_surface,
    predict,
)
from resting_aspects_ros.studies.design import Setting, point_values
from resting_aspects_ros.studies.points import Simulation as PartSimulation
from resting_aspects_ros.studies.points import Task, reasons, run_tasks

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Points of the first round for each fitted condition, and bounds of their number.
POINTS_PER_FACTOR, MIN_POINTS, MAX_POINTS = 32, 8, 1024
# Simulated drops of a part at each point: as many as were counted, within bounds. All points
# together determine the shares, so that they add little to the variance of the counts.
MIN_DROPS, MAX_DROPS = 100, 300
SCHEMA_VERSION = 5
# Draws of the posterior in the document, and in a surfaces file.
DRAWS, SAMPLES = 200, 64
# Below this probability, the counts are said to contradict every surface.
SIGNIFICANCE = 0.05
# Factors are said to trade off if their correlation is at least this.
TRADE_OFF = 0.5
# An interval is cut off if it ends within this share of its range.
NEAR_END = 0.02
WIDTH = 80

REGIONS = (0.9, 0.5)
FILL = ('#C9DCF2', '#5B93D0')  # of the outer and the inner region
CELLS, SMOOTH = 40, 1.5  # of the picture of a pair, in each direction, and their smoothing
MAX_PAIRS = 6
PANEL = 2.9  # side of a region, inches


def calibrate(
    counts: str | Path | Mapping[str, Any],
    *,
    points: int | None = None,
    drops: int | None = None,
    discrepancy: bool = True,
    seed: int = DEFAULT_SEED,
    workers: int | Workers | None = None,
    progress: Progress = False,
    stopped: Callable[[], bool] = never,
) -> 'CalibrationResult':
    """Find the restitution and the friction of a surface from parts that were counted on it.

    Parts are dropped in the simulation at points that fill the ranges of the conditions, then
    where the counts are probable, and at last at the most probable conditions, as a check.

    Parameters
    ----------
    counts : str, Path or mapping
        A counts file, or its content; see docs/reference/files.md. Paths of meshes in a mapping
        are relative to the current folder.
    points : int, optional
        Number of points of the first round, and twice that of each of two further ones; 32 for
        each fitted condition.
    drops : int, optional
        Number of drops of each part at each point; as many as were counted, but 100 to 300.
    discrepancy : bool
        Whether real parts may deviate from the simulation beyond sampling. False only for counts
        that were simulated.
    seed : int
        Of the drops, and of all random numbers.
    workers : int or Workers, optional
        Number of workers, one for each core by default; or workers to use.
    progress : bool or callable
        As for `drop`.
    stopped : callable
        Ends early if it returns True: the result is that of the rounds that are complete.

    Returns
    -------
    CalibrationResult

    Raises
    ------
    InvalidValueError
        The counts name unknown aspects or do not add up, or a value is out of bounds.
    PartError, UnknownPartError
        A part cannot be used.
    EngineError
        Workers died repeatedly.
    StoppedError
        It was stopped before the first round was complete.

    Examples
    --------
    >>> import resting_aspects_ros as ra
    >>> counts = {
    ...     'surface': 'oak_table',
    ...     'conditions': {'height': '100 mm'},
    ...     'parts': [{'box': [20, 20, 15], 'counts': {'z': 109, 'rest': 91}}],
    ... }
    >>> result = ra.calibrate(counts, points=8, drops=25)
    >>> [each.factor.name for each in result.estimates]
    ['restitution', 'friction']
    """
    check_seed(seed)
    if points is not None:
        check_integer('points', points, MIN_POINTS, MAX_POINTS)
    if drops is not None:
        check_integer('drops', drops, 1, 1_000_000)
    given = given_counts(counts)
    count = points or POINTS_PER_FACTOR * len(given.factors)
    per_point = [drops or min(max(each.drops, MIN_DROPS), MAX_DROPS) for each in given.parts]
    total = sum(per_point) * (count + ROUNDS * (count // 2) + REPEATED)
    with (
        given_workers(workers) as pool,
        DropProgress(given.surface, total, shown=progress) as bar,
    ):
        simulate = Simulation(given, per_point, seed, pool, bar.update, stopped)
        fit = fit_surface(given, simulate, points=count, seed=seed, discrepancy=discrepancy)
        if fit is None:
            raise StoppedError('interrupted in the first round of drops: there is no result')
        bar.end(simulate.made)
    return summarise(fit, seed)


def summarise(fit: Fit, seed: int) -> 'CalibrationResult':
    """Return the result of a fit, with its checks."""
    rng = np.random.default_rng((seed, 1))
    return CalibrationResult(
        fit,
        tuple(find_estimates(fit)),
        tuple(predict(fit, rng)),
        tuple(predict(fit, rng, left_out=True)),
        find_fit_test(fit, rng),
        seed,
    )


def given_counts(counts: str | Path | Mapping[str, Any]) -> SurfaceCounts:
    """Return the counts of a file or a mapping."""
    if isinstance(counts, Mapping):
        return make_surface_counts(counts, Path())
    return read_surface_counts(Path(counts))


@dataclass(eq=False)
class Simulation:
    """Drops the counted parts at points; the drops of a point do not depend on the others.

    per_point : sequence of int
        Number of drops of each part at each point.
    progress : callable
        Called with the number of all drops made so far.
    """

    given: SurfaceCounts
    per_point: Sequence[int]
    seed: int
    workers: Workers
    progress: Callable[[int], None] = lambda _: None
    stopped: Callable[[], bool] = never
    made: int = 0

    def __post_init__(self) -> None:
        self._parts = [
            PartSimulation(each.part, self.workers, Landscape(each.part), each.aspects)
            for each in self.given.parts
        ]

    def __call__(self, points: Array) -> list[Counts] | None:
        """Return the counts (m, g) of each part at points (m, d); None if it was stopped.

        Drops that ended in no aspect are left out. Raises InvalidValueError if a part cannot be
        dropped at one of the points.
        """
        tasks = [task for k in range(len(self._parts)) for task in self._tasks(k, points)]
        found = run_tasks(
            tasks, self.workers, lambda done: self.progress(self.made + done), self.stopped
        )
        for index, reason in reasons(found).items():
            name = self.given.parts[index // len(points)].name
            raise InvalidValueError(
                f'{name}: {reason}; expected ranges in which all parts can be dropped'
            )
        if self.stopped():
            return None
        counts = []
        for k, part in enumerate(self.given.parts):
            own = np.array(found[k * len(points) : (k + 1) * len(points)])
            self.made += int(own.sum())
            counts.append(part.grouped(own))
        return counts

    def _tasks(self, k: int, points: Array) -> Iterator[Task]:
        """Yield the tasks of a part; those of equal points have other random numbers."""
        part, simulation = self.given.parts[k], self._parts[k]
        seen: Counter[bytes] = Counter()
        for point, conditions in zip(points, self.given.conditions(points, part), strict=True):
            before, setting = seen[point.tobytes()], Setting(conditions)
            seen[point.tobytes()] += 1
            purpose = f'repetition {before}' if before else ''
            yield partial(simulation.counts, setting, self.per_point[k], self.seed, purpose)


# -- The result -----------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class CalibrationResult(Result):
    """What counts say of a surface.

    Attributes
    ----------
    estimates : tuple of Estimate
        Value and uncertainty of each fitted condition.
    predictions : tuple of Prediction
        Of each part, from the counts of all parts.
    left_out : tuple of Prediction
        Of each part, from the counts of the others; empty if there is one part.
    test : FitTest
        Whether any surface in the ranges explains the counts.
    fit : Fit
    """

    fit: Fit
    estimates: tuple[Estimate, ...]
    predictions: tuple[Prediction, ...]
    left_out: tuple[Prediction, ...]
    test: FitTest
    seed: int

    @property
    def surface(self) -> str:
        """Name of the surface."""
        return self.fit.given.surface

    @property
    def conditions(self) -> DropConditions:
        """The most probable conditions, with SAMPLES draws as their uncertainty."""
        best = {each.factor.name: float(f'{each.best:.3g}') for each in self.estimates}
        fitted = self.fit.given.base.changed(**best)
        return dataclasses.replace(
            fitted, surface=self.surface, uncertainty=tuple(self.draws(SAMPLES))
        )

    @property
    def left_out_deviation(self) -> float:
        """Mean absolute deviation of the shares of parts that were left out; NaN for one part."""
        if not self.left_out:
            return math.nan
        return float(np.mean([each.deviation for each in self.left_out]))

    @property
    def check_deviation(self) -> float:
        """Largest difference between drops at the most probable conditions and interpolation."""
        return float(max((np.abs(each).max() for each in self.fit.deviations), default=math.nan))

    @property
    def contradicted(self) -> bool:
        """Whether no surface in the ranges explains the counts."""
        return self.test.p < SIGNIFICANCE

    def draws(self, size: int = DRAWS) -> list[dict[str, float]]:
        """Return conditions that are drawn from the posterior, as values of the factors."""
        points = self.fit.draws(size, np.random.default_rng(self.seed))
        return point_values(self.fit.given.factors, points)

    def document(self) -> dict[str, Any]:
        """Return everything as plain values; see docs/reference/files.md."""
        given, fit = self.fit.given, self.fit
        mean, low, high = find_discrepancy(fit)
        conditions = {name: getattr(self.conditions, name) for name in QUANTITIES}
        return {
            'schema_version': SCHEMA_VERSION,
            'surface': self.surface,
            'source': given.source,
            'way': given.way,
            'conditions': {**conditions, 'height_of': self.conditions.height_of.name},
            'estimates': [_estimate(each) for each in self.estimates],
            'discrepancy': {'mean': mean, 'low': low, 'high': high} if fit.discrepancy else None,
            'test': {'statistic': self.test.statistic, 'p': self.test.p},
            'contradicted': self.contradicted,
            'parts': [
                {
                    'name': part.name,
                    'part_sha256': part.part.part_sha256,
                    'groups': dict(zip(part.names, map(list, part.groups), strict=True)),
                    'counts': part.counts.tolist(),
                    'prediction': _prediction(self.predictions[k]),
                    'left_out': _prediction(self.left_out[k]) if self.left_out else None,
                }
                for k, part in enumerate(given.parts)
            ],
            'left_out_deviation': self.left_out_deviation if self.left_out else None,
            'simulated_drops': fit.simulated_drops,
            'points': len(fit.points),
            'check': None if fit.checked is None else self.check_deviation,
            'seed': self.seed,
            'draws': self.draws(),
        }

    def surface_entry(self, *, uncertainty: bool = True) -> str:
        """Return an entry for a surfaces file, with its source and perhaps its uncertainty."""
        samples = self.draws(SAMPLES) if uncertainty else []
        return surface_entry(self.surface, self.conditions, _source(self), samples)

    def figure(self) -> 'Figure':
        """Return the regions of the conditions."""
        return calibration_figure(self)

    def __str__(self) -> str:
        given = self.fit.given
        head = (
            f'{self.surface}: {len(given.parts)} part{"s" * (len(given.parts) > 1)}, '
            f'{given.drops} counted drops, {self.fit.simulated_drops} simulated drops at '
            f'{len(self.fit.points)} points'
        )
        lines = [head, '', *_estimate_table(self.estimates), '', *_share_table(self), '']
        for sentence in statements(self):
            lines += textwrap.wrap(sentence, WIDTH)
        return '\n'.join(lines)


def _estimate(each: Estimate) -> dict[str, Any]:
    values = {k: v for k, v in vars(each).items() if k != 'factor'}
    factor = each.factor
    return {
        'name': factor.name,
        'unit': factor.unit,
        'range': [factor.low, factor.high],
        'logarithmic': factor.logarithmic,
        **values,
    }


def _prediction(each: Prediction) -> dict[str, Any]:
    arrays = {k: v.tolist() for k, v in vars(each).items()}
    return {**arrays, 'deviation': each.deviation, 'inside': each.inside}


def _estimate_table(found: Sequence[Estimate]) -> Iterator[str]:
    yield f'{"condition":<26}{"best":>9}{"mean":>9}{"sd":>8}  {"90 % interval":<20}{"range"}'
    for each in found:
        factor = each.factor
        best, mean, deviation, low, high, least, most = (
            _number(factor.scale * value)
            for value in (
                *(each.best, each.mean, each.deviation, each.low, each.high),
                *(factor.low, factor.high),
            )
        )
        yield (
            f'{factor.title[:25]:<26}{best:>9}{mean:>9}{deviation:>8}  '
            f'{f"{low} to {high}":<20}{least} to {most}'
        )


def _share_table(result: CalibrationResult) -> Iterator[str]:
    yield f'{"part":<20}{"group":<12}{"counted":>8}{"fitted":>8}{"left out":>9}  90 % interval'
    for k, part in enumerate(result.fit.given.parts):
        fitted = result.predictions[k]
        left = result.left_out[k] if result.left_out else None
        interval = left or fitted
        for j in part.shown:
            yield (
                f'{part.name[:19] if j == 0 else "":<20}{part.names[j][:11]:<12}'
                f'{100 * fitted.counted[j]:>6.1f} %{100 * fitted.model[j]:>6.1f} %'
                + (f'{100 * left.model[j]:>7.1f} %' if left else f'{"":>9}')
                + f'  {100 * interval.low[j]:.1f} to {100 * interval.high[j]:.1f} %'
                + ('' if interval.low[j] <= fitted.counted[j] <= interval.high[j] else '  outside')
            )


def statements(result: CalibrationResult) -> list[str]:
    """Return what the counts say, and what they do not determine, one sentence each."""
    found = [
        *_on_agreement(result),
        *(_on_estimate(each) for each in result.estimates),
        *_on_ends(result.estimates),
        *_on_trade_offs(result),
    ]
    if result.left_out:
        inside = sum(each.inside for each in result.left_out)
        found.append(
            f'Parts that were left out are predicted with a mean absolute deviation of '
            f'{100 * result.left_out_deviation:.1f} points; {inside} of {len(result.left_out)} '
            'are within their 90 % intervals.'
        )
    if result.fit.checked is None:
        found.append('The most probable conditions were not checked by drops.')
    else:
        found.append(
            'Drops at the most probable conditions deviate from the interpolated shares by at '
            f'most {100 * result.check_deviation:.1f} points.'
        )
    return found


def _on_agreement(result: CalibrationResult) -> Iterator[str]:
    *most, last = (each.factor.label for each in result.estimates)
    fitted = f'{", ".join(most)} or {last}' if most else last
    deviating = ', deviating as measured bodies do' if result.fit.discrepancy else ''
    if not result.contradicted:
        yield f'The simulation can explain these counts{deviating} (p = {result.test.p:.2g}).'
    else:
        part = result.fit.given.parts[result.test.part]
        group = part.names[result.test.group]
        yield (
            f'No {fitted} within the ranges explain these counts{deviating} '
            f'(p = {result.test.p:.2g}), least of all the share of {group} of {part.name}: check '
            'the counts, the release and the ranges before using these values.'
        )
    # The counts of one part cannot tell the discrepancy.
    if result.fit.discrepancy and len(result.fit.given.parts) > 1:
        mean, low, high = find_discrepancy(result.fit)
        yield (
            f'Beyond sampling, a share of 50 % deviates from the simulation by {50 * mean:.1f} '
            f'points (standard deviation; 90 % interval {50 * low:.1f} to {50 * high:.1f}).'
        )


def _on_estimate(each: Estimate) -> str:
    factor = each.factor
    low, high = _number(each.low), _number(each.high)
    unit = f' {factor.unit}' if factor.unit else ''
    if each.determined:
        return f'The {factor.label} is {_number(each.mean)}{unit} (90 %: {low} to {high}).'
    return (
        f'These counts do not determine the {factor.label}: {low} to {high}{unit} fit about '
        'equally.'
    )


def _on_ends(found: Sequence[Estimate]) -> Iterator[str]:
    """Name determined conditions whose interval ends where their range does."""
    for each in found:
        factor = each.factor
        low, high = factor.shares(np.array([each.low, each.high])).tolist()
        if each.determined and (low < NEAR_END or high > 1 - NEAR_END):
            yield (
                f'The interval of the {factor.label} ends where its range does: if a wider range '
                f'of {factor.name} is possible, state it below conditions.'
            )


def _on_trade_offs(result: CalibrationResult) -> Iterator[str]:
    for i, j in _pairs(len(result.estimates)):
        value = correlation(result.fit, i, j) if i != j else 0.0
        if abs(value) >= TRADE_OFF:
            one, other = (result.estimates[k].factor.label for k in (i, j))
            yield (
                f'More {one} with {"more" if value > 0 else "less"} {other} fits as well '
                f'(correlation {value:+.2f}): use the pairs of the picture, not the intervals.'
            )


def _source(result: CalibrationResult) -> str:
    """Return the source of the surface: counts, uncertainty, and what was not determined."""
    given = result.fit.given
    names = ', '.join(part.name for part in given.parts[:5])
    if len(given.parts) > 5:
        names += f' and {len(given.parts) - 5} more'
    found = [f'Calibrated to {given.drops} counted drops of {names}.']
    if given.source:
        found.append(f'{given.source.rstrip(".")}.')
    return ' '.join([*found, *statements(result)])


def _number(value: float) -> str:
    return f'{value:.2g}' if abs(value) < 10 else f'{value:.0f}'


def _pairs(factors: int) -> list[tuple[int, int]]:
    """Return the pairs of factors; the single one with itself."""
    if factors == 1:
        return [(0, 0)]
    return [(i, j) for i in range(factors) for j in range(i + 1, factors)]


def calibration_figure(result: CalibrationResult) -> 'Figure':
    """Return the picture: the regions of pairs of conditions, or the density of a single one."""
    pairs = _pairs(len(result.estimates))[:MAX_PAIRS]
    columns = min(3, len(pairs))
    rows = -(-len(pairs) // columns)
    figure = new_figure(max(PANEL * columns, 5.0), 0.6 + PANEL * rows)
    figure.set_layout_engine('constrained', h_pad=0.1, w_pad=0.1)
    shown = 'probability density'
    if len(result.estimates) > 1:
        shown = 'regions with 50 and 90 % of the probability; cross: most probable'
    figure.suptitle(
        f'{result.surface}: conditions that fit {result.fit.given.drops} counted drops\n{shown}',
        color=TEXT,
        fontsize=9,
        x=0.02,
        ha='left',
    )
    for number, (i, j) in enumerate(pairs, start=1):
        _draw_region(figure.add_subplot(rows, columns, number), result, i, j)
    return figure


def _draw_region(axes: 'Axes', result: CalibrationResult, i: int, j: int) -> None:
    """Draw the regions of two conditions, or the density of a single one."""
    # These imports take about a second.
    from scipy.ndimage import gaussian_filter

    from resting_aspects_ros.studies.pages import factor_axis

    one, other = result.estimates[i].factor, result.estimates[j].factor
    fit, edges = result.fit, np.linspace(0, 1, CELLS + 1)
    points, weights = fit.candidates[:, [i, j]], fit.weights().sum(axis=0)
    nodes = (edges[1:] + edges[:-1]) / 2
    x, y = one.scale * one.values(nodes), other.scale * other.values(nodes)
    plain_axes(axes, 'y')
    factor_axis(axes, one)
    if i == j:
        density = np.histogram(points[:, 0], edges, weights=weights)[0]
        axes.fill_between(x, gaussian_filter(density, SMOOTH), color=FILL[1])
        axes.set_ylim(bottom=0)
        axes.set_yticks([])
        return
    density = np.histogram2d(points[:, 0], points[:, 1], [edges, edges], weights=weights)[0]
    density = gaussian_filter(density, SMOOTH)
    levels = [_level(density, region) for region in REGIONS]
    axes.contourf(x, y, density.T, [*levels, density.max() * 1.01], colors=FILL)
    best = one.scale * result.estimates[i].best, other.scale * result.estimates[j].best
    axes.plot(*best, '+', color=TEXT, markersize=9)
    factor_axis(axes, other, 'y')


def _level(density: Array, region: float) -> float:
    """Return the density in equal cells above which they have the probability ``region``."""
    ordered = np.sort(density.ravel())[::-1]
    place = int(np.searchsorted(np.cumsum(ordered), region * ordered.sum()))
    return float(ordered[min(place, len(ordered) - 1)])
