"""What shares depend on, from counts along the lines of a design, without any model of them.

All variances of sampling are subtracted: they are known, because counts are multinomial.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy.stats import norm, t

from resting_aspects_ros.arrays import Array, Counts
from resting_aspects_ros.statistics.comparison import square_and_add
from resting_aspects_ros.statistics.intervals import INTERVAL, bounds, containing
from resting_aspects_ros.studies.design import Design, Factor, Lines
from resting_aspects_ros.studies.points import Case

RESAMPLES = 400
# Lines of a factor that get fresh drops, because the largest changes are expected there, and how
# many times as many drops as other points they get.
FRESH_LINES, FRESH_DROPS = 4, 8
# Largest number of times that is stated; more are not practical.
MAX_TIMES = 100
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
        The share at both.
    lower, upper : float
        Interval of the size of the largest change.
    points : (int, int) or None
        Where it is, as points of the design; None: on average over the lines.
    """

    column: int
    levels: tuple[float, float]
    shares: tuple[float, float]
    lower: float
    upper: float
    points: tuple[int, int] | None = None

    @property
    def size(self) -> float:
        """Size of the change."""
        return abs(self.shares[1] - self.shares[0])


def mean_change(line: LineCounts, confidence: float) -> Change:
    """Return the largest change of the mean curve.

    The upper bound is that of the pair of levels and the class with the largest one: it holds for
    the pair that changes most, whichever this is. For the lower bound, the intervals of all pairs
    and classes hold together (Bonferroni).
    """
    pairs, values, noise = _differences(line)
    mean, error = _mean(values, noise, line.fixed)
    occurring = max(1, int((line.counts.sum(axis=(0, 1)) > 0).sum()))
    strict = 1 - (1 - confidence) / (2 * len(pairs) * occurring)
    size = np.abs(mean)
    pair, column = np.unravel_index(size.argmax(), size.shape)
    i, j = pairs[pair]
    shares = line.shares.mean(axis=0)[:, column]
    return Change(
        int(column),
        (float(line.levels[i]), float(line.levels[j])),
        (float(shares[i]), float(shares[j])),
        max(0.0, float((size - _quantile(line, strict) * error).max())),
        float((size + _quantile(line, confidence) * error).max()),
    )


def _differences(line: LineCounts) -> tuple[list[tuple[int, int]], Array, Array]:
    """Return pairs of levels, and the changes (b, pairs, c) between them with their variances."""
    pairs = list(combinations(range(len(line.levels)), 2))
    i, j = np.array(pairs).T
    noise = line.smooth_noise
    return pairs, line.shares[:, j] - line.shares[:, i], noise[:, i] + noise[:, j]


@dataclass(frozen=True)
class Candidate:
    """Two points of a line, between which a share seems to change most."""

    points: tuple[int, int]
    levels: tuple[float, float]
    column: int


def largest_candidates(line: LineCounts) -> list[Candidate]:
    """Return where in the lines the largest changes are expected, at most FRESH_LINES of them.

    The change in a line is a mean of its own drops and of the change in all lines, weighted by
    their variances (James and Stein 1961), so that the luckiest line is not taken for the largest.
    """
    pairs, values, noise = _differences(line)
    expected = values
    if len(values) > 1:
        mean, between = values.mean(axis=0), values.var(axis=0, ddof=1)
        own = np.clip(1 - noise.mean(axis=0) / np.maximum(between, 1e-300), 0, 1)
        expected = mean + own * (values - mean)
    size = np.abs(expected)
    order = np.argsort(-size.max(axis=(1, 2)), kind='stable')[:FRESH_LINES]
    found = []
    for b in order.tolist():
        pair, column = np.unravel_index(size[b].argmax(), size.shape[1:])
        i, j = pairs[pair]
        ends = int(line.points[b, i]), int(line.points[b, j])
        found.append(Candidate(ends, (float(line.levels[i]), float(line.levels[j])), int(column)))
    return found


