"""What is optimised: the share of wanted aspects, or the entropy of the distribution."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import entr

from resting_aspects_ros.core.aspects.aspect_set import AspectSet
from resting_aspects_ros.core.errors import InvalidValueError, shown
from resting_aspects_ros.studies.wanted_contacts import WantedContacts

Array = npt.NDArray[np.float64]
Counts = npt.NDArray[np.int64]

# Differences that do not matter: 1 point of a share, and of an entropy in nat.
SHARE_TOLERANCE, ENTROPY_TOLERANCE = 0.01, 0.02
# Pseudo-drops of the Dirichlet prior, divided among the outcomes: 1 drop in all (Perks 1947).
PRIOR = 1.0


@dataclass(frozen=True)
class Objective:
    """The share of wanted aspects, which is maximised, or the entropy, which is minimised.

    wanted : tuple of int
        Ids of the wanted aspects, ascending; empty for the entropy.
    groups : tuple of tuple of int
        Ids of the aspects of each outcome that is distinguished: the wanted aspects, or the
        members of each symmetry class. All other ends of a drop are one more outcome, the last.
    contacts : tuple of WantedContacts
        Wanted instead of aspects: the counts then have two columns, and ``groups`` is the first.
    """

    wanted: tuple[int, ...]
    groups: tuple[tuple[int, ...], ...]
    contacts: tuple[WantedContacts, ...] = ()

    @property
    def is_entropy(self) -> bool:
        """Whether the entropy is minimised."""
        return not self.wanted and not self.contacts

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
        if self.contacts:
            return f'largest share of {" or ".join(f"({c.text})" for c in self.contacts)}'
        noun = 'aspect' if len(self.wanted) == 1 else 'aspects'
        return f'largest share of {noun} {listed(map(str, self.wanted))}'

    def columns(self, counts: Counts, other: Counts) -> Counts:
        """Return counts (..., c) of the outcomes.

        Parameters
        ----------
        counts : (..., k) int
            Drops in each aspect, by id from 1.
        other : (..., 5) int
            Drops that ended in no aspect.
        """
        each = [counts[..., [k - 1 for k in ids]].sum(axis=-1) for ids in self.groups]
        rest = counts.sum(axis=-1) + other.sum(axis=-1) - sum(each)
        return np.stack([*each, rest], axis=-1)

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

    def scores(self, shares: Array) -> Array:
        """Return the value, or its negative if less is better."""
        return self.sign * self.values(shares)

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


def make_objective(
    aspects: AspectSet,
    wanted: Sequence[int] | None = None,
    wanted_classes: Sequence[int] | None = None,
    *,
    minimise_entropy: bool = False,
    contacts: Sequence[WantedContacts] = (),
) -> Objective:
    """Return an objective; raises InvalidValueError unless exactly one is given and known."""
    given = [wanted is not None, wanted_classes is not None, bool(contacts), minimise_entropy]
    if sum(given) != 1:
        raise InvalidValueError(
            'invalid objective: expected one of wanted aspects, wanted classes, wanted contacts '
            'and least entropy'
        )
    if contacts:
        return Objective((), ((1,),), tuple(contacts))
    members = tuple(tuple(a.id for a in each) for each in aspects.classes())
    if minimise_entropy:
        if len(members) < 2:
            raise InvalidValueError(
                f'invalid objective least entropy: expected a part with several symmetry classes '
                f'of aspects, not {len(members)}'
            )
        return Objective((), members)
    if wanted is not None:
        ids = _checked('aspect', wanted, len(aspects))
    else:
        numbers = _checked('symmetry class', wanted_classes or (), len(members))
        ids = tuple(sorted(k for number in numbers for k in members[number - 1]))
    return Objective(ids, (ids,))


def listed(words: 'Sequence[str] | map[str]') -> str:
    """Return words as a list in a sentence, such as 'a, b and c'."""
    known = list(words)
    return known[0] if len(known) == 1 else f'{", ".join(known[:-1])} and {known[-1]}'


def _checked(what: str, numbers: Sequence[int], limit: int) -> tuple[int, ...]:
    if not len(numbers):
        raise InvalidValueError(f'invalid wanted {what}: expected at least one')
    for k in numbers:
        if isinstance(k, bool) or not isinstance(k, int | np.integer) or not 1 <= k <= limit:
            raise InvalidValueError(f'invalid wanted {what} {shown(k)}: expected 1 to {limit}')
    return tuple(sorted({int(k) for k in numbers}))
