"""How the shares of a run came to be: its counts after growing numbers of drops."""

from collections.abc import Iterator

import numpy as np

from resting_aspects_ros.core.aspects.aspect_set import AspectSet
from resting_aspects_ros.core.statistics.intervals import Counts

# After so many drops for the first time, and how often until there are ten times as many: so few
# that a run of any length has some ten of them for each digit of its length.
FIRST_LOOK = 10
LOOKS_PER_DECADE = 10


class History:
    """Counts after fixed numbers of drops, whatever the pieces in which these come.

    Parameters
    ----------
    aspects : AspectSet
    """

    def __init__(self, aspects: AspectSet) -> None:
        self._aspects = aspects
        self._drops = 0
        self._counts = np.zeros(len(aspects) + 1, dtype=np.int64)  # the first: in no aspect
        self._looks = _looks()
        self._next = next(self._looks)
        self._seen: list[tuple[int, Counts]] = []

    def add(self, ids: Counts) -> None:
        """Count the drops that come after those that were added before: their aspect_ids."""
        while len(ids):
            piece, ids = np.split(ids, [self._next - self._drops])
            self._drops += len(piece)
            self._counts += np.bincount(piece, minlength=len(self._counts))
            if self._drops == self._next:
                self._seen.append((self._drops, self._counts[1:].copy()))
                self._next = next(self._looks)

    def points(self) -> tuple[Counts, Counts]:
        """(m,) numbers of drops, ascending, and (m, k) counts by aspect; the last are of all."""
        seen = list(self._seen)
        if self._drops and (not seen or seen[-1][0] < self._drops):
            seen.append((self._drops, self._counts[1:].copy()))
        return (
            np.array([drops for drops, _ in seen], dtype=np.int64),
            np.array([counts for _, counts in seen], dtype=np.int64).reshape(
                len(seen), len(self._aspects)
            ),
        )


def _looks() -> Iterator[int]:
    k = 0
    while True:
        yield round(FIRST_LOOK * 10 ** (k / LOOKS_PER_DECADE))
        k += 1
