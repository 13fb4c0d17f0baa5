"""The distribution of drops over the aspects of a part: counts, probabilities, intervals.

Its history is a sample of the counts after growing numbers of drops.
"""

import dataclasses
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.aspects.aspect_set import AspectSet
from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.poses import RestingPoses, RestStatus
from resting_aspects_ros.core.statistics.contact_counts import Placements
from resting_aspects_ros.core.statistics.intervals import (
    CONFIDENCE,
    INTERVAL,
    Counts,
    Interval,
    intervals,
)
from resting_aspects_ros.core.statistics.stopping import stopping_confidence, stops

METHOD = 'drops'
# Names of the counts of drops that are at rest in no aspect.
OUTSIDE = ('unclassified', 'unsettled', 'failed', 'lost', 'sliding')
# The counts are first sampled after this number of drops, then this often for each factor of ten.
FIRST_SAMPLE = 10
SAMPLES_PER_DECADE = 10


@dataclass(frozen=True, eq=False)
class Distribution:
    """Counts of the drops of a run by aspect; each drop is counted exactly once.

    counts : (k,) int
        Drops at rest in each aspect, by id from 1.
    unclassified, unsettled, failed : int
        Drops at rest in no aspect, drops not at rest on the surface within the time limit, and
        drops with numerical errors.
    lost, sliding : int
        Parts that left the surroundings, and parts that still slide or roll on them at the end.
    interval : str
        Method of the intervals, one of intervals.METHODS.
    confidence : float
        Confidence of the intervals.
    by_precision : bool
        Whether the run stopped when its intervals were narrow enough.
    energy_growth : float
        Maximum energy_growth of the drops, m g R; see RestingPoses.
    contacts : Placements or None
        The same drops by what they touch, if the surroundings have walls and this was counted.
    """

    aspects: AspectSet
    counts: npt.NDArray[np.int64]
    unclassified: int
    unsettled: int
    failed: int
    interval: str = INTERVAL
    confidence: float = CONFIDENCE
    by_precision: bool = False
    energy_growth: float = 0.0
    lost: int = 0
    sliding: int = 0
    contacts: Placements | None = None

    @property
    def drops(self) -> int:
        """Number of drops that were counted."""
        return int(self.counts.sum() + sum(getattr(self, name) for name in OUTSIDE))

    def intervals(self) -> list[Interval]:
        """Return count / drops of each aspect with its interval, for n = drops; see intervals.

        The lower bound of a count of zero is zero; the upper bound limits the probability of an
        aspect that was never seen. Without drops the interval is 0 to 1. After a stop by precision
        the intervals are slightly wider, to preserve their coverage; see stopping.
        """
        return self._intervals(self.counts)

    def combined_interval(self, ids: Iterable[int]) -> Interval:
        """Return the probability to rest in any of several aspects, with its interval.

        Raises InvalidValueError if the part has no aspect with one of the ids.
        """
        max_id = len(self.counts)
        for k in set(ids):
            if not 1 <= k <= max_id:
                raise InvalidValueError(f'invalid aspect {k!r}: expected 1 to {max_id}')
        count = self.counts[[k - 1 for k in sorted(set(ids))]].sum()
        return self._intervals(count[None])[0]

    def _intervals(self, counts: npt.NDArray[np.int64]) -> list[Interval]:
        stopped = stopping_confidence(self.confidence) if self.by_precision else self.confidence
        return intervals(counts, self.drops, self.interval, stopped)

    def stops(self, precision: float, drop_limit: int) -> bool:
        """Return whether a run stops with these counts; see stopping."""
        return stops(
            self.counts, self.drops, precision, drop_limit, self.interval, self.confidence
        )

    def by_class(self) -> 'Distribution':
        """Return the distribution over the symmetry classes, in their order."""
        classes = [[a.id - 1 for a in members] for members in self.aspects.classes()]
        counts = np.array([self.counts[ids].sum() for ids in classes], dtype=np.int64)
        return dataclasses.replace(self, counts=counts)

    def __add__(self, other: 'Distribution') -> 'Distribution':
        """Return the distribution over the drops of both: different drops of the same part.

        It has no contacts.
        """
        if self.aspects.part_sha256 != other.aspects.part_sha256:
            raise ValueError('distributions of different parts cannot be added')
        return dataclasses.replace(
            self,
            counts=self.counts + other.counts,
            unclassified=self.unclassified + other.unclassified,
            unsettled=self.unsettled + other.unsettled,
            failed=self.failed + other.failed,
            energy_growth=max(self.energy_growth, other.energy_growth),
            lost=self.lost + other.lost,
            sliding=self.sliding + other.sliding,
            contacts=None,
        )


