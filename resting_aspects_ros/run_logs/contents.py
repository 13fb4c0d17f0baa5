"""Content of a log: the run, its part, its poses and its counts, or its transition matrix."""

import dataclasses
from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import TypeVar

from resting_aspects_interfaces.msg import TransitionMatrix

from resting_aspects_ros.errors import LogError, one_line, warn
from resting_aspects_ros.input_files import named
from resting_aspects_ros.logs.bag_metadata import LogOutcome
from resting_aspects_ros.logs.indexed_reader import IndexedLog, NoIndexError
from resting_aspects_ros.logs.message_reader import state_warning, typed_messages
from resting_aspects_ros.logs.split_log import open_log
from resting_aspects_ros.logs.topic_metadata import (
    DISTRIBUTION_TYPE,
    PART_TYPE,
    POSES_TYPE,
    SURROUNDINGS_TYPE,
    TRANSITIONS_TYPE,
)
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.ros.conversions import serialized_batch, serialized_part, serialized_poses
from resting_aspects_ros.ros.distribution_conversions import serialized_distribution
from resting_aspects_ros.ros.surroundings_conversions import serialized_surroundings
from resting_aspects_ros.ros.transition_conversions import serialized_transitions
from resting_aspects_ros.simulation.job import RunDescription
from resting_aspects_ros.simulation.surroundings import Surroundings
from resting_aspects_ros.statistics.distribution import (
    Distribution,
)
from resting_aspects_ros.statistics.poses import IndexRanges, RestingPoses

T = TypeVar('T')
TYPES = (POSES_TYPE, PART_TYPE, SURROUNDINGS_TYPE, DISTRIBUTION_TYPE, TRANSITIONS_TYPE)


class LoggedRun:
    """The run in a log, collected from its messages one by one.

    Parameters
    ----------
    log : Path
        The path that the user specified.
    keep_poses : bool
        Keep the poses of all batches, in ``batches``.

    Attributes
    ----------
    run : RunDescription
        None until a batch of poses was added, so also for a log of actions.
    seen : IndexRanges
        Drops of the run that are in the log.
    path, messages, finished, being_written
        Path and state of the MCAP file after it was read. ``finished``: it was closed.
    recorded : LogOutcome
        The outcome that the log records; None if it records none.

    ``part``, ``surroundings``, ``last_distribution`` and ``transitions`` are parsed from the last
    message of their type on first access; LogError if it cannot be read.
    """

    def __init__(self, log: Path, *, keep_poses: bool = False) -> None:
        self.log = self.path = log
        self.messages = 0
        self.finished = self.being_written = False
        self.recorded: LogOutcome | None = None
        self.run: RunDescription | None = None
        self.seen = IndexRanges()
        self.batches: list[tuple[RunDescription, RestingPoses]] = []
        self._keep_poses = keep_poses
        self._last: dict[str, bytes] = {}
        self._end: int | None = None  # index after the last drop, once it is known

    def add(self, type_name: str, data: bytes) -> None:
        """Add a message; raises LogError if it cannot be read."""
        if type_name != POSES_TYPE:
            self._last[type_name] = data
            return
        run, first, drops, last = self._batch(data)
        # Later batches can belong to other runs, whose drops filled gaps of this run.
        self.run = self.run or run
        end = first + drops
        if run.sequence() == self.run.sequence():
            self.seen.add(max(first, self.run.first_drop), min(end, self.run.end))
        if last and run.run_id == self.run.run_id:
            self._end = end

    @cached_property
    def part(self) -> Part | None:
        """The part according to its last description; None if the log has none."""
        data = self._last.get(PART_TYPE)
        return None if data is None else parsed(self.log, serialized_part, data)

    @cached_property
    def surroundings(self) -> Surroundings | None:
        """The surroundings of the run, with their mesh; None if the log has none."""
        data = self._last.get(SURROUNDINGS_TYPE)
        return None if data is None else parsed(self.log, serialized_surroundings, data)

    @cached_property
    def last_distribution(self) -> tuple[Distribution, RunDescription, bool] | None:
        """The last distribution, its run, and whether it counts all drops of this run."""
        data = self._last.get(DISTRIBUTION_TYPE)
        return None if data is None else parsed(self.log, serialized_distribution, data)

    @cached_property
    def transitions(self) -> TransitionMatrix | None:
        """The message with the last transition matrix; None if the log has none."""
        data = self._last.get(TRANSITIONS_TYPE)
        return None if data is None else parsed(self.log, serialized_transitions, data)

    @property
    def outcome(self) -> LogOutcome:
        """The number of drops or actions, and whether the log has the part and all of its run."""
        if self.recorded is not None:
            return self.recorded
        run, part = self.run, self.part
        if run is None and (matrix := self.transitions) is not None:
            is_described = part is not None and part.part_sha256 == matrix.run.part_sha256
            return LogOutcome(sum(matrix.actions), whole=matrix.ended and is_described)
        if run is None or part is None:
            return LogOutcome(len(self.seen), whole=False)
        # A log without the last batch can still have all drops, if a later run repeated the end.
        end = run.end if self._end is None else max(self._end, self.seen.end)
        missing = self.seen.missing(run.first_drop, end)
        is_described = part.part_sha256 == run.part_sha256 and (
            run.conditions.surroundings is None or SURROUNDINGS_TYPE in self._last
        )
        return LogOutcome(len(self.seen), whole=not missing and is_described)

    @property
    def extent(self) -> tuple[int, int]:
        """Index of the first drop in the log, and that after the last one; equal without drops."""
        run, ranges = self.run, self.seen.ranges
        if run is None or not ranges:
            return 0, 0
        if self.outcome.whole:
            return run.first_drop, run.first_drop + self.outcome.drops
        return ranges[0][0], self.seen.end

    @cached_property
    def known_run(self) -> RunDescription | None:
        """The run, whose mesh surface has its mesh; raises LogError if the log lacks it."""
        run = self.run
        if run is None or run.conditions.surroundings is None:
            return run
        found = self.surroundings
        if found is not None and found != run.conditions.surroundings:
            warn(f'{named("log", self.log)} describes other surroundings than those of its run')
            found = None
        if found is None and not run.conditions.surroundings.known:
            raise LogError(f'{named("log", self.log)} lacks the mesh of its surroundings')
        if found is None:
            return run
        conditions = dataclasses.replace(run.conditions, surroundings=found)
        return dataclasses.replace(run, conditions=conditions)

    def warn_if_unfinished(self) -> None:
        """Warn if the log is not closed."""
        text = state_warning(self.log, being_written=self.being_written, finished=self.finished)
        if text:
            warn(text)

    def _batch(self, data: bytes) -> tuple[RunDescription, int, int, bool]:
        if not self._keep_poses:
            return parsed(self.log, serialized_batch, data)
        run, poses, last = parsed(self.log, serialized_poses, data)
        self.batches.append((run, poses))
        return run, poses.first_drop, len(poses), last


