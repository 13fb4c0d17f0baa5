"""How probable each aspect of a part is: counts, probabilities and intervals."""

import dataclasses
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.aspects.aspect_set import AspectSet
from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.poses import RestingPoses, RestStatus
from resting_aspects_ros.core.statistics.intervals import CONFIDENCE, INTERVAL, Interval, intervals
from resting_aspects_ros.core.statistics.stopping import stopping_confidence, stops

METHOD = 'drops'


@dataclass(frozen=True, eq=False)
class Distribution:
    """Where the drops of a run ended: each is counted exactly once.

    counts : (k,) int
        Drops at rest in each aspect, by id from 1.
    unclassified, unsettled, failed : int
        Drops at rest in no aspect, not at rest in the time allowed, and numerically wrong.
    interval : str
        Method of the intervals, one of core.intervals.METHODS.
    confidence : float
        Of the intervals.
    by_precision : bool
        Whether the run stopped when its intervals were narrow enough.
    energy_growth : float
        Largest of any drop, m g R; as RestingPoses has it.
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

    @property
    def drops(self) -> int:
        """How many drops were counted."""
        return int(self.counts.sum()) + self.unclassified + self.unsettled + self.failed

    def intervals(self) -> list[Interval]:
        """For each aspect count / drops with an interval, n = drops; as core.intervals has it.

        The interval of a count of zero begins at zero, and it is the bound on how probable an
        aspect can be that was never seen. Without drops: 0 to 1. After a stop by precision they
        are a little wider, so that they cover as often as they say: core.stopping.
        """
        return self._intervals(self.counts)

    def together(self, ids: Iterable[int]) -> Interval:
        """How probable it is to end in one of some aspects, with an interval of their sum.

        Raises InvalidValueError if the part has no aspect of an id.
        """
        most = len(self.counts)
        for k in set(ids):
            if not 1 <= k <= most:
                raise InvalidValueError(f'invalid aspect {k!r}: expected 1 to {most}')
        count = self.counts[[k - 1 for k in sorted(set(ids))]].sum()
        return self._intervals(count[None])[0]

    def _intervals(self, counts: npt.NDArray[np.int64]) -> list[Interval]:
        stopped = stopping_confidence(self.confidence) if self.by_precision else self.confidence
        return intervals(counts, self.drops, self.interval, stopped)

    def stops(self, precision: float, ceiling: int) -> bool:
        """Whether a run is over with these counts; as core.stopping has it."""
        return stops(self.counts, self.drops, precision, ceiling, self.interval, self.confidence)

    def by_class(self) -> 'Distribution':
        """The counts of the symmetry classes, in their order."""
        classes = [[a.id - 1 for a in members] for members in self.aspects.classes()]
        counts = np.array([self.counts[ids].sum() for ids in classes], dtype=np.int64)
        return dataclasses.replace(self, counts=counts)

    def __add__(self, other: 'Distribution') -> 'Distribution':
        """The distribution over the drops of both: different drops of the same part."""
        if self.aspects.part_sha256 != other.aspects.part_sha256:
            raise ValueError('distributions of different parts cannot be added')
        return dataclasses.replace(
            self,
            counts=self.counts + other.counts,
            unclassified=self.unclassified + other.unclassified,
            unsettled=self.unsettled + other.unsettled,
            failed=self.failed + other.failed,
            energy_growth=max(self.energy_growth, other.energy_growth),
        )


def no_drops(
    aspects: AspectSet,
    *,
    interval: str = INTERVAL,
    confidence: float = CONFIDENCE,
    by_precision: bool = False,
) -> Distribution:
    """The distribution before the first drop."""
    none = np.zeros(len(aspects), dtype=np.int64)
    return Distribution(aspects, none, 0, 0, 0, interval, confidence, by_precision)


def aspect_ids(aspects: AspectSet, poses: RestingPoses) -> npt.NDArray[np.int64]:
    """(n,) aspect in which each drop came to rest; 0 if in none, or if it did not."""
    settled = poses.status == RestStatus.SETTLED  # of others the pose can be no number
    ids = np.zeros(len(poses), dtype=np.int64)
    ids[settled] = aspects.classify(poses.orientation[settled])
    return ids


def count_poses(
    aspects: AspectSet, poses: RestingPoses, ids: npt.NDArray[np.int64] | None = None
) -> Distribution:
    """Classify and count; ``ids`` as aspect_ids, if they are known already."""
    settled = poses.status == RestStatus.SETTLED
    ids = aspect_ids(aspects, poses) if ids is None else ids
    by_id = np.bincount(ids[settled], minlength=len(aspects) + 1)
    return Distribution(
        aspects,
        by_id[1:],
        unclassified=int(by_id[0]),
        unsettled=int((poses.status == RestStatus.UNSETTLED).sum()),
        failed=int((poses.status == RestStatus.FAILED).sum()),
        energy_growth=float(poses.energy_growth.max(initial=0.0)),
    )
