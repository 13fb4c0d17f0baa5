"""The best conditions that a search found: their document, tables and sentences."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from resting_aspects_ros.api.conditions import conditions_text, scene_of
from resting_aspects_ros.api.result import Result, write_rows
from resting_aspects_ros.arrays import Array, Counts
from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.document import SCHEMA_VERSION, plain
from resting_aspects_ros.report.drops import MODEL_RANGE
from resting_aspects_ros.report.format import interval_text, list_text
from resting_aspects_ros.report.table import Table
from resting_aspects_ros.simulation.conditions import BULLET, KERNEL
from resting_aspects_ros.simulation.job import engine_version
from resting_aspects_ros.statistics.intervals import Interval
from resting_aspects_ros.statistics.model_range import model_bounds
from resting_aspects_ros.studies.design import Factor, Setting
from resting_aspects_ros.studies.effects import homogeneity
from resting_aspects_ros.studies.objective import DRAWS, Advantage, Estimated, Objective, estimated

if TYPE_CHECKING:
    from resting_aspects_ros.report.page import Page

PAGE = 'report.html'
# A factor has no effect that can be shown if the p value of its test is larger.
SIGNIFICANCE = 0.05
# The best value is at a bound if it is this close to it, relative to the range.
AT_BOUND = 0.01
# Values that belong to a pair of materials.
MATERIAL = ('restitution', 'friction', 'rolling_friction', 'spinning_friction')


@dataclass(frozen=True, eq=False)
class Candidate:
    """Conditions that are compared.

    setting : Setting
    values : dict of str to float or None
        Values of the factors, SI units; None for a default of the surroundings.
    point : (d,) float or None
        The same from 0 to 1; None outside the ranges.
    counts : (c,) int
        Drops by outcome: the groups of the objective, then all other ends.
    estimate : Estimated
        The value of the objective, by these drops.
    """

    setting: Setting
    values: Mapping[str, float | None]
    point: Array | None
    counts: Counts
    estimate: Estimated

    @property
    def drops(self) -> int:
        """Number of drops."""
        return int(self.counts.sum())

    @property
    def document(self) -> dict[str, Any]:
        """The conditions as plain JSON types."""
        action = self.setting.action
        return {
            'values': dict(self.values),
            'conditions': self.setting.drop_conditions.document(),
            'action': None if action is None else plain(action.values),
            'value': plain(self.estimate),
            'counts': self.counts.tolist(),
            'drops': self.drops,
        }


@dataclass(frozen=True, eq=False)
class FactorCurve:
    """The objective over one factor, while the others have their best values, by fresh drops.

    at : (l,) float
        Values of the factor from 0 to 1, ascending; the best one is among them.
    values, lower, upper : (l,) float
        Values of the objective with their credible intervals.
    flat : (float, float)
        Range of the values next to the best one at which less than the tolerance is lost. The
        whole range if no effect is shown.
    bound : int
        -1 or 1 if an effect is shown, and the lower or upper bound has the best value; else 0.
    p_value : float
        Of the test that the outcomes are the same for all values.
    """

    at: Array
    values: Array
    lower: Array
    upper: Array
    flat: tuple[float, float]
    bound: int
    p_value: float

    @property
    def matters(self) -> bool:
        """Whether an effect is shown."""
        return self.p_value < SIGNIFICANCE

    @property
    def change(self) -> float:
        """Largest difference between two values."""
        return float(np.ptp(self.values))

    def document(self, factor: Factor) -> dict[str, Any]:
        """Return the curve as plain JSON types, in SI units."""
        return {
            'flat': factor.values(np.array(self.flat)).tolist(),
            'at_bound': self.bound != 0,
            'change': self.change,
            'p_value': self.p_value,
            'curve': {
                'at': factor.values(self.at).tolist(),
                **{name: plain(getattr(self, name)) for name in ('values', 'lower', 'upper')},
            },
        }


def factor_curve(
    objective: Objective,
    at: Array,
    counts: Counts,
    best: float,
    rng: np.random.Generator,
    confidence: float,
) -> FactorCurve:
    """Return the curve of a factor, by counts (l, c) at its values ``at`` (l,), one of them best.

    That the outcomes differ is shown by a chi-square test.
    """
    order = np.argsort(at)
    at, counts = at[order], counts[order]
    found = [estimated(objective.posterior(row, rng, DRAWS), confidence) for row in counts]
    values = np.array([each.value for each in found])
    score, p_value = objective.sign * values, homogeneity(counts)
    flat, bound = (0.0, 1.0), 0
    if p_value < SIGNIFICANCE:
        k = int(np.abs(at - best).argmin())
        lost = np.flatnonzero(score[k] - score > objective.tolerance)
        low = int(max(lost[lost < k], default=-1)) + 1
        high = int(min(lost[lost > k], default=len(at))) - 1
        flat = float(at[low]), float(at[high])
        place = at[score.argmax()]
        bound = int(place >= 1 - AT_BOUND) - int(place <= AT_BOUND)
    return FactorCurve(
        at,
        values,
        np.array([each.lower for each in found]),
        np.array([each.upper for each in found]),
        flat,
        bound,
        p_value,
    )


@dataclass(frozen=True, eq=False)
class OptimiseResult(Result):
    """The best conditions within ranges, and how certain the answer is.

    Attributes
    ----------
    part : Part
    aspects : AspectSet
    objective : Objective
    factors : tuple of Factor
    curves : tuple of FactorCurve
        For each factor, how flat the optimum is and whether the factor matters; empty if stopped.
    candidates : tuple of Candidate
        The conditions that are compared by fresh drops, those with the best value first: the best
        ones of the search, the best ones that differ from these by a fifth of a range, and those
        from which the search started. If these are outside the ranges, they are last.
    start : Candidate or None
        The conditions from which the search started; None if they are impossible.
    gains : tuple of Advantage
        By how much the first candidate is better than each other one, by fresh drops.
    certainty : float
        Posterior probability that it is better than all of them; NaN without fresh drops.
    points : list of (dict of str to float, (c,) int)
        Points of the search: values of the factors, SI units, and counts.
    skipped : list of (dict of str to float, str)
        Impossible points, and why.
    budget, drops : int
        Drops that were allowed, and that were made.
    complete : bool
        Whether all drops were made. Without fresh drops, the values of the candidates are those of
        the search.
    """

    part: Part
    aspects: AspectSet
    objective: Objective
    factors: tuple[Factor, ...]
    curves: tuple[FactorCurve, ...]
    candidates: tuple[Candidate, ...]
    start: Candidate | None
    gains: tuple[Advantage, ...]
    certainty: float
    points: Sequence[tuple[Mapping[str, float], Counts]]
    skipped: Sequence[tuple[Mapping[str, float], str]]
    budget: int
    drops: int
    complete: bool
    confidence: float
    seed: int

    @property
    def best(self) -> Candidate:
        """The best conditions."""
        return self.candidates[0]

    @property
    def second(self) -> Candidate | None:
        """The other conditions that the search found; None if there are none."""
        others = [each for each in self.candidates[1:] if each is not self.start]
        return others[0] if others else None

    @property
    def winner(self) -> bool:
        """Whether the fresh drops show that the best conditions are better than the others.

        If all k candidates are equally good, each has this certainty with a probability of at most
        (1 - confidence) / k, so that there is a winner with at most 1 - confidence.
        """
        return self.certainty >= 1 - (1 - self.confidence) / len(self.candidates)

    @property
    def aim(self) -> str:
        """What was sought, such as 'largest share of aspect 1 after one tap'."""
        action = self.best.setting.action
        if action is None:
            return self.objective.text
        return f'{self.objective.text} after one {action.name} on parts that were dropped'

    @property
    def engine(self) -> str:
        """What simulates the best conditions: Bullet at an edge or a mesh, or the kernel."""
        setting = self.best.setting
        scene = scene_of(self.part, setting.drop_conditions)
        edge = setting.action is not None and setting.action.action.edge is not None
        return BULLET if edge or not scene.flat else KERNEL

    def model_range(self, candidate: Candidate) -> Interval | None:
        """Return where the share of a candidate is on a real surface; None if it is not known."""
        if self.objective.is_entropy or candidate.setting.no_model_range:
            return None
        counts = candidate.counts[:1]
        ((low, high),) = model_bounds(counts, candidate.drops, 0.0, self.confidence).tolist()
        return Interval(candidate.estimate.value, low, high)

    @property
    def range_text(self) -> str:
        """What the model ranges cover, or why there are none."""
        if self.objective.is_entropy:
            return 'No model range: it is known for shares, and not for the entropy.'
        return self.best.setting.range_text

    def over(self, other: Candidate | None) -> Advantage | None:
        """Return by how much the best conditions are better than others; None if not known."""
        gains = dict(zip(map(id, self.candidates[1:]), self.gains, strict=False))
        return gains.get(id(other))

    @property
    def notes(self) -> list[str]:
        """Sentences that state how certain the answer is, and what limits it."""
        return [
            *_comparison_notes(self),
            self.range_text,
            *_factor_notes(self),
            *_limit_notes(self),
        ]

    def document(self) -> dict[str, Any]:
        """Return the result as plain JSON types, in SI units."""
        curves = self.curves or [None] * len(self.factors)
        compared = {'best': self.best, 'second': self.second, 'start': self.start}
        return {
            'schema_version': SCHEMA_VERSION,
            'part': self.part.name,
            'part_sha256': self.part.part_sha256,
            'aim': self.aim,
            'wanted': list(self.objective.wanted),
            'outcomes': [list(ids) for ids in self.objective.groups],
            'unit': 'nat' if self.objective.is_entropy else '',
            'factors': [
                {'name': factor.name, **factor.document, 'unit': factor.unit}
                | ({} if own is None else own.document(factor))
                for factor, own in zip(self.factors, curves, strict=True)
            ],
            **{name: self._compared_document(c) for name, c in compared.items()},
            'over_second': plain(self.over(self.second)),
            'over_start': plain(self.over(self.start)),
            'certainty': plain(self.certainty),
            'winner': self.winner,
            'notes': self.notes,
            'points': [
                {'values': dict(values), 'counts': counts.tolist()}
                for values, counts in self.points
            ],
            'skipped': [{'values': dict(v), 'reason': reason} for v, reason in self.skipped],
            'budget': self.budget,
            'drops': self.drops,
            'complete': self.complete,
            'confidence': self.confidence,
            'seed': self.seed,
            'engine': self.engine,
            'engine_version': engine_version(self.engine),
        }

    def _compared_document(self, candidate: Candidate | None) -> dict[str, Any] | None:
        if candidate is None:
            return None
        model = self.model_range(candidate)
        low, high = (None, None) if model is None else (model.lower, model.upper)
        return {**candidate.document, 'model_lower': low, 'model_upper': high}

    def save_csv(self, path: str | Path) -> None:
        """Write the points of the search as CSV, in SI units."""
        outcomes = ['+'.join(map(str, ids)) for ids in self.objective.groups]
        names = [*outcomes, 'other']
        rows = [
            {**values, **dict(zip(names, counts.tolist(), strict=True))}
            for values, counts in self.points
        ]
        write_rows(Path(path), rows)

    def page(self) -> 'Page':
        """Return a page with the objective over each factor."""
        # This import takes about a second.
        from resting_aspects_ros.studies.pages import optimise_page

        return optimise_page(self, PAGE)

    def candidate_table(self) -> Table:
        """Return the table of the conditions that are compared."""
        yours = self.start or self.best
        base = conditions_text(yours.setting.drop_conditions)
        headings = (
            'conditions',
            *(factor.label or factor.name for factor in self.factors),
            'entropy' if self.objective.is_entropy else 'share',
            f'{100 * self.confidence:g} % interval',
            *([MODEL_RANGE] if self.model_range(yours) else []),
            'drops',
        )
        title = f'{self.part.name}: {self.aim}\nyour conditions: {base}'
        table = Table(title, headings, texts={'conditions'})
        rows = {'best': self.best, 'second': self.second, 'yours': self.start}
        for name, candidate in rows.items():
            if candidate is None:
                continue
            values = [candidate.values[factor.name] for factor in self.factors]
            number, value = self.objective.number, candidate.estimate
            table.add_row(
                'best, no winner' if name == 'best' and not self.winner else name,
                *(
                    '' if v is None else f.text(v)
                    for v, f in zip(values, self.factors, strict=True)
                ),
                number(value.value),
                f'{number(value.lower).split()[0]} to {number(value.upper)}',
                *(
                    []
                    if (model := self.model_range(candidate)) is None
                    else [interval_text(model)]
                ),
                str(candidate.drops),
            )
        return table

    def factor_table(self) -> Table:
        """Return the table of the factors: range, flat range and largest change."""
        difference = self.objective.difference
        within = difference(self.objective.tolerance).replace('1.0 points', '1 point')
        headings = ('factor', 'searched', f'within {within}', 'largest change')
        title = 'what the factors do at the best conditions'
        table = Table(title, headings, texts={'factor'})
        for factor, curve in zip(self.factors, self.curves, strict=False):
            low, high = factor.values(np.array(curve.flat)).tolist()
            table.add_row(
                factor.label or factor.name,
                f'{factor.text(factor.low)} to {factor.text(factor.high)}',
                f'{factor.text(low)} to {factor.text(high)}',
                difference(curve.change) if curve.matters else 'not shown',
            )
        return table


def certainty_text(certainty: float) -> str:
    """Return a probability as text; it is never rounded to 0 or 100 %."""
    if certainty > 0.999:
        return 'more than 99.9 %'
    return 'less than 0.1 %' if certainty < 0.001 else f'{100 * certainty:.1f} %'


def _comparison_notes(result: OptimiseResult) -> Iterator[str]:
    """Say how the best conditions compare with the others."""
    if not result.gains:
        return
    if not result.winner:
        yield (
            'No winner: the probability that the best conditions are better than all others that '
            f'were compared is {certainty_text(result.certainty)}.'
        )
    if result.best is result.start:
        yield 'Your conditions have the best value of those that were compared.'
    for other, name in ((result.second, 'the second conditions'), (result.start, 'yours')):
        found = result.over(other)
        if found is not None:
            yield _against(found, result.objective, name)
    yield (
        f'These values are from {result.best.drops} fresh drops for each of the conditions. The '
        'drops that selected the best conditions are not among them, so that the values are not '
        'those of the luckiest point.'
    )


def _against(found: Advantage, objective: Objective, other: str) -> str:
    """Return how the best conditions compare with others."""
    low, high = found.gain.lower, found.gain.upper
    if low > 0 or high < 0:
        ends = sorted((abs(low), abs(high)))
        span = f'{objective.difference(ends[0]).split()[0]} to {objective.difference(ends[1])}'
        better = 'better' if low > 0 else 'worse'
        return f'The best conditions in the ranges are {better} than {other} by {span}.'
    return (
        f'No difference is shown between the best conditions and {other}: it is at most '
        f'{objective.difference(max(high, -low))}, and the probability that the best ones are '
        f'better is {certainty_text(found.certainty)}.'
    )


def _factor_notes(result: OptimiseResult) -> Iterator[str]:
    """Say which values are at a bound, which effects are not shown, and which are materials."""
    known = list(zip(result.factors, result.curves, strict=False))
    for factor, curve in known:
        if curve.bound:
            end, value = ('lower', factor.low) if curve.bound < 0 else ('upper', factor.high)
            yield (
                f'The best {factor.name} is at the {end} bound of its range, '
                f'{factor.text(value)}: it may be better beyond.'
            )
    hidden = [factor for factor, curve in known if not curve.matters]
    if hidden:
        verb = 'has' if len(hidden) == 1 else 'have'
        yield f'{_names(hidden)} {verb} no effect that can be shown at the best conditions.'
    materials = [f for f in result.factors if f.name.rpartition('.')[2] in MATERIAL]
    if materials:
        verb = 'is a property' if len(materials) == 1 else 'are properties'
        yield (
            f'{_names(materials)} {verb} of the materials of part and surface: only another '
            'surface changes this.'
        )


def _names(factors: Sequence[Factor]) -> str:
    """Return names as they begin a sentence; those with a dot are kept as they are."""
    names = list_text([factor.name for factor in factors])
    return names if '.' in names else names[0].upper() + names[1:]


def _limit_notes(result: OptimiseResult) -> Iterator[str]:
    """Say what was skipped, and what is missing."""
    if result.skipped:
        yield (
            f'{len(result.skipped)} points were impossible and were skipped, the first because: '
            f'{result.skipped[0][1]}.'
        )
    if not result.complete:
        yield f'The search ended early, after {result.drops} of {result.budget} drops.'
    if not result.gains:
        yield (
            'The best conditions were not confirmed by fresh drops: their value is that of the '
            'drops that selected them, and is probably too good.'
        )
    elif result.start is None:
        yield 'Your conditions are impossible themselves, and were not compared.'
