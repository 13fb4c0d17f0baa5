"""What is optimised: the share of wanted aspects, or the entropy."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import entr

from resting_aspects_ros.arrays import Array, Counts
from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.report.format import list_text
from resting_aspects_ros.statistics.intervals import containing

# Differences that do not matter: 1 point of a share, and of an entropy in nat.
SHARE_TOLERANCE, ENTROPY_TOLERANCE = 0.01, 0.02
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
    def tolerance(self) -> float:
        """Difference of the value that does not matter."""
        return ENTROPY_TOLERANCE if self.is_entropy else SHARE_TOLERANCE

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
