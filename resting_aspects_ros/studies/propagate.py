"""Carry the uncertainty of a calibrated surface through to the distribution of a part."""

import textwrap
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Protocol

import numpy as np
from pydantic import BaseModel, StrictStr, create_model
from scipy.stats import chi2, norm

from resting_aspects_ros.api.conditions import shipped_surfaces
from resting_aspects_ros.api.load_part import given_part
from resting_aspects_ros.api.plan import check_height
from resting_aspects_ros.api.result import Result
from resting_aspects_ros.api.runner import DropProgress, Progress, never
from resting_aspects_ros.arrays import Array, Counts
from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.aspects.landscape import Landscape
from resting_aspects_ros.errors import InvalidValueError, StoppedError, analysis, shown
from resting_aspects_ros.input_files import Number, named, parse_json, read_input, validated
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.simulation.conditions import (
    MIN_SAMPLES,
    QUANTITIES,
    DropConditions,
    HeightOf,
    Surfaces,
)
from resting_aspects_ros.simulation.job import DEFAULT_SEED, make_job
from resting_aspects_ros.simulation.workers import Workers
from resting_aspects_ros.statistics.distribution import OUTSIDE
from resting_aspects_ros.statistics.intervals import (
    CONFIDENCE,
    Interval,
    containing,
    intervals,
)
from resting_aspects_ros.studies.effects import homogeneity
from resting_aspects_ros.studies.points import Case, counts_by_class, drop_points

if TYPE_CHECKING:
    from resting_aspects_ros.report.page import Page

SCHEMA_VERSION, PAGE, WIDTH = 1, 'report.html', 80
SAMPLES, DROPS = 32, 10_000
MAX_BYTES = 1 << 24
# An effect of the surface is shown if the p value of the test is less.
SIGNIFICANCE = 0.05


@dataclass(frozen=True, eq=False)
class SampledShares:
    """Shares of k outcomes over s samples of the surface, and the parts of their variance.

    means : (k,) float
    sampling, total : list of Interval
        Of the means: by the number of drops alone, and with what is not known of the surface.
    between, between_limit : (k,) float
        Variance of the probability between the samples, and upper limits that hold simultaneously
        (95 %). NaN for less than two samples.
    part_of_surface : (k,) float
        Part of the variance of the mean that the unknown surface causes, 0 to 1.
    p_value : float
        Of the chi-square test that all samples have the same shares.
    """

    means: Array
    sampling: list[Interval]
    total: list[Interval]
    between: Array
    between_limit: Array
    part_of_surface: Array
    p_value: float


def sampled_shares(counts: Counts, drops: int, confidence: float) -> SampledShares:
    """Return the shares of k outcomes, from counts (s, k) of this number of drops at each sample.

    The variance between the samples is that of the shares less the mean variance of the sampling
    at a sample, p (1 - p) / m; negative differences are 0. (s - 1) times the variance of the
    shares, divided by that of probabilities and sampling together, has a chi-square distribution.
    The mean itself is over s samples, so that the surface adds (1 + 1 / s) times the variance
    between them. The total interval is Wilson's for the number of drops that has both variances.
    """
    s, k = counts.shape
    n, shares = max(1, s * drops), counts / drops
    means = counts.sum(axis=0) / n
    within = (shares * (1 - shares)).mean(axis=0) / (drops - 1) if s else np.zeros(k)
    spread = shares.var(axis=0, ddof=1) if s > 1 else np.full(k, np.nan)
    between = np.maximum(spread - within, 0)
    limit = (s - 1) * spread / chi2.ppf(SIGNIFICANCE / k, max(s - 1, 1)) - within
    by_sampling = means * (1 - means) / n
    by_surface = between * (1 + 1 / max(s, 1))
    both = by_sampling + np.where(by_sampling > 0, by_surface, 0)
    size = np.where(both > 0, means * (1 - means) / np.where(both > 0, both, 1), n)
    z2 = norm.ppf((1 + confidence) / 2) ** 2
    middle = (means + z2 / (2 * size)) / (1 + z2 / size)
    half = np.sqrt(z2 * (means * (1 - means) / size + z2 / (4 * size**2))) / (1 + z2 / size)
    low, high = containing(means, np.maximum(middle - half, 0), np.minimum(middle + half, 1))
    return SampledShares(
        means,
        intervals(counts.sum(axis=0), n, confidence=confidence),
        [Interval(*row) for row in np.column_stack([means, low, high]).tolist()],
        between,
        np.maximum(limit, 0),
        np.where(both > 0, by_surface / np.maximum(by_surface + by_sampling, 1e-300), 0),
        homogeneity(np.column_stack([counts, drops - counts.sum(axis=1)])),
    )


