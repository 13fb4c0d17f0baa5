"""The result of a search for the best conditions."""

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from resting_aspects_ros.api.output_files import whole_file
from resting_aspects_ros.api.surroundings import conditions_document
from resting_aspects_ros.core.aspects.aspect_set import AspectSet
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.report.document import SCHEMA_VERSION, plain
from resting_aspects_ros.report.document import to_json as json_text
from resting_aspects_ros.simulation.plan import ENGINE, ENGINE_VERSION
from resting_aspects_ros.studies.factors import Factor
from resting_aspects_ros.studies.objectives import Counts, Objective
from resting_aspects_ros.studies.optimise_text import optimise_notes
from resting_aspects_ros.studies.optimum_comparison import Advantage, Estimated
from resting_aspects_ros.studies.optimum_facts import FactorFacts
from resting_aspects_ros.studies.optimum_problem import Amounts
from resting_aspects_ros.studies.optimum_profile import Profile
from resting_aspects_ros.studies.setting import Setting

PAGE = 'report.html'


@dataclass(frozen=True, eq=False)
class Candidate:
    """Conditions that are compared.

    setting : Setting
    values : dict of str to float or None
        Values of the factors, SI units; None for a default of the surroundings.
    counts : (c,) int or None
        Fresh drops by outcome: the groups of the objective, then all other ends; None if none
        were made.
    estimate : Estimated
        The value of the objective, by the fresh drops; without them by the surrogate.
    """

    setting: Setting
    values: Mapping[str, float | None]
    counts: Counts | None
    estimate: Estimated

    @property
    def drops(self) -> int:
        """Number of fresh drops."""
        return 0 if self.counts is None else int(self.counts.sum())


@dataclass(frozen=True, eq=False)
class OptimisePoint:
    """A point of the design or of the search: values of the factors, SI units, and counts (c,).

    round : int
        0 for the design, otherwise the round of the search.
    """

    values: Mapping[str, float]
    counts: Counts
    round: int


