"""The log of a run: its contents, or those of the log of a feeder, and its recording.

A run is recorded with the messages of nodes, or in this process without nodes. This module uses
serialized messages, and therefore imports ROS. The command line and the Python interface import it
only when a log is read or written.
"""

import dataclasses
import os
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from datetime import datetime, timezone
from functools import cached_property
from pathlib import Path
from typing import TypeVar

import numpy as np
import numpy.typing as npt
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message, serialize_message
from resting_aspects_interfaces.msg import (
    ObservedCounts,
    PartDescription,
    SurroundingsDescription,
    TransitionMatrix,
)

from resting_aspects_ros.api.conditions import scene_of, without_drops
from resting_aspects_ros.api.drop import DropResult
from resting_aspects_ros.api.model_range import missing_in, model_range_of
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.errors import InvalidValueError, LogError, one_line, shown, warn
from resting_aspects_ros.input_files import is_folder, named
from resting_aspects_ros.logs.bag import OUTCOME, LogOutcome, recorded_outcome
from resting_aspects_ros.logs.reader import open_log
from resting_aspects_ros.logs.topics import (
    DISTRIBUTION_TYPE,
    PART_TYPE,
    POSES_TYPE,
    SURROUNDINGS_TYPE,
    TRANSITIONS_TYPE,
    Topic,
)
from resting_aspects_ros.logs.writer import RunLog, run_folder_name
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.ros.conversions import (
    MAX_POSES,
    NANOSECONDS,
    description_msg,
    part_msg,
    poses_msgs,
    serialized_part,
    serialized_poses,
    serialized_surroundings,
    time_msg,
)
from resting_aspects_ros.ros.count_conversions import observed_from
from resting_aspects_ros.ros.distribution_conversions import (
    distribution_msg,
    serialized_distribution,
    serialized_transitions,
)
from resting_aspects_ros.ros.interface import (
    ASPECT_DISTRIBUTIONS,
    LATCHED,
    PARTS,
    POSES,
    RESTING_POSES,
    SURROUNDINGS,
    SURROUNDINGS_QOS,
    offered_qos,
)
from resting_aspects_ros.simulation.job import RunDescription
from resting_aspects_ros.simulation.surroundings import Surroundings
from resting_aspects_ros.statistics.counted_parts import ObservedCounts as CountedParts
from resting_aspects_ros.statistics.distribution import (
    ContactCounts,
    Distribution,
    History,
    aspect_ids,
    count_poses,
    no_drops,
)
from resting_aspects_ros.statistics.poses import IndexRanges, RestingPoses

# -- Contents -------------------------------------------------------------------------------------


T = TypeVar('T')
TYPES = (POSES_TYPE, PART_TYPE, SURROUNDINGS_TYPE, DISTRIBUTION_TYPE, TRANSITIONS_TYPE)
# Folders of the logs of a feeder.
FEEDER_LOGS = 'feeder-*'
COUNTS_TYPE = 'resting_aspects_interfaces/msg/ObservedCounts'


