"""Random numbers of drops: each depends only on the seed of the run and the index of the drop."""

import numpy as np
from scipy.special import ndtri

from resting_aspects_ros.core.rotations import Array

# Numbers of a drop; a block of the counter-based generator Philox has four.
NUMBERS, BLOCK = 16, 4


class DropRandom:
    """Numbers for consecutive drops, with the two methods of numpy's Generator that starts need.

    Any range of drops has the same numbers as in a longer run, because those of drop i are blocks
    of the generator Philox (Salmon, Moraes, Dror, Shaw 2011) at a counter that follows from i.

    Parameters
    ----------
    seed : int
        From 0 to 2^64 - 1.
    first, end : int
        Indices of the first drop and of the one after the last.
    """

    def __init__(self, seed: int, first: int, end: int) -> None:
        blocks = NUMBERS // BLOCK
        bits = np.random.Philox(key=seed, counter=first * blocks)
        raw = bits.random_raw((end - first) * NUMBERS).reshape(end - first, NUMBERS)
        # The middles of 2^53 intervals, so that none is 0 or 1.
        self._uniform = ((raw >> np.uint64(11)).astype(np.float64) + 0.5) * 2.0**-53
        self._used = 0

    def random(self, shape: int | tuple[int, ...]) -> Array:
        """Return uniform numbers between 0 and 1, of shape (n,) or (n, k) for n drops."""
        sizes = (shape,) if isinstance(shape, int) else shape
        count = sizes[1] if len(sizes) > 1 else 1
        found = self._uniform[:, self._used : self._used + count]
        self._used += count
        if sizes[0] != len(found) or self._used > NUMBERS:
            raise ValueError(
                f'invalid shape {shape}: expected {len(found)} drops with numbers left'
            )
        return np.array(found.reshape(sizes))

    def standard_normal(self, shape: int | tuple[int, ...]) -> Array:
        """Return numbers from the standard normal distribution; see random."""
        return np.asarray(ndtri(self.random(shape)))
