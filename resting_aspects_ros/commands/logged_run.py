"""What a log says of its run."""

import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from pathlib import Path
from typing import TypeVar

from resting_aspects_ros.commands.answer import Answer
from resting_aspects_ros.core.aspects import find_aspects
from resting_aspects_ros.core.distribution import (
    METHOD,
    Distribution,
    aspect_ids,
    count_poses,
    no_drops,
)
from resting_aspects_ros.core.errors import InvalidValueError, LogError, one_line
from resting_aspects_ros.core.history import History
from resting_aspects_ros.core.input_file import named
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.poses import RestingPoses
from resting_aspects_ros.drops.coverage import Coverage
from resting_aspects_ros.drops.merge import Piece, merge_drops
from resting_aspects_ros.drops.run import RunDescription
from resting_aspects_ros.logs.indexed_log import IndexedLog, NoIndexError
from resting_aspects_ros.logs.log_file import LogFile
from resting_aspects_ros.logs.log_reader import one_file, state_text, typed_messages, unfinished
from resting_aspects_ros.logs.outcome import Outcome
from resting_aspects_ros.logs.topics import DISTRIBUTION_TYPE, PART_TYPE, POSES_TYPE
from resting_aspects_ros.nodes.convert import serialized_batch, serialized_part, serialized_poses
from resting_aspects_ros.nodes.distribution_messages import serialized_distribution

T = TypeVar('T')
TYPES = (POSES_TYPE, PART_TYPE, DISTRIBUTION_TYPE)


class LoggedRun:
    """The run of a log, told by its messages one after the other.

    Parameters
    ----------
    log : Path
        For errors.
    keep_poses : bool
        Keep the poses of all batches, in ``pieces``.

    Attributes
    ----------
    run : RunDescription
        None while no batch of poses came.
    part : Part
        As it was when it was dropped; None while it was not described.
    distribution : Distribution
        The last one; None while there was none. ``complete`` if it counts all drops of the run.
    seen : Coverage
        Drops of the run that came.

    ``part``, ``distribution`` and ``complete`` are read from the last message of their type when
    they are first asked for; LogError if it cannot be read.
    """

    def __init__(self, log: Path, *, keep_poses: bool = False) -> None:
        self.run: RunDescription | None = None
        self.seen = Coverage()
        self.pieces: list[Piece] = []
        self._log = log
        self._keep_poses = keep_poses
        self._last: dict[str, bytes] = {}
        self._end: int | None = None  # index after the last drop, once it is known

    def take(self, type_name: str, data: bytes) -> None:
        """Note what a message says; raises LogError if it cannot be read."""
        if type_name != POSES_TYPE:
            self._last[type_name] = data
            return
        run, first, drops, last = self._batch(data)
        # Later ones can be of other runs, whose drops filled gaps of this one.
        self.run = self.run or run
        end = first + drops
        if run.sequence() == self.run.sequence():
            self.seen.add(max(first, self.run.first_drop), min(end, self.run.end))
        if last and run.run_id == self.run.run_id:
            self._end = end

    @cached_property
    def part(self) -> Part | None:
        """The part, of the last description."""
        data = self._last.get(PART_TYPE)
        return None if data is None else self._read(serialized_part, data)

    @cached_property
    def _distribution(self) -> tuple[Distribution | None, bool]:
        data = self._last.get(DISTRIBUTION_TYPE)
        if data is None:
            return None, False
        distribution, _, complete = self._read(serialized_distribution, data)
        return distribution, complete

    @property
    def distribution(self) -> Distribution | None:
        """The last distribution."""
        return self._distribution[0]

    @property
    def complete(self) -> bool:
        """Whether the last distribution counts all drops of the run."""
        return self._distribution[1]

    def outcome(self) -> Outcome:
        """Return how many drops there are, and whether it is all of them, and the part."""
        run, part = self.run, self.part
        if run is None or part is None:
            return Outcome(len(self.seen), whole=False)
        # Without a last batch it can have all drops, too: if the end was asked for again.
        end = run.end if self._end is None else max(self._end, self.seen.end)
        missing = self.seen.missing(run.first_drop, end)
        whole = not missing and part.part_sha256 == run.part_sha256
        return Outcome(len(self.seen), whole)

    def _batch(self, data: bytes) -> tuple[RunDescription, int, int, bool]:
        if not self._keep_poses:
            return self._read(serialized_batch, data)
        run, poses, last = self._read(serialized_poses, data)
        self.pieces.append((run, poses))
        return run, poses.first_drop, len(poses), last

    def _read(self, read: Callable[[bytes], T], data: bytes) -> T:
        try:
            return read(data)
        except Exception as error:  # whatever is in it
            raise LogError(
                f'{named("log", self._log)} has a message that cannot be read: '
                f'{one_line(str(error))}'
            ) from error


