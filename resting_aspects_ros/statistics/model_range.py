"""The range of a probability on a real surface, which is wider than its sampling interval.

The sampling interval states how exact the simulation of these conditions is. The model range
states where the probability on a real surface is, if no parts were counted on it. On the log odds,
three variances add up: that of the sampling; that between draws of the conditions that are not
known exactly; and the discrepancy of the model, by which shares that were measured by hand and by
machines differ from simulated ones beyond sampling.
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import expit, logit, ndtri

from resting_aspects_ros.arrays import Array, Counts
from resting_aspects_ros.statistics.distribution import Distribution
from resting_aspects_ros.statistics.intervals import CONFIDENCE, Interval, bounds

# Standard deviation of the discrepancy on the log odds at a share of 1/2, and the power of
# 4 p (1 - p) with which it grows for rare and for frequent outcomes. The first is estimated on the
# measured bodies of config/counts, which do not determine the second; see
# docs/explanation/validation.md, "Measured shares".
DISCREPANCY, POWER = 0.3, 0.25
# Odds are not computed of shares that are nearer to 0 or 1.
_MIN_SHARE = 1e-9


@dataclass(frozen=True, eq=False)
class Draws:
    """Outcomes of drops at draws of the conditions that are not known exactly.

    ids : (s, m) int
        Aspect of drop i of draw j; 0 if it ended in none.
    uncertain : tuple of str
        Conditions that differ between the draws.
    about : bool
        Whether ranges are about the shares of the draws; otherwise about those of the
        distribution, for drops that were simulated in another way than the draws.
    """

    ids: Counts
    uncertain: tuple[str, ...]
    about: bool = True


@dataclass(frozen=True, eq=False)
class ModelRange:
    """Ranges of the probabilities on a real surface.

    by_aspect : (k, 2) float
        Lower and upper bounds by aspect.
    by_class : (c, 2) float
        The same by symmetry class.
    uncertain : tuple of str
        Conditions whose uncertainty the ranges cover. Empty: the conditions are taken as exact,
        and the ranges cover only the discrepancy of the model.
    confidence : float
        Of each range by itself.
    draws : Draws or None
        Where the ranges are from; documents and messages do not have it.
    """

    by_aspect: Array
    by_class: Array
    uncertain: tuple[str, ...] = ()
    confidence: float = CONFIDENCE
    draws: Draws | None = None

    def of_classes(self) -> 'ModelRange':
        """Return the ranges of the symmetry classes in the place of those of the aspects."""
        return dataclasses.replace(self, by_aspect=self.by_class, draws=None)


def discrepancy(shares: npt.ArrayLike, scale: float = DISCREPANCY) -> Array:
    """Return the standard deviation of the model's discrepancy on the log odds of shares."""
    p = np.clip(shares, _MIN_SHARE, 1 - _MIN_SHARE)
    return np.asarray(scale * (4 * p * (1 - p)) ** -POWER)


def between_variance(hits: npt.NDArray[np.bool_]) -> float:
    """Return the variance of a probability between s draws of the conditions.

    Drop i has the same random numbers in every draw, so that the outcomes are a two-way table of
    draws and drops. The mean square of their interaction is the noise (two-way analysis of
    variance with one observation in each cell; Scheffe, The Analysis of Variance, 1959, chapter
    4.8). It is less than p (1 - p) if drops with the same numbers end alike.

    Parameters
    ----------
    hits : (s, m) bool
        Whether drop i of draw j ended in the outcome. 0 is returned for less than two of either.
    """
    s, m = hits.shape
    if min(s, m) < 2:
        return 0.0
    of_draws, of_drops, mean = hits.mean(axis=1), hits.mean(axis=0), hits.mean()
    squares = s * m * mean - m * (of_draws**2).sum() - s * (of_drops**2).sum() + s * m * mean**2
    noise = squares / ((s - 1) * (m - 1))
    return max(0.0, float(of_draws.var(ddof=1) - noise / m))


def independent_drops(hits: npt.NDArray[np.bool_]) -> int:
    """Return the number of independent drops whose share is as exact as that of all draws.

    It is between m, if drops with the same random numbers end alike in all draws, and s m.

    hits : (s, m) bool
        Whether drop i of draw j ended in the outcome.
    """
    s, m = (int(each) for each in hits.shape)
    share, variance = float(hits.mean()), float(hits.mean(axis=0).var()) / m
    return min(max(m, round(share * (1 - share) / variance)), s * m) if variance else m


