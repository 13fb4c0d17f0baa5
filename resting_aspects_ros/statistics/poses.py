"""Resting poses of drops: where parts have come to rest, and which drops are known."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from enum import IntEnum
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.rotations import LENGTH_TOLERANCE


class RestStatus(IntEnum):
    """How a drop ended; the codes of the message RestingPoses.

    A part that slides still slides or rolls on the surface, and does not come to rest. A lost part
    left the surface. Its pose is where it was when this was detected, perhaps in
    flight; beyond the edge no surface is simulated.
    """

    SETTLED = 0
    UNSETTLED = 1
    FAILED = 2
    LOST = 3
    SLIDING = 4


class DecidedBy(IntEnum):
    """Criterion by which a drop was found to be at rest; the codes of the message RestingPoses."""

    STILLNESS = 0
    ENERGY = 1


@dataclass(frozen=True, eq=False)
class RestingPoses:
    """Resting poses of the consecutive drops ``first_drop``, ``first_drop + 1``, ... of a run.

    position : (n, 3) float
        Position of the part frame in the tray frame, m.
    orientation : (n, 4) float
        Unit quaternions xyzw, tray from part, w >= 0.
    status, decided_by : (n,) uint8
        Codes of RestStatus and DecidedBy.
    time_to_rest : (n,) float
        Time from the release until the rest was detected, s; for an unsettled drop the time limit,
        for a failed drop NaN, for a lost part the time until it left the surface.
    energy_growth : (n,) float
        Maximum growth of the energy between two checks, m g R: the engine adds it at impacts.
    """

    first_drop: int
    position: npt.NDArray[np.float64]
    orientation: npt.NDArray[np.float64]
    status: npt.NDArray[np.uint8]
    decided_by: npt.NDArray[np.uint8]
    time_to_rest: npt.NDArray[np.float64]
    energy_growth: npt.NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.status)

    @property
    def end(self) -> int:
        """Index of the drop after the last one."""
        return self.first_drop + len(self)

    def between(self, first: int, end: int) -> 'RestingPoses':
        """Return the poses of the drops ``first`` to ``end - 1`` that are available."""
        low = min(max(first - self.first_drop, 0), len(self))
        high = min(max(end - self.first_drop, low), len(self))
        names = [field.name for field in fields(self)[1:]]
        arrays = {name: getattr(self, name)[low:high] for name in names}
        return RestingPoses(self.first_drop + low, **arrays)

    def check(self) -> None:
        """Raise InvalidValueError for unknown codes, and for invalid poses of settled drops."""
        settled = self.status == RestStatus.SETTLED
        with np.errstate(over='ignore', invalid='ignore'):  # an infinite norm is rejected below
            norm = np.linalg.norm(self.orientation, axis=1)
        is_unit = np.abs(norm - 1) <= LENGTH_TOLERANCE
        for name, expected, is_valid in (
            ('status', 'a RestStatus code', np.isin(self.status, list(RestStatus))),
            ('decided_by', 'a DecidedBy code', np.isin(self.decided_by, list(DecidedBy))),
            ('position', 'finite numbers', np.isfinite(self.position).all(1) | ~settled),
            ('orientation', 'a unit quaternion', is_unit | ~settled),
        ):
            for k in np.flatnonzero(~is_valid)[:1].tolist():
                raise InvalidValueError(
                    f'invalid {name} {getattr(self, name)[k].tolist()} of drop '
                    f'{self.first_drop + k}: expected {expected}'
                )

    @classmethod
    def join(cls, parts: Sequence['RestingPoses']) -> 'RestingPoses':
        """Return consecutive parts as one; each must begin where the one before it ends."""
        for before, after in pairwise(parts):
            if before.end != after.first_drop:
                raise ValueError(f'drops {before.end} to {after.first_drop - 1} are missing')
        names = [field.name for field in fields(cls)[1:]]
        arrays = {name: np.concatenate([getattr(p, name) for p in parts]) for name in names}
        return cls(parts[0].first_drop, **arrays)

    @classmethod
    def blocks(cls, batches: Iterable['RestingPoses']) -> list['RestingPoses']:
        """Return the drops of batches of one run, each once, as blocks of consecutive drops.

        The batches may overlap and be in any order; the blocks are ascending, with missing drops
        between them.
        """
        found: list[list[RestingPoses]] = []
        end = 0
        for batch in sorted(batches, key=lambda each: each.first_drop):
            new = batch.between(end, batch.end)
            if not len(new):
                continue
            if not found or new.first_drop > end:
                found.append([])
            found[-1].append(new)
            end = new.end
        return [cls.join(block) for block in found]

    @classmethod
    def none(cls, first_drop: int) -> 'RestingPoses':
        """Return an empty set of poses, to be continued with the drop ``first_drop``."""
        codes = np.zeros(0, dtype=np.uint8)
        empty = np.zeros(0)
        return cls(first_drop, np.zeros((0, 3)), np.zeros((0, 4)), codes, codes, empty, empty)


# -- Which drops are known ------------------------------------------------------------------------


class IndexRanges:
    """Disjoint ascending ranges [first, end) of indices."""

    def __init__(self) -> None:
        self._ranges: list[tuple[int, int]] = []

    def add(self, first: int, end: int) -> list[tuple[int, int]]:
        """Add [first, end) and return the ranges in it that are new."""
        new = self.missing(first, end)
        merged = sorted([*self._ranges, *new])
        self._ranges = merged[:1]
        for low, high in merged[1:]:
            before = self._ranges[-1]
            if low <= before[1]:
                self._ranges[-1] = (before[0], max(high, before[1]))
            else:
                self._ranges.append((low, high))
        return new

    def missing(self, first: int, end: int) -> list[tuple[int, int]]:
        """Return the ranges in [first, end) that were not added."""
        gaps = []
        for low, high in self._ranges:
            if high <= first:
                continue
            if low >= end:
                break
            if low > first:
                gaps.append((first, low))
            first = high
        if first < end:
            gaps.append((first, end))
        return gaps

    @property
    def ranges(self) -> list[tuple[int, int]]:
        """The ranges that were added, ascending; adjacent ranges are merged."""
        return list(self._ranges)

    @property
    def end(self) -> int:
        """Index after the last one that was added; 0 if the set is empty."""
        return self._ranges[-1][1] if self._ranges else 0

    def __len__(self) -> int:
        """Return the number of indices that were added."""
        return sum(high - low for low, high in self._ranges)