@dataclass(frozen=True)
class LogContents:
    """A run as a log has it, and the log.

    log, path : Path
        As it was given, and its MCAP file.
    messages : int
    finished : bool
        It was not broken off, and is not being written.
    """

    log: Path
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

    def described_run(self) -> tuple[RunDescription, Part]:
        """Return the run and its part; InvalidValueError if the log does not have both."""
        run, part = self.run.run, self.run.part
        if run is None:
            raise InvalidValueError(f'{named("log", self.log)} holds no drops')
        if part is None or part.part_sha256 != run.part_sha256:
            raise InvalidValueError(f'{named("log", self.log)} does not describe its part')
        return run, part

    def warn_if_unfinished(self) -> None:
        """Print on standard error if the log has no end."""
        _warn(state_text(self.log, being_written=self.being_written, finished=self.finished))


def rest_of_run(run: RunDescription, outcome: Outcome) -> str:
    """Return why a log does not have all drops of its run, in words to come after how many."""
    if outcome.drops >= run.drops or run.precision:
        return ''
    return ', where the run ended' if outcome.whole else ', the others are not in this log'


def read_contents(log: Path, *, keep_poses: bool = False) -> LogContents:
    """Read what is in a log, closed or broken off; raises LogError.

    Of a closed log only what is needed is read, found by its index; all of it if the poses are
    kept, or if nobody counted its drops.
    """
    if not keep_poses:
        try:
            with IndexedLog(log) as indexed:
                if (found := _by_index(log, indexed)) is not None:
                    return found
        except NoIndexError:
            pass
    run = LoggedRun(log, keep_poses=keep_poses)
    with LogFile(one_file(log)) as file:
        for type_name, message in typed_messages(file, TYPES):
            run.take(type_name, message.data)
        # Without its end nothing vouches for a text in the file.
        recorded = Outcome.of(file.texts) if file.finished else None
        outcome = recorded or run.outcome()
        return LogContents(
            log, file.path, file.messages, file.finished, file.being_written, run, outcome
        )


def _by_index(log: Path, indexed: IndexedLog) -> LogContents | None:
    outcome = Outcome.of(indexed.notes())
    if outcome is None:
        return None
    run = LoggedRun(log)
    if outcome.whole:
        batches: Iterable[bytes | None] = [indexed.first(POSES_TYPE)]
    else:  # there can be gaps
        batches = (message.data for _, message in typed_messages(indexed, [POSES_TYPE]))
    others = ((name, indexed.last(name)) for name in (PART_TYPE, DISTRIBUTION_TYPE))
    for type_name, data in chain(((POSES_TYPE, data) for data in batches), others):
        if data is not None:
            run.take(type_name, data)
    messages = indexed.counts().total()
    return LogContents(log, indexed.path, messages, True, indexed.being_written, run, outcome)


def logged_answer(log: Path) -> Answer:
    """Count the drops of a log again, each once.

    Raises InvalidValueError if it is no log of a run with its part, LogError if it cannot be read.
    """
    contents = read_contents(log, keep_poses=True)
    run, part = contents.described_run()
    contents.warn_if_unfinished()
    counted = no_drops(find_aspects(part), by_precision=run.precision > 0)
    history = History(counted.aspects)
    for poses in _poses(contents.run.pieces, run):
        ids = aspect_ids(counted.aspects, poses)
        history.add(ids)
        counted += count_poses(counted.aspects, poses, ids)
    whole = contents.outcome.whole and contents.finished
    return Answer(counted, run, part, METHOD, whole, history=history.points())


def _poses(pieces: list[Piece], run: RunDescription) -> Iterator[RestingPoses]:
    """Give the drops of a run, each once, by index."""
    for merged in merge_drops(pieces, any_engine=True):
        if merged.run.sequence() == run.sequence():
            for poses in merged.poses:
                yield poses.between(run.first_drop, run.end)


def warn_if_unfinished(log: Path) -> None:
    """Print on standard error if a log has no end; LogError if it cannot be read."""
    _warn(unfinished(log))


def _warn(words: str) -> None:
    if words:
        print(f'warning: {words}', file=sys.stderr)