class LoggedRun:
    """The run in a log, closed or not.

    ``part``, ``surroundings``, ``last_distribution`` and ``transitions`` are parsed from the last
    message of their type on first access; LogError if it cannot be read.

    Parameters
    ----------
    log : Path
        The path that the user specified.

    Attributes
    ----------
    run : RunDescription
        None without poses, so also for a log of actions.
    seen : IndexRanges
        Drops of the run that are in the log.
    path, messages, finished, being_written, warning
        Path and state of the MCAP file. ``finished``: it was closed.

    Raises
    ------
    LogError
        The log cannot be read.
    """

    def __init__(self, log: Path) -> None:
        self.log = log
        self.run: RunDescription | None = None
        self.seen = IndexRanges()
        self._batches: list[tuple[RunDescription, RestingPoses]] = []
        self._last: dict[str, bytes] = {}
        self._end: int | None = None  # index after the last drop, once it is known
        with open_log(log) as file:
            for message in file.of_types(TYPES):
                if message.type == POSES_TYPE:
                    self._add(message.data)
                else:
                    self._last[message.type] = message.data
        self.path, self.messages, self.warning = file.path, file.message_count, file.warning
        self.finished, self.being_written = file.closed, file.being_written
        self._recorded = file.outcome

    def _add(self, data: bytes) -> None:
        run, poses, last = _parsed(self.log, serialized_poses, data)
        self._batches.append((run, poses))
        # Later batches can belong to other runs, whose drops filled gaps of this run.
        self.run = self.run or run
        if run.sequence() == self.run.sequence():
            self.seen.add(max(poses.first_drop, self.run.first_drop), min(poses.end, self.run.end))
        if last and run.run_id == self.run.run_id:
            self._end = poses.end

    @cached_property
    def part(self) -> Part | None:
        """The part according to its last description; None if the log has none."""
        return self._parsed_last(PART_TYPE, serialized_part)

    @cached_property
    def surroundings(self) -> Surroundings | None:
        """The surroundings of the run, with their mesh; None if the log has none."""
        return self._parsed_last(SURROUNDINGS_TYPE, serialized_surroundings)

    @cached_property
    def last_distribution(self) -> tuple[Distribution, RunDescription, bool] | None:
        """The last distribution, its run, and whether it counts all drops of this run."""
        return self._parsed_last(DISTRIBUTION_TYPE, serialized_distribution)

    @cached_property
    def transitions(self) -> TransitionMatrix | None:
        """The message with the last transition matrix; None if the log has none."""
        return self._parsed_last(TRANSITIONS_TYPE, serialized_transitions)

    def _parsed_last(self, type_name: str, read: Callable[[bytes], T]) -> T | None:
        data = self._last.get(type_name)
        return None if data is None else _parsed(self.log, read, data)

    @property
    def outcome(self) -> LogOutcome:
        """The number of drops or actions, and whether the log has the part and all of its run."""
        if self._recorded is not None:
            return self._recorded
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

    @cached_property
    def known_run(self) -> RunDescription | None:
        """The run, whose mesh surface has its mesh; raises LogError if the log lacks it."""
        run = self.run
        if run is None or run.conditions.surroundings is None:
            return run
        found = self.surroundings
        if found is None or found != run.conditions.surroundings:
            if not run.conditions.surroundings.known:
                raise LogError(f'{named("log", self.log)} lacks the mesh of its surroundings')
            return run
        conditions = dataclasses.replace(run.conditions, surroundings=found)
        return dataclasses.replace(run, conditions=conditions)

    def warn_if_unfinished(self) -> None:
        """Warn if the log is not closed."""
        if self.warning:
            warn(self.warning)

    def result(self) -> DropResult:
        """Return a result with a new count of the drops in the log, without duplicates.

        The result has the poses only if no drops are missing. Raises InvalidValueError if the log
        has no drops or not their part.
        """
        run, part = self.known_run, self.part
        if run is None:
            raise InvalidValueError(f'{named("log", self.log)} contains no drops')
        if part is None or part.part_sha256 != run.part_sha256:
            raise InvalidValueError(f'{named("log", self.log)} does not describe its part')
        aspects, contacts = without_drops(part, run.conditions, find_aspects(part))
        distribution = no_drops(aspects, by_precision=run.precision > 0)
        history = History(distribution.aspects)
        sequence = run.sequence()
        of_run = (poses for each, poses in self._batches if each.sequence() == sequence)
        blocks = [each.between(run.first_drop, run.end) for each in RestingPoses.blocks(of_run)]
        for poses in blocks:
            ids = aspect_ids(distribution.aspects, poses)
            history.add(ids)
            distribution += count_poses(distribution.aspects, poses, ids)
            if contacts is not None:
                contacts.add(poses, ids)
        return DropResult(
            model_range_of(distribution, part, run),
            run,
            part,
            self.outcome.whole and self.finished,
            poses=blocks[0] if len(blocks) == 1 else None,
            history=history.points(),
            contacts=contacts,
            no_model_range=missing_in(run),
        )


