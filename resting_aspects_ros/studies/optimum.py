"""What is optimised, and the best conditions that a search found, with document and tables."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.special import entr

from resting_aspects_ros.api.conditions import conditions_text, scene_of
from resting_aspects_ros.api.result import Result, write_rows
from resting_aspects_ros.arrays import Array, Counts
from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.document import SCHEMA_VERSION, plain
from resting_aspects_ros.report.drops import MODEL_RANGE
from resting_aspects_ros.report.format import interval_text, list_text
from resting_aspects_ros.report.table import Table
from resting_aspects_ros.simulation.conditions import BULLET, KERNEL
from resting_aspects_ros.simulation.job import engine_version
from resting_aspects_ros.statistics.intervals import Interval, containing
from resting_aspects_ros.statistics.model_range import model_bounds
from resting_aspects_ros.studies.design import Factor, Setting

if TYPE_CHECKING:
    from resting_aspects_ros.report.page import Page

PAGE = 'report.html'
# The best value is at a bound if it is this close to it, relative to the range.
AT_BOUND = 0.01
# Pseudo-drops of the Dirichlet prior, divided among the outcomes: 1 drop in all (Perks 1947).
PRIOR = 1.0
# Draws of a posterior, for an interval.
DRAWS = 20_000


@dataclass(frozen=True)
class Objective:
    """The share of wanted aspects, which is maximised, or the entropy, which is minimised.

    wanted : tuple of int
        Ids of the wanted aspects, ascending; empty for the entropy.
    groups : tuple of tuple of int
        Ids of the aspects of each outcome that is distinguished: the wanted aspects, or the
        members of each symmetry class. All other ends of a drop are one more outcome, the last.
    """

    wanted: tuple[int, ...]
    groups: tuple[tuple[int, ...], ...]

    @property
    def is_entropy(self) -> bool:
        """Whether the entropy is minimised."""
        return not self.wanted

    @property
    def sign(self) -> float:
        """1 if more is better, otherwise -1."""
        return -1.0 if self.is_entropy else 1.0

    @property
    def text(self) -> str:
        """What is sought, such as 'largest share of aspects 1 and 3'."""
        if self.is_entropy:
            return 'least entropy over the symmetry classes'
        noun = 'aspect' if len(self.wanted) == 1 else 'aspects'
        return f'largest share of {noun} {list_text([str(k) for k in self.wanted])}'

    def columns(self, counts: Counts) -> Counts:
        """Return counts (c,) of the outcomes, from counts (k + 5,) by aspect and by OUTSIDE."""
        each = [int(counts[[k - 1 for k in ids]].sum()) for ids in self.groups]
        return np.array([*each, counts.sum() - sum(each)], dtype=np.int64)

    def values(self, shares: Array) -> Array:
        """Return the share, or the entropy in nat, for shares (..., c) of the outcomes.

        A part in no aspect has the largest uncertainty, ln of the number of classes, so that
        losing parts does not lower the entropy.
        """
        if not self.is_entropy:
            return np.asarray(shares[..., 0])
        classes, none = shares[..., :-1], shares[..., -1]
        inside = np.maximum(1 - none, 1e-300)[..., None]
        entropy = np.asarray(entr(classes / inside)).sum(axis=-1)
        return np.asarray((1 - none) * entropy + none * np.log(len(self.groups)))

    def posterior(self, counts: Counts, rng: np.random.Generator, size: int) -> Array:
        """Return draws (size,) of the value given counts (c,), by the Dirichlet posterior.

        The entropy of n drops in m classes is too small by (m - 1) / 2 n (Miller 1955), and that
        of a draw from their posterior by as much again; both are added.
        """
        prior = PRIOR / len(counts)
        values = self.values(rng.dirichlet(np.asarray(counts) + prior, size))
        if not self.is_entropy:
            return values
        bias = max(int((counts[:-1] > 0).sum()) - 1, 0) / max(int(counts.sum()), 1)
        return np.asarray(np.minimum(values + bias, np.log(len(self.groups))))

    def number(self, value: float) -> str:
        """Return a value as text: a share in percent, or an entropy in nat."""
        return f'{value:.3f} nat' if self.is_entropy else f'{100 * value:.1f} %'

    def difference(self, value: float) -> str:
        """Return a difference as text: points of a share, or nat."""
        return f'{value:.3f} nat' if self.is_entropy else f'{100 * value:.1f} points'


@dataclass(frozen=True)
class Estimated:
    """A value with its credible interval."""

    value: float
    lower: float
    upper: float


@dataclass(frozen=True)
class Advantage:
    """By how much the best conditions are better than others, and how certain that is.

    gain : Estimated
        Positive if the best conditions are better, even if less is better.
    certainty : float
        Posterior probability that they are better at all.
    """

    gain: Estimated
    certainty: float


def estimated(draws: Array, confidence: float) -> Estimated:
    """Return the mean and the central interval of draws."""
    tail, mean = (1 - confidence) / 2, float(draws.mean())
    lower, upper = np.quantile(draws, [tail, 1 - tail])
    lower, upper = containing(mean, lower, upper)
    return Estimated(mean, float(lower), float(upper))


def compared(draws: Sequence[Array], confidence: float) -> tuple[list[Advantage], float]:
    """Return by how much the first of some conditions is better than each other one.

    Also returns the posterior probability that it is better than all of them. ``draws`` are those
    of the posteriors of their scores, by drops that did not select the conditions, so that the
    values are not those of the luckiest of many points (winner's curse).
    """
    first, *others = draws
    gains = [
        Advantage(estimated(first - each, confidence), float((first > each).mean()))
        for each in others
    ]
    return gains, float(np.all([first > each for each in others], axis=0).mean())


def make_objective(
    aspects: AspectSet,
    wanted: Sequence[int] | None = None,
    wanted_classes: Sequence[int] | None = None,
    *,
    minimise_entropy: bool = False,
) -> Objective:
    """Return an objective; raises InvalidValueError unless exactly one is given and known."""
    if sum([wanted is not None, wanted_classes is not None, minimise_entropy]) != 1:
        raise InvalidValueError(
            'invalid objective: expected one of wanted aspects, wanted classes and least entropy'
        )
    members = tuple(tuple(a.id for a in each) for each in aspects.classes())
    if minimise_entropy:
        if len(members) < 2:
            raise InvalidValueError(
                f'invalid objective least entropy: expected a part with several symmetry classes '
                f'of aspects, not {len(members)}'
            )
        return Objective((), members)
    ids = aspects.chosen(wanted, wanted_classes, 'wanted')
    return Objective(ids, (ids,))


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
    behind : Advantage or None
        By how much the best conditions are better; None for these, and without fresh drops.
    """

    setting: Setting
    values: Mapping[str, float | None]
    point: Array | None
    counts: Counts
    estimate: Estimated
    behind: Advantage | None = None

    @property
    def drops(self) -> int:
        """Number of drops."""
        return int(self.counts.sum())


@dataclass(frozen=True, eq=False)
class OptimiseResult(Result):
    """The best conditions within ranges, and how certain the answer is.

    Attributes
    ----------
    part : Part
    aspects : AspectSet
    objective : Objective
    factors : tuple of Factor
    candidates : tuple of Candidate
        The conditions that are compared by fresh drops, those with the best value first: the best
        ones of the search, the best ones that differ from these by a fifth of a range, and those
        from which the search started. If these are outside the ranges, they are last.
    start : Candidate or None
        The conditions from which the search started; None if they are impossible.
    certainty : float
        Posterior probability that the first candidate is better than all others; NaN without fresh
        drops.
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
    candidates: tuple[Candidate, ...]
    start: Candidate | None
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

    @property
    def notes(self) -> list[str]:
        """Sentences that state how certain the answer is, and what limits it."""
        return [
            *_comparison_notes(self),
            self.range_text,
            *_bound_notes(self),
            *_limit_notes(self),
        ]

    def document(self) -> dict[str, Any]:
        """Return the result as plain JSON types, in SI units."""
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
                for factor in self.factors
            ],
            **{name: self._compared_document(c) for name, c in compared.items()},
            'over_second': plain(self.second and self.second.behind),
            'over_start': plain(self.start and self.start.behind),
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
        action, model = candidate.setting.action, self.model_range(candidate)
        return {
            'values': dict(candidate.values),
            'conditions': candidate.setting.drop_conditions.document(),
            'action': None if action is None else plain(action.values),
            'value': plain(candidate.estimate),
            'counts': candidate.counts.tolist(),
            'drops': candidate.drops,
            'model_lower': None if model is None else model.lower,
            'model_upper': None if model is None else model.upper,
        }

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


def certainty_text(certainty: float) -> str:
    """Return a probability as text; it is never rounded to 0 or 100 %."""
    if certainty > 0.999:
        return 'more than 99.9 %'
    return 'less than 0.1 %' if certainty < 0.001 else f'{100 * certainty:.1f} %'


def _comparison_notes(result: OptimiseResult) -> Iterator[str]:
    """Say how the best conditions compare with the others."""
    if not np.isnan(result.certainty) and not result.winner:
        yield (
            'No winner: the probability that the best conditions are better than all others that '
            f'were compared is {certainty_text(result.certainty)}.'
        )
    for other, name in ((result.second, 'the second conditions'), (result.start, 'yours')):
        if other is not None and other.behind is not None:
            yield _against(other.behind, result.objective, name)


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


def _bound_notes(result: OptimiseResult) -> Iterator[str]:
    """Say which values are at a bound of their range."""
    place = result.best.point
    if place is None:
        return
    for factor, at in zip(result.factors, place.tolist(), strict=True):
        if min(at, 1 - at) <= AT_BOUND:
            end, value = ('lower', factor.low) if at < 0.5 else ('upper', factor.high)
            yield (
                f'The best {factor.name} is at the {end} bound of its range, '
                f'{factor.text(value)}: it may be better beyond.'
            )


def _limit_notes(result: OptimiseResult) -> Iterator[str]:
    """Say what was skipped, and what is missing."""
    if result.skipped:
        yield (
            f'{len(result.skipped)} points were impossible and were skipped, the first because: '
            f'{result.skipped[0][1]}.'
        )
    if not result.complete:
        yield f'The search ended early, after {result.drops} of {result.budget} drops.'
    if np.isnan(result.certainty):
        yield (
            'The best conditions were not confirmed by fresh drops: their value is that of the '
            'drops that selected them, and is probably too good.'
        )
    elif result.start is None:
        yield 'Your conditions are impossible themselves, and were not compared.'
