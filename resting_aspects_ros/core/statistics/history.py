"""The development of the counts during a run: samples after growing numbers of drops."""

from collections.abc import Iterator

import numpy as np

from resting_aspects_ros.core.aspects.aspect_set import AspectSet
from resting_aspects_ros.core.statistics.intervals import Counts

# The counts are first sampled after this number of drops, then this often for each factor of ten.
FIRST_SAMPLE = 10
SAMPLES_PER_DECADE = 10


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
