"""Batches of resting poses, as they are published and recorded."""

from collections.abc import Iterator

from resting_aspects_ros.core.poses import RestingPoses


class PoseBatches:
    """Poses that have not been published yet.

    Some are always held back, so that the batch which turns out to be the last is not empty.
    """

    def __init__(self, size: int) -> None:
        self._size = size
        self._waiting: list[RestingPoses] = []

    def add(self, chunk: RestingPoses) -> Iterator[RestingPoses]:
        """The batches that are full now; the chunk continues the one before."""
        self._waiting.append(chunk)
        while sum(map(len, self._waiting)) > self._size:
            joined = RestingPoses.join(self._waiting)
            middle = joined.first_drop + self._size
            self._waiting = [joined.between(middle, joined.end)]
            yield joined.between(joined.first_drop, middle)

    def rest(self, end: int) -> RestingPoses:
        """What is left, up to ``end``; may be empty."""
        if not self._waiting:
            return RestingPoses.none(end)
        return RestingPoses.join(self._waiting)