def _parsed(log: Path, read: Callable[[bytes], T], data: bytes) -> T:
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


def logged_result(log: Path) -> DropResult:
    """Return a new count of the drops in a log, and warn if it is not closed.

    Raises InvalidValueError as `LoggedRun.result`, LogError if it cannot be read.
    """
    logged = LoggedRun(log)
    result = logged.result()
    logged.warn_if_unfinished()
    return result


def counted_distribution(log: Path, stamp: int, frame: str) -> bytes:
    """Return the serialized distribution of the drops in a log, which may be open.

    Runs in a FileWorker. Raises InvalidValueError and LogError as logged_result.

    stamp : ns since the epoch
    """
    result = LoggedRun(log).result()
    distribution = dataclasses.replace(result.distribution, contacts=result.contacts)
    message = distribution_msg(distribution, result.run, time_msg(stamp), True, frame)
    return bytes(serialize_message(message))


def messages_by_topic(log: Path) -> dict[str, int]:
    """Return the number of messages of each topic in a log, by name; raises LogError."""
    with open_log(log) as file:
        return dict(sorted(Counter(message.topic for message in file.messages()).items()))


def observed_in_logs(path: Path, part: str, ids: Sequence[int]) -> CountedParts:
    """Return the parts that the messages on observed_counts/<part> in a log count.

    Parameters
    ----------
    path : Path
        A log of a feeder, or a folder of such logs, which are read in their order.
    part : str
        Empty: the only part in the logs.
    ids : sequence of int
        Numbers of its symmetry classes.

    Raises
    ------
    InvalidValueError
        The logs have no counts of the part, or of several parts without ``part``.
    LogError
        A log cannot be read.
    """
    nested = sorted(path.glob(f'{FEEDER_LOGS}/')) if is_folder(path) else []
    counted: list[tuple[int, ObservedCounts]] = []
    for log in nested or [path]:
        with open_log(log) as file:
            counted += [
                (each.time, _parsed(log, _counts, each.data))
                for each in file.of_types([COUNTS_TYPE])
            ]
    parts = {message.part for _, message in counted}
    of_part = [each for each in counted if part in ('', each[1].part)]
    if not of_part or (not part and len(parts) > 1):
        raise InvalidValueError(
            f'invalid counts in {named("log", path)}: expected observed_counts of '
            f'{part or "one part"}, found {shown(", ".join(sorted(parts))) if parts else "none"}'
        )
    return observed_from(of_part, str(path), ids)


def _counts(data: bytes) -> ObservedCounts:
    return deserialize_message(data, ObservedCounts)


# -- Recording ------------------------------------------------------------------------------------


