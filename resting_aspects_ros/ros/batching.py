"""Batches of resting poses, as they are published and recorded."""

from collections.abc import Iterator

from resting_aspects_ros.statistics.poses import RestingPoses


class PoseBatches:
    """Poses that have not been published yet.

    It always holds back some poses, so that the last batch of a run is not empty.
    """

    def __init__(self, size: int) -> None:
        self._size = size
        self._pending: list[RestingPoses] = []

    def add(self, chunk: RestingPoses) -> Iterator[RestingPoses]:
        """Add a chunk, which continues the previous one; yield the batches that are full now."""
        self._pending.append(chunk)
        while sum(map(len, self._pending)) > self._size:
            joined = RestingPoses.join(self._pending)
            middle = joined.first_drop + self._size
            self._pending = [joined.between(middle, joined.end)]
            yield joined.between(joined.first_drop, middle)

    def remaining(self, end: int) -> RestingPoses:
        """Return the remaining poses, up to ``end``; may be empty."""
        if not self._pending:
            return RestingPoses.none(end)
        return RestingPoses.join(self._pending)
