"""What shares depend on, from counts along the lines of a design, without any model of them.

All variances of sampling are subtracted: they are known, because counts are multinomial.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy.stats import norm, t

from resting_aspects_ros.arrays import Array, Counts
from resting_aspects_ros.statistics.intervals import INTERVAL, bounds, containing
from resting_aspects_ros.studies.design import Design, Factor, Lines
from resting_aspects_ros.studies.points import Case

RESAMPLES = 400
WORTH, NOT_WORTH, OPEN = 'worth while', 'not worth while', 'not decided'


@dataclass(frozen=True, eq=False)
class LineCounts(Lines):
    """Counts along b lines of one factor, at l levels.

    counts : (b, l, c) int
        Each point has drops.
    """

    counts: Counts

    @classmethod
    def of(cls, table: Counts, lines: Lines) -> 'LineCounts | None':
        """Return the counts of a table (m, c) along lines; None if there are not two levels.

        Levels that are impossible everywhere are left out, and then lines with impossible points.
        """
        made = table.sum(axis=1)[lines.points] > 0
        levels = made.any(axis=0)
        kept = made[:, levels].all(axis=1)
        if levels.sum() < 2 or not kept.any():
            return None
        points = lines.points[np.ix_(kept, levels)]
        weights = lines.weights[levels] / lines.weights[levels].sum()
        fixed = lines.fixed or kept.sum() == 1
        return cls(points, lines.levels[levels], weights, bool(fixed), table[points])

    @property
    def drops(self) -> Counts:
        """(b, l) number of drops at each point."""
        return np.asarray(self.counts.sum(axis=2))

    @property
    def shares(self) -> Array:
        """(b, l, c) share of each column."""
        return np.asarray(self.counts / self.drops[..., None])

    @property
    def smooth_noise(self) -> Array:
        """(b, l, c) variance of each share by sampling; more than 0 without a drop, too."""
        drops = self.drops[..., None]
        smooth = (self.counts + 0.5) / (drops + 1)
        return np.asarray(smooth * (1 - smooth) / drops)


@dataclass(frozen=True, eq=False)
class Curve:
    """Shares over one factor, averaged over the lines.

    levels : (l,) float
        Values of the factor, from 0 to 1.
    each : (b, l, c) float
        Shares in each line.
    mean, lower, upper : (l, c) float
    """

    levels: Array
    each: Array
    mean: Array
    lower: Array
    upper: Array


def curve_of(line: LineCounts, confidence: float) -> Curve:
    """Return the mean curve over a factor with its interval at each level.

    The interval contains the sampling and, unless the lines are fixed, that the factor acts
    differently in other lines (Student's t). Lines are compared with themselves alone: that some
    are higher than others does not matter for what the factor does.
    """
    shares = line.shares
    means = np.einsum('blc,l->bc', shares, line.weights)[:, None]
    mean, error = _mean(shares - means + means.mean(axis=0), line.smooth_noise, line.fixed)
    reach = error * _quantile(line, confidence)
    # A share of 0 or 1 has the interval of a single binomial share.
    low, high = bounds(line.counts.sum(axis=0), line.drops.sum(axis=0), INTERVAL, confidence)
    return Curve(
        line.levels,
        shares,
        mean,
        np.clip(np.minimum(mean - reach, low), 0, 1),
        np.clip(np.maximum(mean + reach, high), 0, 1),
    )


def _mean(values: Array, noise: Array, fixed: bool) -> tuple[Array, Array]:
    """Return the mean over lines of values (b, ...), and its standard error."""
    sampling = noise.sum(axis=0) / len(values) ** 2
    if fixed:
        return values.mean(axis=0), np.sqrt(sampling)
    between = values.var(axis=0, ddof=1) / len(values)
    return values.mean(axis=0), np.sqrt(np.maximum(between, sampling))


def _quantile(line: LineCounts, confidence: float) -> float:
    """Return how many standard errors a two-sided interval of a mean reaches."""
    tail = (1 + confidence) / 2
    return float(norm.ppf(tail) if line.fixed else t.ppf(tail, len(line.counts) - 1))


@dataclass(frozen=True, eq=False)
class Change:
    """The largest change of a share between two levels of a factor.

    column : int
        The class.
    levels : (float, float)
        Two values of the factor, from 0 to 1, ascending.
    shares : (float, float)
        Mean of the share at both, over the lines.
    size, lower, upper : float
        Root mean square of the change over the lines, with its interval.
    lines : int
        Number of lines.
    """

    column: int
    levels: tuple[float, float]
    shares: tuple[float, float]
    size: float
    lower: float
    upper: float
    lines: int

    def verdict(self, tolerance: float) -> str:
        """Return whether it is worth while to measure or to control the factor."""
        if self.lower > tolerance:
            return WORTH
        return NOT_WORTH if self.upper <= tolerance else OPEN


def largest_change(line: LineCounts, confidence: float) -> Change:
    """Return the largest change of a share between two levels of a factor.

    Its size is the root mean square over the lines, so that changes in opposite directions, with
    other values of the other factors, do not cancel. The square of a difference with the variance
    v of sampling is too large by v, which is subtracted.

    The upper bound is that of the pair of levels and the class with the largest one: it holds for
    the pair that changes most, whichever this is. For the lower bound, the intervals of all pairs
    and classes hold together (Bonferroni).
    """
    pairs = list(combinations(range(len(line.levels)), 2))
    i, j = np.array(pairs).T
    moved = line.shares[:, j] - line.shares[:, i]
    noise = line.smooth_noise[:, i] + line.smooth_noise[:, j]
    squares = moved**2 - noise
    sampling = 2 * noise**2 + 4 * noise * np.maximum(squares.mean(axis=0), 0)
    square, of_square = _mean(squares, sampling, line.fixed)
    mean, of_mean = _mean(moved, noise, line.fixed)
    occurring = max(1, int((line.counts.sum(axis=(0, 1)) > 0).sum()))
    strict = _quantile(line, 1 - (1 - confidence) / (2 * len(pairs) * occurring))
    # The root mean square is at least the mean, which fewer lines are enough for.
    below = max((square - strict * of_square).max(), 0) ** 0.5
    lower = max(below, (np.abs(mean) - strict * of_mean).max())
    upper = max((square + _quantile(line, confidence) * of_square).max(), 0) ** 0.5
    pair, column = np.unravel_index(square.argmax(), square.shape)
    size = max(square[pair, column], 0) ** 0.5
    shares, (i, j) = line.shares.mean(axis=0)[:, column], pairs[pair]
    return Change(
        int(column),
        (float(line.levels[i]), float(line.levels[j])),
        (float(shares[i]), float(shares[j])),
        float(size),
        float(min(lower, size)),
        float(upper),
        len(line.counts),
    )


@dataclass(frozen=True, eq=False)
class SobolIndices:
    """First and total Sobol indices of c columns, and of all together, over d factors.

    first, total : (c + 1, d) float
        The last row is that of all columns: the variances of all are added. NaN for a column
        whose shares are not shown to vary.
    first_bounds, total_bounds : (2, c + 1, d) float
        Their intervals, by bootstrap.
    """

    first: Array
    total: Array
    first_bounds: Array
    total_bounds: Array


def indices_of(
    lines: Sequence[LineCounts], confidence: float, random: np.random.Generator
) -> SobolIndices:
    """Return the Sobol indices of the shares.

    The first index is the variance of the mean curve, and the total index is the mean of the
    variances along the lines, both relative to the variance over the cube (Saltelli et al. 2010,
    Computer Physics Communications 181:259). The bootstrap draws lines or, if these are fixed,
    drops.
    """
    plain = _indices([_variances(each, each.shares) for each in lines])
    resampled = []
    for _ in range(RESAMPLES):
        uniform = random.random(max(len(each.counts) for each in lines))
        resampled.append(_indices([_resampled(each, uniform, random) for each in lines]))
    first, total, variance = (np.array(each) for each in zip(*resampled, strict=True))
    tails = (1 - confidence) / 2, (1 + confidence) / 2
    varies = np.quantile(variance, tails[0], axis=0) > 0
    found = []
    for own, drawn in ((plain[0], first), (plain[1], total)):
        stated = np.where(varies[:, None], own, np.nan)
        interval = np.full((2, *own.shape), np.nan)
        if varies.any():
            quantiles = np.nanquantile(drawn[:, varies], tails, axis=0)
            interval[:, varies] = containing(own[varies], *quantiles)
        found += [stated, interval]
    return SobolIndices(found[0], found[2], found[1], found[3])


def _resampled(
    line: LineCounts, uniform: Array, random: np.random.Generator
) -> tuple[Array, Array, Array]:
    """Return the variances of lines, or of drops, that are drawn again."""
    if line.fixed:
        counts = random.multinomial(line.drops, line.shares)
        shares = counts / line.drops[..., None]
        return _variances(line, shares)
    b = len(line.counts)
    chosen = (uniform[:b] * b).astype(np.int64)
    again = replace(line, counts=line.counts[chosen], points=line.points[chosen])
    return _variances(again, again.shares)


def _variances(line: LineCounts, shares: Array) -> tuple[Array, Array, Array]:
    """Return the variances (c,) of the mean curve, along the lines, and over the cube."""
    b, weights = len(shares), line.weights[:, None]
    noise = shares * (1 - shares) / np.maximum(line.drops - 1, 1)[..., None]
    means = (weights * shares).sum(axis=1)
    along = (weights * (shares - means[:, None]) ** 2).sum(axis=1)
    along = (along - (weights * (1 - weights) * noise).sum(axis=1)).mean(axis=0)
    between = means.var(axis=0) - (1 - 1 / b) * (weights**2 * noise).sum(axis=1).mean(axis=0)
    curve = shares.mean(axis=0)
    first = (weights * (curve - curve.T @ line.weights) ** 2).sum(axis=0)
    if line.fixed:
        first -= (weights * (1 - weights) * noise.sum(axis=0)).sum(axis=0) / b**2
    else:
        centred = shares - means[:, None]
        first -= (weights * centred.var(axis=0, ddof=1)).sum(axis=0) / b
    return first, along, along + between


def _indices(variances: Sequence[tuple[Array, Array, Array]]) -> tuple[Array, Array, Array]:
    """Return first and total indices (c + 1, d), and the variance (c + 1,) over the cube."""
    first, along, whole = (np.array(each).T for each in zip(*variances, strict=True))
    first, along, whole = (np.vstack([each, each.sum(axis=0)]) for each in (first, along, whole))
    variance = whole.mean(axis=1)
    known = np.where(variance > 0, variance, np.nan)[:, None]
    return first / known, along / known, variance


@dataclass(frozen=True, eq=False)
class Effects:
    """What d factors do to the shares of a case.

    curves, changes : tuple of Curve and of Change, or None
        By factor; None for one with fewer than two possible levels.
    indices : SobolIndices or None
        None if a factor has no effect that could be computed.
    """

    curves: tuple[Curve | None, ...]
    changes: tuple[Change | None, ...]
    indices: SobolIndices | None


def effects_of(case: Case, design: Design, seed: int, confidence: float) -> Effects | None:
    """Return the effects of the factors on a case; None if its shares cannot vary."""
    if len(case.columns) < 2 or not case.drops.any():
        return None
    lines = [LineCounts.of(case.table, each) for each in design.lines]
    known = [line for line in lines if line is not None]
    indices = None
    if len(known) == len(lines):
        indices = indices_of(known, confidence, np.random.default_rng((seed, 8)))
    return Effects(
        tuple(None if line is None else curve_of(line, confidence) for line in lines),
        tuple(None if line is None else largest_change(line, confidence) for line in lines),
        indices,
    )


@dataclass(frozen=True)
class Finding:
    """What one factor does to one case, in words.

    verdict : str
        Whether it is worth while to measure or to control the factor: WORTH, NOT_WORTH or OPEN.
    sentence : str
        The largest change and the verdict.
    details : str
        Where that change is.
    """

    case: str
    factor: str
    verdict: str
    sentence: str
    details: str = ''

    @property
    def text(self) -> str:
        """The sentence and the details."""
        return f'{self.sentence} {self.details}'.rstrip()


def findings_of(
    case: Case,
    effects: Effects | None,
    factors: Sequence[Factor],
    tolerance: float,
    confidence: float,
) -> Iterator[Finding]:
    """Yield a finding for each factor, that with the largest change first."""
    changes = (None,) * len(factors) if effects is None else effects.changes
    for k in np.argsort([1.0 if each is None else -each.size for each in changes]).tolist():
        factor, change = factors[k], changes[k]
        title = factor.label or factor.name
        title, details = f'{title[0].upper()}{title[1:]}', ''
        if change is not None:
            verdict, details = change.verdict(tolerance), _where(change, case, factor)
            sentence = f'{title} {_sentence(change, tolerance, confidence)}'
        elif len(case.columns) < 2 and case.drops.any():
            verdict = NOT_WORTH
            sentence = f'{title} cannot move the shares: all drops are in {case.columns[0]}.'
        else:
            verdict = OPEN
            sentence = f'{title}: too few points with drops to tell what it does.'
        yield Finding(case.name, factor.name, verdict, sentence, details)


def _sentence(change: Change, tolerance: float, confidence: float) -> str:
    limit = f'the tolerance of {points_text(tolerance)} points'
    mean = '' if change.lines == 1 else 'root mean square; '
    moved = (
        f'moves the shares by up to {points_text(change.size)} points ({mean}'
        f'{100 * confidence:g} % interval {points_text(change.lower)} to '
        f'{points_text(change.upper)})'
    )
    return {
        WORTH: f'{moved}, more than {limit}: measuring it is worth while.',
        NOT_WORTH: f'{moved}, not more than {limit}: measuring it is not worth while.',
        OPEN: f'{moved}, which contains {limit}: more drops would decide whether measuring it is '
        'worth while.',
    }[change.verdict(tolerance)]


def _where(change: Change, case: Case, factor: Factor) -> str:
    """Say where the largest change is."""
    ends = [factor.text(float(factor.values(np.array(level)))) for level in change.levels]
    mean = '' if change.lines == 1 else ', on average over the other factors'
    return (
        f'The share of {case.columns[change.column]} is {100 * change.shares[0]:.1f} % at '
        f'{ends[0]} and {100 * change.shares[1]:.1f} % at {ends[1]}{mean}.'
    )


def points_text(share: float) -> str:
    """Return a difference of shares in points, such as '3.1' or '12'."""
    value = 100 * share
    return f'{value:.2g}' if abs(value) < 10 else f'{value:.0f}'