class RunRecorder:
    """The log of a run, and which of its messages have not arrived yet.

    No method raises LogError. When the log cannot be written, ``error`` has the reason and further
    messages are ignored. If earlier logs of the run are incomplete, a number is appended to the
    name of this one.

    Parameters
    ----------
    unit : str
        What the run consists of: drops, or actions, of which ``drops`` is then the number.
    failed : called once with the consequence of an error for the run

    Attributes
    ----------
    seen : IndexRanges
        The drops whose messages have arrived.
    heard : float
        Time of the last message, on the monotonic clock, s.
    """

    def __init__(
        self,
        folder: Path,
        run: RunDescription,
        unit: str = 'drops',
        failed: Callable[[str], object] = lambda _: None,
    ) -> None:
        self.run = run
        self.unit = unit
        self.error = ''
        self.has_part = False
        # Whether the surroundings were written, if they are not an infinite level plane.
        self.has_surroundings = run.conditions.surroundings is None
        self.drops = 0  # number of drops that were written
        self.seen = IndexRanges()
        self.heard = time.monotonic()
        self.ended = False  # whether the last message of the run has arrived
        self.folder = folder
        self._failed = failed
        self._log: RunLog | None = None
        with self._errors():
            name = _log_name(run)
            if earlier := _earlier_logs(folder, name):
                name += f'_{len(earlier) + 1}'
            self.folder = folder / name
            self._log = RunLog(folder, name)
            self._log.add_metadata('run', _as_text(run))

    @property
    def being_written(self) -> bool:
        """Whether messages are written to the log."""
        return self._log is not None

    def write(
        self,
        topic: Topic,
        data: bytes,
        log_time: int,
        publish_time: int,
        mesh: tuple[str, str, bytes] | None = None,
    ) -> bool:
        """Write a message, and flush it so that it survives the death of this process.

        mesh : (str, str, bytes), optional
            Name, media type and content of a file, which is attached after the message.

        Returns whether all was written.
        """
        self.heard = time.monotonic()
        with self._errors():
            if self._log is not None:
                # MCAP has no times before the epoch, but a stamp can be before it.
                self._log.write(topic, data, log_time, max(publish_time, 0))
                if mesh is not None:
                    self._log.attach(*mesh, log_time)
                self._log.flush()
        return self._log is not None

    def write_poses(
        self, topic: Topic, data: bytes, log_time: int, publish_time: int, first: int, end: int
    ) -> int:
        """Write the message with the drops ``first`` to ``end - 1``, if any are new.

        Returns how many new drops were written. A message without drops is always written.
        """
        new = sum(high - low for low, high in self.seen.add(first, end)) if first < end else 0
        if first < end and not new:
            return 0
        written = new if self.write(topic, data, log_time, publish_time) else 0
        self.drops += written
        return written

    def missing(self) -> list[tuple[int, int]]:
        """Return the ranges of drops before the last one whose messages have not arrived."""
        return self.seen.missing(self.run.first_drop, self.seen.end)

    def write_part(self, topic: Topic, data: bytes, part: PartDescription, log_time: int) -> None:
        """Write the part's description, and its mesh as an attachment."""
        mesh = f'{part.name}.{part.format}', f'model/{part.format}', bytes(part.mesh)
        self.has_part = self.write(topic, data, log_time, log_time, mesh)

    def write_surroundings(
        self, topic: Topic, data: bytes, surroundings: SurroundingsDescription, log_time: int
    ) -> None:
        """Write the description of the surroundings, and their mesh as an attachment."""
        mesh = None
        if surroundings.surroundings.mesh:
            name = Path(surroundings.surroundings.mesh).name
            media_type = f'model/{Path(name).suffix.lower().lstrip(".")}'
            mesh = name, media_type, bytes(surroundings.mesh)
        self.has_surroundings = self.write(topic, data, log_time, log_time, mesh)

    @property
    def is_described(self) -> bool:
        """Whether the part and the surroundings were written."""
        return self.has_part and self.has_surroundings

    def close(self, *, whole: bool) -> bool | None:
        """Finish the log; returns whether it is whole, or None if it cannot be finished.

        whole : all drops or actions of the run were written
        """
        whole = whole and self.is_described
        with self._errors():
            if self._log is not None:
                self._log.add_metadata(OUTCOME, LogOutcome(self.drops, whole).record())
                self._log.close()
                return whole
        return None

    @contextmanager
    def _errors(self) -> Iterator[None]:
        """Store an error and release the file, so that its content can be recovered."""
        try:
            yield
        except LogError as error:
            self.error = str(error)
            log, self._log = self._log, None
            if log is not None:
                with suppress(LogError):
                    log.close()
            run = f'run {self.run.run_id} of {self.run.part}'
            self._failed(f'only {self.drops} {self.unit} of {run} are recorded: {self.error}')


def whole_log(folder: Path, run: RunDescription) -> Path | None:
    """Return an earlier log that has all of a run; None if there is none."""
    for log in _earlier_logs(folder, _log_name(run)):
        outcome = recorded_outcome(log)
        if outcome is not None and outcome.whole:
            return log
    return None


