"""The result of a search for the best conditions, with its document, page and table."""

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from resting_aspects_ros.api.output_files import whole_file
from resting_aspects_ros.api.surroundings import conditions_document, scene_of
from resting_aspects_ros.report.document import SCHEMA_VERSION, plain
from resting_aspects_ros.report.document import to_json as json_text
from resting_aspects_ros.simulation.plan import engine_version
from resting_aspects_ros.simulation.run_description import BULLET, KERNEL
from resting_aspects_ros.simulation.step_action import Step
from resting_aspects_ros.studies.design import Factor
from resting_aspects_ros.studies.objectives import Objective
from resting_aspects_ros.studies.optimise_text import optimise_notes
from resting_aspects_ros.studies.optimum import Candidate, OptimisePoint, Optimum
from resting_aspects_ros.studies.optimum_facts import FactorFacts

PAGE = 'report.html'


class OptimiseResult(Optimum):
    """The best conditions within ranges, and how certain the answer is.

    Its attributes are those of `Optimum`.
    """

    @property
    def notes(self) -> list[str]:
        """Sentences that state how certain the answer is, and what limits it."""
        return optimise_notes(self)

    @property
    def engine(self) -> str:
        """What simulates the best conditions: Bullet at an edge or a mesh, or the kernel."""
        setting = self.best.setting
        scene = scene_of(self.part, setting.drop_conditions)
        edge = setting.action is not None and isinstance(setting.action.action, Step)
        return BULLET if edge or not (scene is None or scene.flat) else KERNEL

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
            'certainty': plain(self.certainty),
            'winner': self.winner,
            'complete': self.complete,
            'confidence': self.confidence,
            'seed': self.seed,
            'surrogate': self.surrogate,
            'surrogate_error': self.surrogate_error,
            'engine': self.engine,
            'engine_version': engine_version(self.engine),
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
        save_points(Path(path), self.factors, self.objective, self.points)


def save_points(
    path: Path, factors: Sequence[Factor], objective: Objective, points: Sequence[OptimisePoint]
) -> None:
    """Write the points of a search as CSV, in SI units."""
    outcomes = ['+'.join(map(str, ids)) for ids in objective.groups]
    if objective.contacts:
        outcomes = ['wanted']
    with whole_file(path) as file, file.open('w', newline='', encoding='utf-8') as stream:
        writer = csv.writer(stream)
        writer.writerow([*(f.name for f in factors), 'round', *outcomes, 'other'])
        for point in points:
            writer.writerow([*point.values.values(), point.round, *point.counts.tolist()])


def _facts(factor: Factor, facts: FactorFacts) -> dict[str, Any]:
    low, high = (float(v) for v in factor.values(np.array(facts.flat)))
    return {
        'flat': [low, high],
        'at_bound': facts.at_bound,
        'effect': plain(facts.effect),
        'effect_upper': plain(facts.effect_upper),
        'p_value': plain(facts.p_value),
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
