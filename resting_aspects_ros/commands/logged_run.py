"""What a log says of its run."""

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

from resting_aspects_ros.core.distribution import Distribution
from resting_aspects_ros.core.errors import LogError, RestingAspectsError
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.drops.coverage import Coverage
from resting_aspects_ros.drops.run import RunDescription
from resting_aspects_ros.logs.indexed_log import IndexedLog, NoIndexError
from resting_aspects_ros.logs.outcome import Outcome
from resting_aspects_ros.logs.recovery import BrokenLog
from resting_aspects_ros.logs.topics import DISTRIBUTION_TYPE, PART_TYPE, POSES_TYPE
from resting_aspects_ros.nodes.convert import serialized_batch, serialized_part
from resting_aspects_ros.nodes.distribution_messages import serialized_distribution

TYPES = (POSES_TYPE, PART_TYPE, DISTRIBUTION_TYPE)


class LoggedRun:
    """The run of a log, told by its messages one after the other.

    run : RunDescription
        None while no batch of poses came.
    part : Part
        As it was when it was dropped; None while it was not described.
    distribution : Distribution
        The last one; None while there was none. ``complete`` if it counts all drops of the run.
    seen : Coverage
        Drops of the run that came.
    """

    def __init__(self) -> None:
        self.run: RunDescription | None = None
        self.part: Part | None = None
        self.distribution: Distribution | None = None
        self.complete = False
        self.seen = Coverage()
        self._end: int | None = None  # index after the last drop, once it is known

    def take(self, type_name: str, data: bytes) -> None:
        """Note what a message says; raises LogError if it cannot be read."""
        try:
            if type_name == POSES_TYPE:
                run, first, drops, last = serialized_batch(data)
                # Later ones can be of other runs, whose drops filled gaps of this one.
                self.run = self.run or run
                end = first + drops
                if run.sequence() == self.run.sequence():
                    self.seen.add(max(first, self.run.first_drop), min(end, self.run.end))
                if last and run.run_id == self.run.run_id:
                    self._end = end
            elif type_name == PART_TYPE:
                self.part = serialized_part(data)
            elif type_name == DISTRIBUTION_TYPE:
                self.distribution, _, self.complete = serialized_distribution(data)
        except (RuntimeError, RestingAspectsError) as error:  # the first is all that rclpy raises
            raise LogError(f'a message of {type_name} cannot be read: {error}') from None

    def outcome(self) -> Outcome:
        """How many drops there are, and whether it is all of them, and the part."""
        run, part = self.run, self.part
        if run is None or part is None:
            return Outcome(len(self.seen), whole=False)
        # Without a last batch it can have all drops, too: if the end was asked for again.
        end = run.end if self._end is None else max(self._end, self.seen.end)
        missing = self.seen.missing(run.first_drop, end)
        whole = not missing and part.part_sha256 == run.part_sha256
        return Outcome(len(self.seen), whole)


@dataclass(frozen=True)
class LogContents:
    """A run as a log has it, and the log.

    finished : bool
        Index and metadata are there: it was not broken off, and is not being written.
    """

    path: Path
    messages: int
    finished: bool
    being_written: bool
    run: LoggedRun
    outcome: Outcome

    @property
    def ranges(self) -> list[tuple[int, int]]:
        """The drops that it holds, [first, end) of each row of them without a gap."""
        run = self.run.run
        if run is None or not self.outcome.whole:
            return self.run.seen.ranges
        return [(run.first_drop, run.first_drop + self.outcome.drops)]


def rest_of_run(run: RunDescription, outcome: Outcome) -> str:
    """Why a log does not have all drops that were asked for, in words to come after how many."""
    if outcome.drops >= run.drops or run.precision:
        return ''
    return ', where the run ended' if outcome.whole else ', the others are not in this log'


def read_contents(log: Path) -> LogContents:
    """What is in a log, closed or broken off; raises LogError."""
    try:
        with IndexedLog(log) as indexed:
            outcome = Outcome.of(indexed.notes())
            if outcome is not None:
                run = LoggedRun()
                batch = indexed.first(POSES_TYPE)
                others = [(name, indexed.last(name)) for name in (PART_TYPE, DISTRIBUTION_TYPE)]
                for type_name, data in ((POSES_TYPE, batch), *others):
                    if data is not None:
                        run.take(type_name, data)
                if not outcome.whole:
                    _take_all(run, BrokenLog(log), (POSES_TYPE,))  # there can be gaps
                messages = indexed.counts().total()
                return LogContents(indexed.path, messages, True, False, run, outcome)
    except NoIndexError:
        pass
    # Nobody counted it, or the count was lost: all of it is read.
    broken = BrokenLog(log)
    run = LoggedRun()
    _take_all(run, broken, TYPES)
    found = broken.extent
    return LogContents(
        broken.path, found.messages, found.finished, broken.being_written, run, run.outcome()
    )


def _take_all(run: LoggedRun, log: BrokenLog, types: Collection[str]) -> None:
    for type_name, data in log.messages(types):
        run.take(type_name, data)
