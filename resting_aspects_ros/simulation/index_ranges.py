"""Set of drop indices, stored as ranges: which drops were received, and which are missing."""


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
