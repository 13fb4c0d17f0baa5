"""What the search for an optimum needs to know: the problem, and the number of drops."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.errors import InvalidValueError

Array = npt.NDArray[np.float64]
Counts = npt.NDArray[np.int64]

DEFAULT_POINTS = 48
DEFAULT_DROPS = 1000
# All drops, as a multiple of those of the design: as many again for the search and the comparison.
BUDGET = 2


class Problem(Protocol):
    """What is optimised over the unit cube."""

    dimensions: int
    tolerance: float

    def impossible(self, point: Array) -> str:
        """Return why a point cannot be simulated; empty if it can."""

    def snapped(self, points: Array) -> Array:
        """Return the nearest points (n, d) that the factors allow."""

    def counts(self, points: Array, drops: int, batch: str) -> Counts:
        """Return counts (m, c) of independent drops at points (m, d); a batch is a seed."""

    def scores(self, shares: Array) -> Array:
        """Return scores (...) of shares (..., c): more is better."""


@dataclass(frozen=True)
class Amounts:
    """How many drops are made.

    points : int
        Of the design.
    drops : int
        At each point of the design and of the search.
    total : int
        All drops, with those of the comparison at the end.
    """

    points: int
    drops: int
    total: int

    def __post_init__(self) -> None:
        if min(self.points, self.drops) < 2:
            raise InvalidValueError(
                f'invalid points {self.points} and drops {self.drops}: expected at least 2 of each'
            )
        needed = self.points * self.drops + 3 * self.drops
        if self.total < needed:
            raise InvalidValueError(
                f'invalid budget {self.total}: expected at least {needed} drops for '
                f'{self.points} points and the comparison at the end'
            )

    @property
    def compared(self) -> int:
        """Drops at each of the three conditions that are compared at the end."""
        return max(self.drops, self.total // 12)

    @property
    def search(self) -> int:
        """Drops of the design and of the search."""
        return max(self.points * self.drops, self.total - 3 * self.compared)
