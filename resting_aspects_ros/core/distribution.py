"""How probable each aspect of a part is: counts, probabilities and intervals."""

import dataclasses
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.aspect_set import AspectSet
from resting_aspects_ros.core.intervals import CONFIDENCE, INTERVAL, Interval, intervals
from resting_aspects_ros.core.poses import RestingPoses, RestStatus
from resting_aspects_ros.core.stopping import stopping_confidence

__all__ = [
    'CONFIDENCE',
    'INTERVAL',
    'METHOD',
    'Distribution',
    'Interval',
    'count_poses',
    'no_drops',
]

METHOD = 'drops'


@dataclass(frozen=True, eq=False)
class Distribution:
    """Where the drops of a run ended: each is counted exactly once.

    counts : (k,) int
        Drops at rest in each aspect, by id from 1.
    unclassified, unsettled, failed : int
        Drops at rest in no aspect, not at rest in the time allowed, and numerically wrong.
    by_precision : bool
        Whether the run stopped when its intervals were narrow enough.
    """

    aspects: AspectSet
    counts: npt.NDArray[np.int64]
    unclassified: int
    unsettled: int
    failed: int
    by_precision: bool = False

    @property
    def drops(self) -> int:
        """How many drops were counted."""
        return int(self.counts.sum()) + self.unclassified + self.unsettled + self.failed

    def intervals(self, method: str = INTERVAL, confidence: float = CONFIDENCE) -> list[Interval]:
        """For each aspect count / drops with an interval, n = drops; as core.intervals has it.

        The interval of a count of zero begins at zero, and it is the bound on how probable an
        aspect can be that was never seen. Without drops: 0 to 1. After a stop by precision they
        are a little wider, so that they cover as often as they say: core.stopping.
        """
        if self.by_precision:
            confidence = stopping_confidence(confidence)
        return intervals(self.counts, self.drops, method, confidence)

    def by_class(self) -> 'Distribution':
        """The counts of the symmetry classes, in their order."""
        classes = [[a.id - 1 for a in members] for members in self.aspects.classes()]
        counts = np.array([self.counts[ids].sum() for ids in classes], dtype=np.int64)
        return dataclasses.replace(self, counts=counts)

    def __add__(self, other: 'Distribution') -> 'Distribution':
        """The distribution over the drops of both: different drops of the same part."""
        if self.aspects.part_sha256 != other.aspects.part_sha256:
            raise ValueError('distributions of different parts cannot be added')
        return Distribution(
            self.aspects,
            self.counts + other.counts,
            self.unclassified + other.unclassified,
            self.unsettled + other.unsettled,
            self.failed + other.failed,
            self.by_precision,
        )


def no_drops(aspects: AspectSet, *, by_precision: bool = False) -> Distribution:
    """The distribution before the first drop."""
    return Distribution(aspects, np.zeros(len(aspects), dtype=np.int64), 0, 0, 0, by_precision)


def count_poses(aspects: AspectSet, poses: RestingPoses) -> Distribution:
    """Classify and count."""
    settled = poses.status == RestStatus.SETTLED
    ids = aspects.classify(poses.orientation[settled])
    by_id = np.bincount(ids, minlength=len(aspects) + 1)
    return Distribution(
        aspects,
        by_id[1:],
        unclassified=int(by_id[0]),
        unsettled=int((poses.status == RestStatus.UNSETTLED).sum()),
        failed=int((poses.status == RestStatus.FAILED).sum()),
    )