@dataclass(frozen=True, eq=False)
class PropagatedResult(Result):
    """Drops under several conditions that a calibration leaves possible.

    conditions : DropConditions
        The most probable ones, with the conditions that were not fitted.
    samples : tuple of dict of str to float
        The fitted conditions of each sample.
    counts : (s, k) int
        Drops at rest in each aspect, of each sample.
    other : (s, 5) int
        Drops of each sample that ended otherwise; columns as in OUTSIDE. They are part of the
        drops of which the probabilities are shares.
    drops_per_sample : int
    complete : bool
        Whether no sample is missing; a sample without all of its drops is not counted.
    """

    part: Part
    aspects: AspectSet
    conditions: DropConditions
    samples: tuple[Mapping[str, float], ...]
    counts: Counts
    other: Counts
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
        return sampled_shares(self.counts, self.drops_per_sample, self.confidence)

    @cached_property
    def by_class(self) -> SampledShares:
        """Counts by symmetry class, with both uncertainties."""
        return sampled_shares(self.case.classes, self.drops_per_sample, self.confidence)

    @cached_property
    def case(self) -> Case:
        """The counts by symmetry class, with one point for each sample."""
        classes = counts_by_class(self.aspects, self.counts)
        return Case(self.part, self.aspects, classes, self.other)

    def sentence(self) -> str:
        """Say whether the unknown surface has an effect, and what shortens the intervals.

        An effect is shown by the chi-square test that all samples have the same shares. It is then
        the larger part of the variance, because the mean of s samples has a s-th of the sampling
        variance of one sample, and smaller effects are not significant.
        """
        found = self.by_class
        p_text = 'p < 0.001' if found.p_value < 0.001 else f'p = {found.p_value:.2g}'
        if found.p_value >= SIGNIFICANCE:
            limit = 100 * float(np.sqrt(found.between_limit.max()))
            return (
                'No effect of the unknown surface is shown (chi-square test of the samples, '
                f'{p_text}): the standard deviation that it causes is at most {limit:.1f} points '
                'for every share, with 95 % confidence. More drops lower this limit.'
            )
        k = int(found.between.argmax())
        sampling, total = (
            50 * (each.upper - each.lower) for each in (found.sampling[k], found.total[k])
        )
        return (
            f'Not knowing the surface matters (chi-square test of the samples, {p_text}), most '
            f'for {self.case.class_names[k]}: the interval is ±{sampling:.1f} points by sampling '
            f'and ±{total:.1f} points with the surface, which causes '
            f'{100 * float(found.part_of_surface[k]):.0f} % of the variance. More counts by hand '
            'on the surface shorten this interval; more drops hardly do.'
        )

    def other_ends(self) -> dict[str, int]:
        """Return how many drops ended in no aspect, by how they ended."""
        return dict(zip(OUTSIDE, self.other.sum(axis=0).tolist(), strict=True))

    def document(self) -> dict[str, Any]:
        """Return everything as plain values; see docs/reference/files.md."""
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
                {'conditions': dict(sample), 'counts': row.tolist(), 'other': other.tolist()}
                for sample, row, other in zip(self.samples, self.counts, self.other, strict=True)
            ],
        }
        with analysis('the uncertainty of the shares'):
            members = [[a.id for a in alike] for alike in self.aspects.classes()]
            aspects = _rows(self.counts, self.by_aspect)
            classes = zip(members, _rows(self.case.classes, self.by_class), strict=True)
            document |= {
                'aspects': [{'id': k, **row} for k, row in enumerate(aspects, 1)],
                'classes': [{'aspects': ids, **row} for ids, row in classes],
                'p_value': self.by_class.p_value,
                'summary': self.sentence(),
            }
        return document

    def page(self) -> 'Page':
        """Return a page with both intervals of each class."""
        # This import takes about a second.
        from resting_aspects_ros.studies.pages import propagated_page

        return propagated_page(self, PAGE)

    def __str__(self) -> str:
        found, names = self.by_class, self.case.class_names
        width = max(len('class'), *map(len, names))
        lines = [
            f'{self.part.name}: {self.drops} drops on {self.conditions.surface or "the surface"}',
            f'{self.drops_per_sample} at each of {len(self.counts)} samples of its conditions',
            '',
            f'{"":<{width}}  probability   by sampling alone   with the surface',
        ]
        for name, one, both in zip(names, found.sampling, found.total, strict=True):
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