def parsed(log: Path, read: Callable[[bytes], T], data: bytes) -> T:
    """Return what ``read`` returns for a message in a log; raises LogError for any exception."""
    try:
        return read(data)
    except Exception as error:  # the data can be invalid in any way
        raise LogError(
            f'{named("log", log)} has a message that cannot be read: {one_line(str(error))}'
        ) from error


def rest_of_run(run: RunDescription, outcome: LogOutcome) -> str:
    """Return why a log does not have all drops of its run, to be appended to their number."""
    if outcome.drops >= run.drops or run.precision:
        return ''
    return ', where the run ended' if outcome.whole else ', the others are not in this log'


def read_logged_run(log: Path, *, keep_poses: bool = False) -> LoggedRun:
    """Read the run in a log, closed or not; raises LogError.

    From a closed log, only the required messages are read through its index. The whole log is
    read if the poses are kept, or if the log does not record its outcome.
    """
    run = LoggedRun(log, keep_poses=keep_poses)
    if not keep_poses and _read_by_index(run):
        return run
    with open_log(log) as file:
        for type_name, message in typed_messages(file, TYPES):
            run.add(type_name, message.data)
        run.path, run.messages = file.path, file.messages
        run.finished, run.being_written = file.finished, file.being_written
        # The outcome is reliable only if the log was closed.
        run.recorded = LogOutcome.of(file.metadata) if file.finished else None
    return run


def _read_by_index(run: LoggedRun) -> bool:
    """Read a closed log that records its outcome; returns False for any other log."""
    try:
        with IndexedLog(run.log) as indexed:
            run.recorded = LogOutcome.of(indexed.read_metadata())
            if run.recorded is None:
                return False
            if not run.recorded.whole:  # there can be gaps
                for _, message in typed_messages(indexed, [POSES_TYPE]):
                    run.add(POSES_TYPE, message.data)
            elif batch := indexed.first(POSES_TYPE):
                run.add(POSES_TYPE, batch)
            for type_name in TYPES[1:]:
                if data := indexed.last(type_name):
                    run.add(type_name, data)
            run.path, run.messages = indexed.path, indexed.message_count
            run.finished, run.being_written = True, indexed.being_written
    except NoIndexError:
        return False
    return True
