"""A distribution with two uncertainties: that of the sampling, and that of the surface."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.special import ndtri

from resting_aspects_ros.core.aspects.aspect_set import AspectSet
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.statistics.intervals import Interval, intervals
from resting_aspects_ros.simulation.conditions import DropConditions
from resting_aspects_ros.studies.point_plans import OTHER

Array = npt.NDArray[np.float64]
SCHEMA_VERSION = 1


@dataclass(frozen=True, eq=False)
class PropagatedResult:
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

    def sampling(self) -> list[Interval]:
        """Return the mean share of each aspect, with Wilson's interval for all drops."""
        return intervals(self.counts.sum(axis=0), self.drops, confidence=self.confidence)

    @property
    def between(self) -> Array:
        """(k,) variance of the probability between the samples, beyond that of the sampling.

        The variance of the shares is that of the probabilities and the mean variance of the
        sampling, p (1 - p) / m; negative differences are 0. NaN for less than two samples.
        """
        if len(self.counts) < 2:
            return np.full(self.counts.shape[1], np.nan)
        m = self.drops_per_sample
        shares = self.counts / m
        within = (shares * (1 - shares)).mean(axis=0) / (m - 1)
        return np.asarray(np.maximum(shares.var(axis=0, ddof=1) - within, 0))

    @property
    def detectable(self) -> Array:
        """(k,) deviation between samples that sampling exceeds in 5 % of runs, in any aspect."""
        s, m = max(len(self.counts), 2), self.drops_per_sample
        p = self.counts.sum(axis=0) / max(self.drops, 1)
        return np.asarray(
            np.sqrt(ndtri(1 - 0.05 / p.size) * np.sqrt(2 / (s - 1)) * p * (1 - p) / m)
        )

    def total(self) -> list[Interval]:
        """Return the intervals that also contain what is not known of the surface.

        Wilson's interval for as many drops as have the variance of sampling and surface together.
        It is the sampling interval if the surface has no effect.
        """
        n = float(max(self.drops, 1))
        p = self.counts.sum(axis=0) / n
        sampling = p * (1 - p) / n
        variance = sampling + np.where(sampling > 0, self.between, 0)
        known = variance > 0
        size = np.where(known, p * (1 - p) / np.where(known, variance, 1), n)
        z2 = ndtri((1 + self.confidence) / 2) ** 2
        middle = (p + z2 / (2 * size)) / (1 + z2 / size)
        half = np.sqrt(z2 * (p * (1 - p) / size + z2 / (4 * size**2))) / (1 + z2 / size)
        low = np.where(p == 0, 0, np.maximum(middle - half, 0))
        high = np.where(p == 1, 1, np.minimum(middle + half, 1))
        rows = zip(p.tolist(), low.tolist(), high.tolist(), strict=True)
        return [Interval(*row) for row in rows]

    def sentence(self) -> str:
        """Say which uncertainty matters."""
        z = float(ndtri((1 + self.confidence) / 2))
        between, limits = z * np.sqrt(self.between), z * self.detectable
        k = int((between - limits).argmax())
        share = self.counts[:, k].sum() / self.drops
        sampling = z * float(np.sqrt(share * (1 - share) / self.drops))
        if between[k] <= limits[k]:
            return (
                'No effect of the unknown surface is visible: with '
                f'{self.drops_per_sample} drops at each of {len(self.counts)} samples, effects '
                f'of less than about {100 * limits.max():.1f} points cannot be seen.'
            )
        return (
            f'Not knowing the surface moves aspect {k + 1} by up to {100 * between[k]:.1f} points '
            f'({100 * self.confidence:g} %); sampling by {100 * sampling:.1f}.'
        )

    def other_ends(self) -> dict[str, int]:
        """Return how many drops ended in no aspect, by how they ended."""
        return dict(zip(OTHER, self.other.sum(axis=0).tolist(), strict=True))

    def document(self) -> dict[str, Any]:
        """Return everything as plain values; see docs/reference/files.md."""
        rows = zip(self.sampling(), self.total(), self.between, strict=True)
        return {
            'schema_version': SCHEMA_VERSION,
            'part': self.part.name,
            'part_sha256': self.part.part_sha256,
            'surface': self.conditions.surface,
            'drops': self.drops,
            'drops_per_sample': self.drops_per_sample,
            'seed': self.seed,
            'confidence': self.confidence,
            'complete': self.complete,
            'aspects': [
                {
                    'id': k + 1,
                    'count': int(self.counts[:, k].sum()),
                    'probability': sampling.probability,
                    'sampling': [sampling.lower, sampling.upper],
                    'with_surface': [total.lower, total.upper],
                    'surface_deviation': float(np.sqrt(between)),
                }
                for k, (sampling, total, between) in enumerate(rows)
            ],
            'other': self.other_ends(),
            'samples': [
                {'conditions': sample, 'counts': row.tolist(), 'other': other.tolist()}
                for sample, row, other in zip(self.samples, self.counts, self.other, strict=True)
            ],
            'summary': self.sentence(),
        }

    def to_json(self) -> str:
        """Return the document as JSON."""
        return json.dumps(self.document(), indent=2) + '\n'

    def save_json(self, path: str | Path) -> None:
        """Write the document into a file."""
        from resting_aspects_ros.api.output_files import whole_file

        with whole_file(Path(path)) as file:
            file.write_text(self.to_json(), encoding='utf-8')

    def __str__(self) -> str:
        each, surface = self.drops_per_sample, self.conditions.surface
        lines = [
            f'{self.part.name}: {self.drops} drops on {surface}',
            f'{each} at each of {len(self.counts)} samples of its conditions',
            '',
            'aspect  probability  sampling interval  with the surface',
        ]
        for k, (one, all_) in enumerate(zip(self.sampling(), self.total(), strict=True)):
            lines.append(
                f'{k + 1:>6}  {one.probability:>11.4f}  {one.lower:>8.4f} {one.upper:>8.4f}  '
                f'{all_.lower:>7.4f} {all_.upper:>8.4f}'
            )
        lines += [
            f'{name:>12}: {count} of {self.drops} drops'
            for name, count in self.other_ends().items()
            if count
        ]
        return '\n'.join([*lines, '', self.sentence()])