def fresh_change(
    candidates: Sequence[Candidate], tables: Sequence[Counts], confidence: float
) -> Change:
    """Return the largest change at candidates, by fresh drops (2, c) at each of them.

    The drops that selected the candidates are not used, so that the change is not that of the
    luckiest line. The bounds are Newcombe's; see `mean_change` for their choice.
    """
    strict = 1 - (1 - confidence) / (2 * len(candidates))
    lower = upper = largest = -1.0
    best: tuple[Candidate, tuple[float, float]] | None = None
    for candidate, table in zip(candidates, tables, strict=True):
        counts, drops = table[:, candidate.column], table.sum(axis=1)
        low, high = (float(share) for share in counts / drops)
        lower = max(lower, _size_bounds(counts, drops, strict)[0])
        upper = max(upper, _size_bounds(counts, drops, confidence)[1])
        if abs(high - low) > largest:
            largest, best = abs(high - low), (candidate, (low, high))
    assert best is not None
    found, shares = best
    return Change(found.column, found.levels, shares, lower, upper, found.points)


def _size_bounds(counts: Counts, drops: Counts, confidence: float) -> tuple[float, float]:
    """Return the bounds of the size of the difference of two shares; counts and drops (2,)."""
    shares = counts / drops
    low, high = bounds(counts[:, None], drops, INTERVAL, confidence)
    below, above = square_and_add(shares[1:], (low[1], high[1]), shares[:1], (low[0], high[0]))
    return max(0.0, float(below[0]), -float(above[0])), max(float(above[0]), -float(below[0]))


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
class FactorEffect:
    """What one factor does to the shares of a case.

    mean, largest : Change or None
        Largest change on average over the other factors; and wherever they are, by fresh drops.
        ``largest`` is None if there is only one line, or without fresh drops.
    lines : int
        Number of lines.
    """

    curve: Curve
    mean: Change
    largest: Change | None
    lines: int

    @property
    def most(self) -> Change:
        """The larger one of both changes."""
        if self.largest is None or self.largest.size < self.mean.size:
            return self.mean
        return self.largest

    @property
    def lower(self) -> float:
        """Lower bound of the largest change."""
        return max(self.mean.lower, 0.0 if self.largest is None else self.largest.lower)

    @property
    def upper(self) -> float:
        """Upper bound of the largest change; 1 if nothing is known of single lines."""
        if self.largest is None:
            return self.mean.upper if self.lines == 1 else 1.0
        return max(self.mean.upper, self.largest.upper)

    def verdict(self, tolerance: float) -> str:
        """Return whether it is worth while to measure or to control the factor."""
        if self.lower > tolerance:
            return WORTH
        return NOT_WORTH if self.upper <= tolerance else OPEN


@dataclass(frozen=True, eq=False)
class Effects:
    """What d factors do to the shares of a case.

    factors : tuple of FactorEffect or None
        None for a factor with fewer than two possible levels.
    indices : SobolIndices or None
        None if a factor has no effect that could be computed.
    """

    factors: tuple[FactorEffect | None, ...]
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
    factors = tuple(
        None if line is None else _factor_effect(line, case, confidence) for line in lines
    )
    return Effects(factors, indices)


def _factor_effect(line: LineCounts, case: Case, confidence: float) -> FactorEffect:
    largest = None
    candidates = largest_candidates(line) if len(line.counts) > 1 else []
    if candidates and all(case.fresh.keys() >= set(each.points) for each in candidates):
        tables = [np.array([case.fresh[k] for k in each.points]) for each in candidates]
        largest = fresh_change(candidates, tables, confidence)
    curve, mean = curve_of(line, confidence), mean_change(line, confidence)
    return FactorEffect(curve, mean, largest, len(line.counts))


def fresh_points(case: Case, design: Design) -> list[int]:
    """Return the points of a case that get fresh drops: where shares seem to change most."""
    found: dict[int, None] = {}
    for each in design.lines:
        line = LineCounts.of(case.table, each)
        if line is not None and len(line.counts) > 1 and len(case.columns) > 1:
            for candidate in largest_candidates(line):
                found |= dict.fromkeys(candidate.points)
    return list(found)


