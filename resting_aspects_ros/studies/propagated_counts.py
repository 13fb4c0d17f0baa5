"""The counts of a distribution with two uncertainties: by sampling, and by the surface."""

import json
import textwrap
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.aspects.aspect_set import AspectSet
from resting_aspects_ros.core.errors import analysis
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.statistics.intervals import Interval
from resting_aspects_ros.simulation.conditions import DropConditions
from resting_aspects_ros.studies.point_plans import OTHER
from resting_aspects_ros.studies.point_runs import counts_by_class
from resting_aspects_ros.studies.points import Case
from resting_aspects_ros.studies.sampled_shares import SIGNIFICANCE, SampledShares

SCHEMA_VERSION = 1
PAGE = 'report.html'
WIDTH = 80  # of the text


@dataclass(frozen=True, eq=False)
class PropagatedCounts:
    """Drops under several conditions that a calibration leaves possible.

    conditions : DropConditions
        The most probable ones, with the conditions that were not fitted.
    samples : tuple of dict of str to float
        The fitted conditions of each sample.
    counts : (s, k) int
        Drops at rest in each aspect, of each sample.
    other : (s, 5) int
        Drops of each sample that ended otherwise; columns as in OTHER. They are part of the drops
        of which the probabilities are shares.
    drops_per_sample : int
    complete : bool
        Whether no sample is missing; a sample without all of its drops is not counted.
    """

    part: Part
    aspects: AspectSet
    conditions: DropConditions
    samples: tuple[dict[str, float], ...]
    counts: npt.NDArray[np.int64]
    other: npt.NDArray[np.int64]
    drops_per_sample: int
    seed: int
    confidence: float
    complete: bool

    @property
    def drops(self) -> int:
        """Number of drops of all samples."""
        return len(self.counts) * self.drops_per_sample

    @cached_property
    def by_aspect(self) -> SampledShares:
        """Counts by aspect, with both uncertainties."""
        return SampledShares(self.counts, self.drops_per_sample, self.confidence)

    @cached_property
    def by_class(self) -> SampledShares:
        """Counts by symmetry class, with both uncertainties."""
        counts = counts_by_class(self.aspects, self.counts)
        return SampledShares(counts, self.drops_per_sample, self.confidence)

    @cached_property
    def case(self) -> Case:
        """The counts by symmetry class, with one point for each sample."""
        return Case(self.part, self.aspects, self.by_class.counts, self.other)

    def sentence(self) -> str:
        """Say whether the unknown surface has an effect, and what shortens the intervals.

        An effect is shown by the chi-square test that all samples have the same shares. It is then
        the larger part of the variance, because the mean of s samples has a s-th of the sampling
        variance of one sample, and smaller effects are not significant.
        """
        found = self.by_class
        if found.p_value >= SIGNIFICANCE:
            limit = 100 * float(np.sqrt(found.between_limit.max()))
            return (
                'No effect of the unknown surface is shown (chi-square test of the samples, '
                f'{_p_text(found.p_value)}): the standard deviation that it causes is at most '
                f'{limit:.1f} points for every share, with 95 % confidence. More drops lower this '
                'limit.'
            )
        k = int(found.between.argmax())
        sampling, total = (
            50 * (each.upper - each.lower) for each in (found.sampling()[k], found.total()[k])
        )
        part = float(found.part_of_surface[k])
        return (
            f'Not knowing the surface matters (chi-square test of the samples, '
            f'{_p_text(found.p_value)}), most for {self.case.class_names[k]}: the interval is '
            f'±{sampling:.1f} points by sampling and ±{total:.1f} points with the surface, which '
            f'causes {100 * part:.0f} % of the variance. More counts by hand on the surface '
            'shorten this interval; more drops hardly do.'
        )

    def other_ends(self) -> dict[str, int]:
        """Return how many drops ended in no aspect, by how they ended."""
        return dict(zip(OTHER, self.other.sum(axis=0).tolist(), strict=True))

    def document(self) -> dict[str, Any]:
        """Return everything as plain values; see docs/reference/files.md."""
        members = [[a.id for a in alike] for alike in self.aspects.classes()]
        document: dict[str, Any] = {
            'schema_version': SCHEMA_VERSION,
            'part': self.part.name,
            'part_sha256': self.part.part_sha256,
            'surface': self.conditions.surface,
            'drops': self.drops,
            'drops_per_sample': self.drops_per_sample,
            'seed': self.seed,
            'confidence': self.confidence,
            'complete': self.complete,
            'other': self.other_ends(),
            'samples': [
                {'conditions': sample, 'counts': row.tolist(), 'other': other.tolist()}
                for sample, row, other in zip(self.samples, self.counts, self.other, strict=True)
            ],
        }
        with analysis('the uncertainty of the shares'):
            by_class = zip(members, _rows(self.by_class), strict=True)
            document |= {
                'aspects': [{'id': k, **row} for k, row in enumerate(_rows(self.by_aspect), 1)],
                'classes': [{'aspects': ids, **row} for ids, row in by_class],
                'p_value': self.by_class.p_value,
                'summary': self.sentence(),
            }
        return document

    def to_json(self) -> str:
        """Return the document as JSON."""
        return json.dumps(self.document(), indent=2) + '\n'

    def save_json(self, path: str | Path) -> None:
        """Write the document into a file."""
        from resting_aspects_ros.api.output_files import whole_file

        with whole_file(Path(path)) as file:
            file.write_text(self.to_json(), encoding='utf-8')

    def __str__(self) -> str:
        found, names = self.by_class, self.case.class_names
        width = max(len('class'), *map(len, names))
        lines = [
            f'{self.part.name}: {self.drops} drops on {self.conditions.surface or "the surface"}',
            f'{self.drops_per_sample} at each of {len(self.counts)} samples of its conditions',
            '',
            f'{"":<{width}}  probability   by sampling alone   with the surface',
        ]
        for name, one, both in zip(names, found.sampling(), found.total(), strict=True):
            lines.append(
                f'{name:<{width}}  {100 * one.probability:>9.2f} %   {interval_text(one):>17}   '
                f'{interval_text(both):>16}'
            )
        lines += [
            f'{name:<{width}}  {100 * count / self.drops:>9.2f} %   ({count} drops)'
            for name, count in self.other_ends().items()
            if count
        ]
        return '\n'.join([*lines, '', *textwrap.wrap(self.sentence(), WIDTH)])


def interval_text(found: Interval) -> str:
    """Return an interval of a share, such as '12.3 to 14.5 %'."""
    return f'{100 * found.lower:.1f} to {100 * found.upper:.1f} %'


def _rows(found: SampledShares) -> list[dict[str, Any]]:
    """Return the numbers of each outcome as plain values."""
    rows = zip(
        found.counts.sum(axis=0).tolist(),
        found.sampling(),
        found.total(),
        np.sqrt(found.between).tolist(),
        np.sqrt(found.between_limit).tolist(),
        found.part_of_surface.tolist(),
        strict=True,
    )
    return [
        {
            'count': count,
            'probability': sampling.probability,
            'sampling': [sampling.lower, sampling.upper],
            'with_surface': [total.lower, total.upper],
            'surface_deviation': deviation,
            'surface_deviation_limit': limit,
            'surface_part': part,
        }
        for count, sampling, total, deviation, limit, part in rows
    ]


def _p_text(p: float) -> str:
    return 'p < 0.001' if p < 0.001 else f'p = {p:.2g}'