def _rows(counts: Counts, found: SampledShares) -> list[dict[str, Any]]:
    """Return the numbers of each outcome as plain values."""
    return [
        {
            'count': int(counts[:, k].sum()),
            'probability': sampling.probability,
            'sampling': [sampling.lower, sampling.upper],
            'with_surface': [total.lower, total.upper],
            'surface_deviation': float(np.sqrt(found.between[k])),
            'surface_deviation_limit': float(np.sqrt(found.between_limit[k])),
            'surface_part': float(found.part_of_surface[k]),
        }
        for k, (sampling, total) in enumerate(zip(found.sampling, found.total, strict=True))
    ]


def interval_text(found: Interval) -> str:
    """Return an interval of a share, such as '12.3 to 14.5 %'."""
    return f'{100 * found.lower:.1f} to {100 * found.upper:.1f} %'


_numbers: dict[str, Any] = dict.fromkeys(QUANTITIES, (Number, ...))
_height_of: Any = (Literal['LOWEST_POINT', 'CENTRE_OF_MASS'], ...)
_Draw: Any = dict[Literal[tuple(QUANTITIES)], Number]  # type: ignore[misc]
_Conditions: Any = create_model('Conditions', **_numbers, height_of=_height_of)
EXPECTED = {
    'conditions': 'a mapping with all conditions',
    'draws': 'a list of mappings of conditions to numbers',
}


class CalibrationFile(BaseModel):
    """What is read of the file calibration.json."""

    surface: StrictStr
    conditions: _Conditions
    draws: list[_Draw]


class Calibration(Protocol):
    """A result of `calibrate`."""

    def document(self) -> dict[str, Any]:
        """Return it as plain values, as its file has them."""


@dataclass(frozen=True)
class UncertainSurface:
    """Conditions, and equally probable values of those that are not known.

    draws : tuple of dict of str to float
        Values of the fitted conditions, drawn from the posterior of a calibration.
    """

    conditions: DropConditions
    draws: tuple[Mapping[str, float], ...]


def uncertain_surface(given: Calibration | Mapping[str, Any] | str | Path) -> UncertainSurface:
    """Return an uncertain surface: a named one, a calibration, its document or its file.

    Raises InvalidValueError if it has no samples of its conditions.
    """
    if isinstance(given, str) and given in shipped_surfaces().names():
        return named_surface(given, shipped_surfaces())
    label, document = 'calibration', given
    try:
        if isinstance(given, str | Path):
            label = named('calibration', given)
            document = parse_json(Path(given), read_input(Path(given), MAX_BYTES, 'file'))
        elif not isinstance(given, Mapping):
            document = given.document()
        checked = validated(CalibrationFile, document, expected=EXPECTED)
        values = dict(checked.conditions)
        values['height_of'] = HeightOf[values['height_of']]
        base = DropConditions(surface=checked.surface, **values)
        if len(checked.draws) < MIN_SAMPLES:
            raise InvalidValueError(
                f'invalid draws {shown(checked.draws)}: expected at least {MIN_SAMPLES}'
            )
        for each in checked.draws:
            base.changed(**each)
    except InvalidValueError as error:
        raise InvalidValueError(
            f'invalid {label}: {error}; expected the file calibration.json of `resting_aspects '
            f'calibrate COUNTS.yaml --out DIR`, with at least {MIN_SAMPLES} draws, or the name of '
            'a surface with an uncertainty'
        ) from None
    return UncertainSurface(base, tuple(checked.draws))