def _log_name(run: RunDescription) -> str:
    started = datetime.fromtimestamp(run.started / NANOSECONDS, timezone.utc)
    return run_folder_name(run.part, started, run.run_id)


def _earlier_logs(folder: Path, name: str) -> list[Path]:
    """Return the existing logs of the same run, in their order."""
    logs: list[Path] = []
    log = folder / name
    while os.path.lexists(log):
        logs.append(log)
        log = folder / f'{name}_{len(logs) + 1}'
    return logs


def _as_text(run: RunDescription) -> dict[str, str]:
    values, conditions = run.document(), run.conditions.document()
    del values['conditions']
    conditions['surroundings'] = run.conditions.surroundings_key
    return {key: str(value) for key, value in {**values, **conditions}.items()}


class LocalRunLog:
    """The log of a run that is simulated in this process, with the messages of nodes.

    The log is a folder in the given one, which is made if necessary. Topics are those of nodes in
    the root namespace. Raises LogError if the log cannot be written.
    """

    def __init__(self, folder: Path, part: Part, run: RunDescription) -> None:
        self._run = run
        self._waiting = RestingPoses.none(run.first_drop)
        self._recorder = recorder = RunRecorder(folder, run)
        if recorder.error:
            raise LogError(recorder.error)
        topic = _topic(f'{PARTS}/{part.name}', PART_TYPE, LATCHED)
        message = part_msg(part)
        recorder.write_part(topic, serialize_message(message), message, time.time_ns())
        scene = scene_of(part, run.conditions)
        if not scene.level:
            topic = _topic(f'{SURROUNDINGS}/{part.name}', SURROUNDINGS_TYPE, SURROUNDINGS_QOS)
            around = description_msg(run, scene)
            recorder.write_surroundings(topic, serialize_message(around), around, time.time_ns())

    @property
    def folder(self) -> Path:
        """The folder of the log."""
        return self._recorder.folder

    def add(self, poses: RestingPoses, _: npt.NDArray[np.int64]) -> None:
        """Write the messages that the poses complete; they follow those of the call before."""
        waiting = RestingPoses.join([self._waiting, poses])
        end = waiting.end - (waiting.end - waiting.first_drop) % MAX_POSES
        if end == waiting.end:  # the last message of a run is not empty
            end -= MAX_POSES
        if end > waiting.first_drop:
            self._write(waiting.between(waiting.first_drop, end), last=False)
        self._waiting = waiting.between(end, waiting.end)

    def close(self, distribution: Distribution, contacts: ContactCounts | None = None) -> None:
        """Write the remaining poses and the distribution, and finish the log.

        ``contacts`` are the same drops by what they touch.

        Raises LogError if the log does not have all of it.
        """
        recorder, run = self._recorder, self._run
        self._write(self._waiting, last=True)
        topic = _topic(f'{ASPECT_DISTRIBUTIONS}/{run.part}', DISTRIBUTION_TYPE, LATCHED)
        now = time.time_ns()
        if contacts is not None:
            distribution = dataclasses.replace(distribution, contacts=contacts.counted)
        message = distribution_msg(distribution, run, time_msg(now), complete=True)
        recorder.write(topic, serialize_message(message), now, now)
        recorder.close(whole=True)
        if recorder.error:
            raise LogError(recorder.error)

    def _write(self, poses: RestingPoses, *, last: bool) -> None:
        now = time.time_ns()
        topic = _topic(RESTING_POSES, POSES_TYPE, POSES)
        for message in poses_msgs(poses, self._run, time_msg(now), last=last):
            first, end = message.first_drop, message.first_drop + len(message.status)
            self._recorder.write_poses(topic, serialize_message(message), now, now, first, end)


def _topic(name: str, type_name: str, profile: QoSProfile) -> Topic:
    return Topic(f'/{name}', type_name, offered_qos(profile))
