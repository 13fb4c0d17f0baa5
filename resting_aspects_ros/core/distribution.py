"""How probable each aspect of a part is: counts, probabilities and intervals."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.aspects import AspectSet
from resting_aspects_ros.core.intervals import CONFIDENCE, INTERVAL, Interval, intervals
from resting_aspects_ros.core.poses import RestingPoses, RestStatus

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
    """

    aspects: AspectSet
    counts: npt.NDArray[np.int64]
    unclassified: int
    unsettled: int
    failed: int

    @property
    def drops(self) -> int:
        """How many drops were counted."""
        return int(self.counts.sum()) + self.unclassified + self.unsettled + self.failed

    def intervals(self, method: str = INTERVAL, confidence: float = CONFIDENCE) -> list[Interval]:
        """For each aspect count / drops with an interval, n = drops; as core.intervals has it.

        The interval of a count of zero begins at zero, and it is the bound on how probable an
        aspect can be that was never seen. Without drops: 0 to 1.
        """
        return intervals(self.counts, self.drops, method, confidence)

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
        )


def no_drops(aspects: AspectSet) -> Distribution:
    """The distribution before the first drop."""
    return Distribution(aspects, np.zeros(len(aspects), dtype=np.int64), 0, 0, 0)


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