def named_surface(name: str, surfaces: Surfaces) -> UncertainSurface:
    """Return a surface with its samples; raises InvalidValueError."""
    conditions, draws = surfaces.get(name), surfaces.samples(name)
    if not draws:
        raise InvalidValueError(
            f'invalid surface {conditions.surface}: expected one with an uncertainty; '
            '`resting_aspects calibrate` writes such an entry of a surfaces file'
        )
    return UncertainSurface(conditions, draws)


def propagate(
    part: Part | str | Path,
    surface: UncertainSurface | Calibration | Mapping[str, Any] | str | Path,
    drops: int = DROPS,
    *,
    samples: int = SAMPLES,
    seed: int = DEFAULT_SEED,
    confidence: float = CONFIDENCE,
    force: bool = False,
    workers: int | Workers | None = None,
    progress: Progress = False,
    stopped: Callable[[], bool] = never,
) -> PropagatedResult:
    """Drop a part under conditions that are drawn from what a calibration leaves possible.

    Parameters
    ----------
    part : Part, str or Path
        A part, or what `load_part` accepts.
    surface : UncertainSurface, CalibrationResult, mapping, str or Path
        Name of a surface with an uncertainty in config/surfaces.yaml; or a calibration, its
        document, or its file calibration.json.
    drops : int
        Number of drops at all samples together, rounded down to a multiple of ``samples``.
    samples : int
        Number of draws of the posterior, at least 8.
    seed, confidence, force, workers, progress, stopped
        As for `drop`.

    Raises
    ------
    InvalidValueError
        The surface has no uncertainty, a value is out of bounds, or the part cannot be dropped
        under one of the samples.
    StoppedError
        ``stopped`` returned True before two samples were complete.
    """
    if not isinstance(surface, UncertainSurface):
        surface = uncertain_surface(surface)
    if type(samples) is not int or not MIN_SAMPLES <= samples <= len(surface.draws):
        raise InvalidValueError(
            f'invalid samples {shown(samples)}: expected an integer from {MIN_SAMPLES} to '
            f'{len(surface.draws)}, the number of draws'
        )
    if type(drops) is not int or drops < 2 * samples:
        raise InvalidValueError(
            f'invalid drops {shown(drops)}: expected at least {2 * samples}, 2 for each sample'
        )
    chosen = np.random.default_rng((seed, 7)).permutation(len(surface.draws))[:samples]
    points = [surface.conditions.changed(**surface.draws[k]) for k in chosen.tolist()]
    loaded = given_part(part)
    if not force:
        check_height(loaded, surface.conditions)
    landscape, each = Landscape(loaded), drops // samples
    for point in points:
        make_job(loaded, point, 0, landscape=landscape)  # raises InvalidValueError if impossible
    with DropProgress(loaded.name, each * samples, shown=progress) as bar:
        found = drop_points(
            loaded,
            points,
            each,
            seed,
            workers=workers,
            progress=bar.update,
            stopped=stopped,
            landscape=landscape,
        )
        bar.end(int(found.drops.sum()))
    kept = np.flatnonzero(found.drops == each).tolist()
    if len(kept) < 2:
        raise StoppedError('interrupted before two samples were complete: there is no result')
    names = sorted({name for draw in surface.draws for name in draw})
    return PropagatedResult(
        loaded,
        found.aspects,
        surface.conditions,
        tuple({name: getattr(points[k], name) for name in names} for k in kept),
        found.counts[kept],
        found.other[kept],
        each,
        seed,
        confidence,
        len(kept) == len(points),
    )