def no_drops(
    aspects: AspectSet,
    *,
    interval: str = INTERVAL,
    confidence: float = CONFIDENCE,
    by_precision: bool = False,
) -> Distribution:
    """Return the distribution before the first drop."""
    none = np.zeros(len(aspects), dtype=np.int64)
    return Distribution(aspects, none, 0, 0, 0, interval, confidence, by_precision)


def aspect_ids(aspects: AspectSet, poses: RestingPoses) -> npt.NDArray[np.int64]:
    """Return the aspect id (n,) of each drop; 0 if it is in no aspect or did not come to rest."""
    settled = poses.status == RestStatus.SETTLED  # other poses can be NaN
    ids = np.zeros(len(poses), dtype=np.int64)
    ids[settled] = aspects.classify(poses.orientation[settled])
    return ids


def count_poses(
    aspects: AspectSet, poses: RestingPoses, ids: npt.NDArray[np.int64] | None = None
) -> Distribution:
    """Return the counts of poses by aspect; ``ids`` are their aspect_ids, if known already."""
    settled = poses.status == RestStatus.SETTLED
    ids = aspect_ids(aspects, poses) if ids is None else ids
    by_id = np.bincount(ids[settled], minlength=len(aspects) + 1)
    return Distribution(
        aspects,
        by_id[1:],
        unclassified=int(by_id[0]),
        unsettled=_number(poses, RestStatus.UNSETTLED),
        failed=_number(poses, RestStatus.FAILED),
        energy_growth=float(poses.energy_growth.max(initial=0.0)),
        lost=_number(poses, RestStatus.LOST),
        sliding=_number(poses, RestStatus.SLIDING),
    )


def _number(poses: RestingPoses, status: RestStatus) -> int:
    return int((poses.status == status).sum())


class History:
    """Counts after fixed numbers of drops, which do not depend on the batches of the run.

    Parameters
    ----------
    aspects : AspectSet
    """

    def __init__(self, aspects: AspectSet) -> None:
        self._aspects = aspects
        self._drops = 0
        self._counts = np.zeros(len(aspects) + 1, dtype=np.int64)  # first: in no aspect
        self._sample_drops = _sample_drops()
        self._next = next(self._sample_drops)
        self._samples: list[tuple[int, Counts]] = []

    def add(self, ids: Counts) -> None:
        """Add the aspect ids of the next drops."""
        while len(ids):
            batch, ids = np.split(ids, [self._next - self._drops])
            self._drops += len(batch)
            self._counts += np.bincount(batch, minlength=len(self._counts))
            if self._drops == self._next:
                self._samples.append((self._drops, self._counts[1:].copy()))
                self._next = next(self._sample_drops)

    def points(self) -> tuple[Counts, Counts]:
        """Return numbers of drops (m,), ascending, and the counts by aspect (m, k) after them."""
        samples = list(self._samples)
        if self._drops and (not samples or samples[-1][0] < self._drops):
            samples.append((self._drops, self._counts[1:].copy()))
        return (
            np.array([drops for drops, _ in samples], dtype=np.int64),
            np.array([counts for _, counts in samples], dtype=np.int64).reshape(
                len(samples), len(self._aspects)
            ),
        )


def _sample_drops() -> Iterator[int]:
    k = 0
    while True:
        yield round(FIRST_SAMPLE * 10 ** (k / SAMPLES_PER_DECADE))
        k += 1