def model_bounds(
    counts: npt.ArrayLike,
    drops: npt.ArrayLike,
    between: npt.ArrayLike,
    confidence: float,
    scale: float = DISCREPANCY,
) -> Array:
    """Return the lower and upper bounds (k, 2) of the probabilities on a real surface.

    The distances of Wilson's bounds from the share, and the quantile of the other deviations, are
    added in quadrature on the log odds (MOVER: Zou and Donner, Statistics in Medicine 27, 2008).

    Parameters
    ----------
    counts : (k,) int
        Drops in each outcome, over all draws of the conditions.
    drops : int or (k,) int
        Number of these drops, as independent ones.
    between : float or (k,) float
        Variance of each probability between draws of the conditions; 0 if they are exact.
    confidence : float
        Of each range by itself.
    scale : float
        Discrepancy of the model at a share of 1/2.
    """
    c = np.asarray(counts, dtype=np.int64)
    n = np.broadcast_to(np.maximum(drops, 1), c.shape)
    z = float(ndtri((1 + confidence) / 2))
    share = (c + 0.5) / (n + 1)
    deviation = np.sqrt(between) / (share * (1 - share))
    spread = z * np.hypot(discrepancy(share, scale), deviation)
    centre, found = logit(share), []
    sampling = bounds(c[:, np.newaxis], n, confidence=confidence)
    for (bound,), sign in zip((each.T for each in sampling), (-1, 1), strict=True):
        away = sign * (logit(np.clip(bound, _MIN_SHARE, 1 - _MIN_SHARE)) - centre)
        wider = expit(centre + sign * np.hypot(np.maximum(away, 0), spread))
        # What was never seen can be impossible, and what always occurred certain.
        found.append(np.where((bound == 0) | (bound == 1), bound, wider))
    return np.stack(found, axis=-1)


def with_model_range(distribution: Distribution, draws: Draws | None = None) -> Distribution:
    """Return the distribution with the ranges of its aspects and symmetry classes.

    Each range holds by itself, with the confidence of the distribution, and contains the sampling
    interval.

    Parameters
    ----------
    distribution : Distribution
        Drops under the nominal conditions.
    draws : Draws, optional
        Drops over the uncertainty of the conditions. None: the conditions are taken as exact.
    """
    members = [tuple(each.id for each in alike) for alike in distribution.aspects.classes()]
    by_class = np.array([_range(distribution, ids, draws) for ids in members]).reshape(-1, 2)
    by_aspect = np.zeros((len(distribution.aspects), 2))
    for ids, (lower, upper) in zip(members, by_class, strict=True):
        # Aspects that a symmetry exchanges have equal probabilities on any surface.
        by_aspect[np.array(ids) - 1] = lower / len(ids), upper / len(ids)
    by_aspect = _containing(distribution, by_aspect)
    by_class = _containing(distribution.by_class(), by_class)
    uncertain = () if draws is None else draws.uncertain
    model = ModelRange(by_aspect, by_class, uncertain, distribution.confidence, draws)
    return dataclasses.replace(distribution, model=model)


def combined_range(distribution: Distribution, ids: Sequence[int]) -> Interval | None:
    """Return the model range of the probability to rest in any of several aspects.

    None if it is not known: for distributions without ranges, or from a document or a message.
    """
    sampling, model = distribution.combined_interval(ids), distribution.model
    if model is None or (model.uncertain and model.draws is None):
        return None
    return Interval(sampling.probability, *_range(distribution, ids, model.draws))


def _range(given: Distribution, ids: Sequence[int], draws: Draws | None) -> tuple[float, float]:
    """Return the range of several aspects together; it contains their sampling interval."""
    drops, count = given.drops, int(given.counts[np.array(ids) - 1].sum())
    between = 0.0
    if draws is not None:
        hits = np.isin(draws.ids, ids)
        between = between_variance(hits)
        if draws.about:
            drops = independent_drops(hits)
            count = round(drops * float(hits.mean()))
    ((low, high),) = model_bounds([count], drops, between, given.confidence).tolist()
    sampling = given.combined_interval(ids)
    return min(low, sampling.lower), max(high, sampling.upper)


def _containing(given: Distribution, ranges: Array) -> Array:
    """Return ranges (k, 2) that contain the sampling intervals, too."""
    sampling = np.array([(each.lower, each.upper) for each in given.intervals()]).reshape(-1, 2)
    low = np.minimum(ranges[:, 0], sampling[:, 0])
    return np.stack([low, np.maximum(ranges[:, 1], sampling[:, 1])], axis=1)
