"""The drops of one run that a consumer of resting_poses received, and those that are missing."""

from dataclasses import dataclass, field

from resting_aspects_ros.ros.formatting import count_text, progress_text
from resting_aspects_ros.simulation.job import RunDescription
from resting_aspects_ros.statistics.poses import IndexRanges

# Missing drops are lost after this number of consecutive requests that recovered none of them.
MAX_REPAIRS = 3


@dataclass
class RunProgress:
    """The drops of one run that have been received.

    end : index after its last drop; until ``ended``, as requested
    began, heard : times of the first and of the last batch, on the monotonic clock, s
    abandoned : whether its simulator disappeared before the last batch
    """

    run: RunDescription
    end: int
    began: float
    ended: bool = False
    abandoned: bool = False
    seen: IndexRanges = field(default_factory=IndexRanges)
    repairs: int = 0
    repairing: bool = False
    closed: bool = False
    heard: float = 0.0

    def take(self, first: int, end: int) -> list[tuple[int, int]]:
        """Mark drops as received and return the ranges of new ones."""
        new = self.seen.add(first, end) if first < end else []
        if new:
            self.repairs = 0
        return new

    def missing(self) -> list[tuple[int, int]]:
        """Return the ranges of drops that were published and not received."""
        return self.seen.missing(self.run.first_drop, self.end if self.ended else self.seen.end)

    @property
    def complete(self) -> bool:
        """Whether all drops were received and no more will follow."""
        return self.ended and not self.missing()

    @property
    def lost(self) -> bool:
        """Whether drops are missing and cannot be recovered."""
        given_up = self.repairs >= MAX_REPAIRS and not self.repairing
        return (self.abandoned or given_up) and bool(self.missing())

    @property
    def has_no_gap(self) -> bool:
        """Whether the received drops are the first drops of the run, without a gap."""
        return bool(self.seen.ranges) and not self.seen.missing(self.run.first_drop, self.seen.end)

    @property
    def loss(self) -> str:
        """A sentence that states which drops are lost."""
        name = f'run {self.run.run_id} of {self.run.part}'
        if self.abandoned:
            return f'{name} was interrupted: {progress_text(self.run, len(self.seen))}'
        lost = sum(end - first for first, end in self.missing())
        total = count_text(self.end - self.run.first_drop, 'drop', 'drops')
        return f'{name} is missing {lost} of {total}, which could not be recovered'