@dataclass(frozen=True, eq=False)
class OptimiseResult:
    """The best conditions within ranges, and how certain the answer is.

    Attributes
    ----------
    part : Part
    aspects : AspectSet
    objective : Objective
    factors : tuple of Factor
    facts : tuple of FactorFacts
        For each factor, how flat the optimum is and whether the factor matters.
    best : Candidate
    second : Candidate or None
        The best of the conditions that are not nearly the same: at least one factor differs by a
        fifth of its range. None if there are none.
    start : Candidate or None
        The conditions from which the search started; None if they are impossible.
    over_second, over_start : Advantage or None
        By how much the best conditions are better, by fresh drops; None without them.
    points : tuple of OptimisePoint
    skipped : tuple of (dict of str to float, str)
        Impossible points, and why.
    amounts : Amounts
        Points, drops at each, and the budget.
    drops : int
        All drops that were made.
    certain : bool
        Whether the search ended early, because no point was expected to be much better.
    complete : bool
        Whether the fresh drops were made.
    confidence : float
    seed : int
    surrogate : str
    surrogate_error : float
        Cross-validated error of the shares.
    profile : Profile
        The objective along each factor, by the surrogate.
    """

    part: Part
    aspects: AspectSet
    objective: Objective
    factors: tuple[Factor, ...]
    facts: tuple[FactorFacts, ...]
    best: Candidate
    second: Candidate | None
    start: Candidate | None
    over_second: Advantage | None
    over_start: Advantage | None
    points: tuple[OptimisePoint, ...]
    skipped: tuple[tuple[Mapping[str, float], str], ...]
    amounts: Amounts
    drops: int
    certain: bool
    complete: bool
    confidence: float
    seed: int
    surrogate: str
    surrogate_error: float
    profile: Profile

    @property
    def aim(self) -> str:
        """What was sought, such as 'largest share of aspect 1 after one tap'."""
        action = self.best.setting.action
        if action is None:
            return self.objective.text
        return f'{self.objective.text} after one {action.name} on parts that were dropped'

    @property
    def notes(self) -> list[str]:
        """Sentences that state how certain the answer is, and what limits it."""
        return optimise_notes(self)

    @property
    def document(self) -> dict[str, Any]:
        """The result as plain JSON types, in SI units."""
        groups = [list(ids) for ids in self.objective.groups]
        return {
            'schema_version': SCHEMA_VERSION,
            'part': self.part.name,
            'part_sha256': self.part.part_sha256,
            'aim': self.aim,
            'wanted': list(self.objective.wanted),
            'wanted_contacts': [dict(each.named) for each in self.objective.contacts],
            'outcomes': ['wanted'] if self.objective.contacts else groups,
            'unit': 'nat' if self.objective.is_entropy else '',
            'factors': [
                {'name': factor.name, **factor.document, 'unit': factor.unit, **_facts(factor, f)}
                for factor, f in zip(self.factors, self.facts, strict=True)
            ],
            'best': _candidate(self.best),
            'second': None if self.second is None else _candidate(self.second),
            'start': None if self.start is None else _candidate(self.start),
            'over_second': plain(self.over_second),
            'over_start': plain(self.over_start),
            'notes': self.notes,
            'points': [
                {'values': dict(p.values), 'counts': p.counts.tolist(), 'round': p.round}
                for p in self.points
            ],
            'skipped': [{'values': dict(v), 'reason': reason} for v, reason in self.skipped],
            'budget': plain(self.amounts),
            'drops': self.drops,
            'certain': self.certain,
            'complete': self.complete,
            'confidence': self.confidence,
            'seed': self.seed,
            'surrogate': self.surrogate,
            'surrogate_error': self.surrogate_error,
            'engine': ENGINE,
            'engine_version': ENGINE_VERSION,
        }

    def to_json(self) -> str:
        """Return the result as a JSON document."""
        return json_text(self.document)

    def save_json(self, path: str | Path) -> None:
        """Write the result as a JSON document."""
        with whole_file(Path(path)) as file:
            file.write_text(self.to_json(), encoding='utf-8')

    def report(self, folder: str | Path) -> Path:
        """Write a page with the objective over each factor; returns its path. OutputError."""
        # This import takes about a second.
        from resting_aspects_ros.studies.optimise_page import optimise_page

        with whole_file(Path(folder) / PAGE) as file:
            file.write_text(optimise_page(self), encoding='utf-8')
        return Path(folder) / PAGE

    def save_csv(self, path: str | Path) -> None:
        """Write the points of the design and of the search as CSV, in SI units."""
        outcomes = ['+'.join(map(str, ids)) for ids in self.objective.groups]
        if self.objective.contacts:
            outcomes = ['wanted']
        header = [*(f.name for f in self.factors), 'round', *outcomes, 'other']
        with (
            whole_file(Path(path)) as file,
            file.open('w', newline='', encoding='utf-8') as stream,
        ):
            writer = csv.writer(stream)
            writer.writerow(header)
            for point in self.points:
                writer.writerow([*point.values.values(), point.round, *point.counts.tolist()])


def _facts(factor: Factor, facts: FactorFacts) -> dict[str, Any]:
    low, high = (float(v) for v in factor.values(np.array(facts.flat)))
    return {
        'flat': [low, high],
        'at_bound': facts.at_bound,
        'effect': facts.effect,
        'effect_upper': facts.effect_upper,
        'p_value': facts.p_value,
    }


def _candidate(candidate: Candidate) -> dict[str, Any]:
    setting = candidate.setting
    return {
        'values': dict(candidate.values),
        'conditions': conditions_document(setting.drop_conditions),
        'action': None if setting.action is None else plain(setting.action.values),
        'value': plain(candidate.estimate),
        'counts': None if candidate.counts is None else candidate.counts.tolist(),
        'drops': candidate.drops,
    }