@dataclass(frozen=True)
class Finding:
    """What one factor does to one case, in words.

    verdict : str
        Whether it is worth while to measure or to control the factor: WORTH, NOT_WORTH or OPEN.
    sentence : str
        The largest change and the verdict.
    details : str
        Where that change is, and how large it is on average.
    """

    case: str
    factor: str
    verdict: str
    sentence: str
    details: str = ''


def findings_of(
    case: Case,
    effects: Effects | None,
    design: Design,
    factors: Sequence[Factor],
    tolerance: float,
    confidence: float,
) -> Iterator[Finding]:
    """Yield a finding for each factor, that with the largest change first."""
    each = (None,) * len(factors) if effects is None else effects.factors
    for k in np.argsort([1.0 if e is None else -e.most.size for e in each]).tolist():
        effect, name = each[k], factors[k].label or factors[k].name
        title, details = f'{name[0].upper()}{name[1:]}', ''
        if effect is not None:
            verdict, details = effect.verdict(tolerance), _where(effect, case, design, factors, k)
            sentence = f'{title}{_sentence(effect, tolerance, confidence)}'
        elif len(case.columns) < 2 and case.drops.any():
            verdict = NOT_WORTH
            sentence = f'{title} cannot move the shares: all drops are in {case.columns[0]}.'
        else:
            verdict = OPEN
            sentence = f'{title}: too few points with drops to tell what it does.'
        yield Finding(case.name, factors[k].name, verdict, sentence, details)


def _sentence(effect: FactorEffect, tolerance: float, confidence: float) -> str:
    """Return the finding after the name of the factor."""
    size, limit = effect.most.size, f'the tolerance of {points_text(tolerance)} points'
    moved = (
        f' moves the shares by up to {points_text(size)} points '
        f'({100 * confidence:g} % interval {points_text(effect.lower)} to '
        f'{points_text(effect.upper)})'
    )
    verdict = effect.verdict(tolerance)
    if verdict == WORTH:
        return f'{moved}, more than {limit}: measuring it is worth while.'
    if verdict == NOT_WORTH:
        return f'{moved}, not more than {limit}: measuring it is not worth while.'
    if effect.largest is None and effect.lines > 1:
        return ': the drops do not tell yet whether measuring it is worth while.'
    half = (effect.upper - effect.lower) / 2
    times = max(2, math.ceil((half / max(abs(size - tolerance), 1e-9)) ** 2))
    number = f'about {times}' if times <= MAX_TIMES else f'more than {MAX_TIMES}'
    return (
        f'{moved}, which contains {limit}: {number} times as many drops would decide whether '
        'measuring it is worth while.'
    )


def _where(
    effect: FactorEffect, case: Case, design: Design, factors: Sequence[Factor], k: int
) -> str:
    """Say where the largest change is, and how large it is on average."""
    change, mean, factor = effect.most, effect.mean, factors[k]
    ends = [factor.text(float(factor.values(np.array(level)))) for level in change.levels]
    text = (
        f'The share of {case.columns[change.column]} is {100 * change.shares[0]:.1f} % at '
        f'{ends[0]} and {100 * change.shares[1]:.1f} % at {ends[1]}'
    )
    if effect.lines == 1:
        return f'{text}.'
    if change.points is None:
        return f'{text}, on average over the other factors.'
    place = design.points[change.points[0]]
    others = [
        f'{each.label or each.name} {each.text(float(each.values(place[j])))}'
        for j, each in enumerate(factors)
        if j != k
    ]
    return (
        f'{text}, with {" and ".join(others)}. On average over the other factors, shares move by '
        f'at most {points_text(mean.size)} points ({points_text(mean.lower)} to '
        f'{points_text(mean.upper)}).'
    )


def points_text(share: float) -> str:
    """Return a difference of shares in points, such as '3.1' or '12'."""
    value = 100 * share
    return f'{value:.2g}' if abs(value) < 10 else f'{value:.0f}'
