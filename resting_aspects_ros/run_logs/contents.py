"""Contents of a log: a run with its part and poses or matrix, or the messages of a feeder."""

import dataclasses
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path
from typing import Any, TypeVar

from rclpy.serialization import deserialize_message, serialize_message
from resting_aspects_interfaces.msg import (
    DetectionArray,
    FeederAdvice,
    ObservedCounts,
    PickResult,
    Posterior,
    TransitionMatrix,
)

from resting_aspects_ros.api.conditions import without_drops
from resting_aspects_ros.api.drop import DropResult
from resting_aspects_ros.api.model_range import missing_in, model_range_of
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.errors import InvalidValueError, LogError, one_line, shown, warn
from resting_aspects_ros.input_files import is_folder, named
from resting_aspects_ros.logs.bag import LogOutcome
from resting_aspects_ros.logs.reader import Log, open_log
from resting_aspects_ros.logs.topics import (
    DISTRIBUTION_TYPE,
    PART_TYPE,
    POSES_TYPE,
    SURROUNDINGS_TYPE,
    TRANSITIONS_TYPE,
)
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.ros.conversions import (
    serialized_part,
    serialized_poses,
    serialized_range,
    serialized_surroundings,
    time_msg,
)
from resting_aspects_ros.ros.count_conversions import observed_from, time_label
from resting_aspects_ros.ros.distribution_conversions import (
    distribution_msg,
    serialized_distribution,
    serialized_transitions,
)
from resting_aspects_ros.ros.interface import CHOICES, RESULTS
from resting_aspects_ros.simulation.job import RunDescription
from resting_aspects_ros.simulation.surroundings import Surroundings
from resting_aspects_ros.statistics.counted_parts import ObservedCounts as CountedParts
from resting_aspects_ros.statistics.distribution import (
    Distribution,
    History,
    aspect_ids,
    count_poses,
    no_drops,
)
from resting_aspects_ros.statistics.poses import IndexRanges, RestingPoses

T = TypeVar('T')
TYPES = (POSES_TYPE, PART_TYPE, SURROUNDINGS_TYPE, DISTRIBUTION_TYPE, TRANSITIONS_TYPE)
# Folders of the logs of a feeder, and the types of their messages.
FEEDER_LOGS = 'feeder-*'
FEEDER_TYPES = {
    f'resting_aspects_interfaces/msg/{kind.__name__}': kind
    for kind in (DetectionArray, PickResult, FeederAdvice, ObservedCounts, Posterior)
}
COUNTS_TYPE = 'resting_aspects_interfaces/msg/ObservedCounts'


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
    path, messages, finished, being_written, warning
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
        self.warning = ''
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
        if self.warning:
            warn(self.warning)

    def _batch(self, data: bytes) -> tuple[RunDescription, int, int, bool]:
        if not self._keep_poses:
            return parsed(self.log, serialized_range, data)
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
    with open_log(log) as file:
        recorded = file.outcome if file.has_index else None
        if keep_poses or recorded is None:
            _add_all(run, file, TYPES)
        else:
            if not recorded.whole:  # there can be gaps
                _add_all(run, file, [POSES_TYPE])
            elif batch := file.first(POSES_TYPE):
                run.add(POSES_TYPE, batch)
            for type_name in TYPES[1:]:
                if data := file.last(type_name):
                    run.add(type_name, data)
        run.path, run.messages, run.recorded = file.path, file.message_count, file.outcome
        run.finished, run.being_written, run.warning = (
            file.closed,
            file.being_written,
            file.warning,
        )
    return run


def _add_all(run: LoggedRun, file: Log, types: Sequence[str]) -> None:
    for message in file.of_types(types):
        run.add(message.type, message.data)


def logged_result(log: Path, *, keep_poses: bool = False) -> DropResult:
    """Return a result with a new count of the drops in a log, without duplicates.

    The result has the poses only if ``keep_poses`` is set and no drops are missing. Raises
    InvalidValueError if the log has no drops or not their part, LogError if it cannot be read.
    """
    logged = read_logged_run(log, keep_poses=True)
    result, blocks = _counted(logged)
    logged.warn_if_unfinished()
    return dataclasses.replace(
        result, poses=blocks[0] if keep_poses and len(blocks) == 1 else None
    )


def _counted(logged: LoggedRun) -> tuple[DropResult, list[RestingPoses]]:
    """Return a count of the drops in a log, without poses, and the blocks of its drops."""
    log, run, part = logged.log, logged.run, logged.part
    if run is None:
        raise InvalidValueError(f'{named("log", log)} contains no drops')
    if part is None or part.part_sha256 != run.part_sha256:
        raise InvalidValueError(f'{named("log", log)} does not describe its part')
    run = logged.known_run
    assert run is not None
    aspects, contacts = without_drops(part, run.conditions, find_aspects(part))
    distribution = no_drops(aspects, by_precision=run.precision > 0)
    history = History(distribution.aspects)
    sequence = run.sequence()
    of_run = (poses for each, poses in logged.batches if each.sequence() == sequence)
    blocks = [each.between(run.first_drop, run.end) for each in RestingPoses.blocks(of_run)]
    for poses in blocks:
        ids = aspect_ids(distribution.aspects, poses)
        history.add(ids)
        distribution += count_poses(distribution.aspects, poses, ids)
        if contacts is not None:
            contacts.add(poses, ids)
    result = DropResult(
        model_range_of(distribution, part, run),
        run,
        part,
        logged.outcome.whole and logged.finished,
        history=history.points(),
        contacts=contacts,
        no_model_range=missing_in(run),
    )
    return result, blocks


def counted_distribution(log: Path, stamp: int, frame: str) -> bytes:
    """Return the serialized distribution of the drops in a log, which may be open.

    Runs in a FileWorker. Raises InvalidValueError and LogError as logged_result.

    stamp : ns since the epoch
    """
    result, _ = _counted(read_logged_run(log, keep_poses=True))
    distribution = dataclasses.replace(result.distribution, contacts=result.contacts)
    message = distribution_msg(distribution, result.run, time_msg(stamp), True, frame)
    return bytes(serialize_message(message))


# -- feeder ---------------------------------------------------------------------------------------


@dataclass
class FeederLog:
    """What the messages in a log of a feeder state together.

    start, end : time of the first and of the last message, ns since 1970
    images, detections : number of images, and of parts in them
    results : number of pick results by what was done
    advice : number of messages on feeder_advice/<part> by choice, by part
    posteriors : the last message on posterior/<part>, by part
    counts : number of messages on observed_counts/<part>, by part
    """

    start: int = 0
    end: int = 0
    images: int = 0
    detections: int = 0
    results: Counter[str] = field(default_factory=Counter)
    advice: dict[str, Counter[str]] = field(default_factory=lambda: defaultdict(Counter))
    posteriors: dict[str, Posterior] = field(default_factory=dict)
    counts: Counter[str] = field(default_factory=Counter)

    def add(self, message: Any, time: int) -> None:
        """Count a message."""
        self.start, self.end = self.start or time, time
        if isinstance(message, DetectionArray):
            self.images += 1
            self.detections += len(message.detections)
        elif isinstance(message, PickResult):
            self.results[RESULTS.get(message.result, 'unknown')] += 1
        elif isinstance(message, FeederAdvice):
            self.advice[message.part][CHOICES.get(message.choice, 'unknown')] += 1
        elif isinstance(message, Posterior):
            self.posteriors[message.part] = message
        else:
            self.counts[message.part] += 1

    def document(self) -> dict[str, object]:
        """Return the content as plain JSON types."""
        return {
            'start': self.start,
            'end': self.end,
            'images': self.images,
            'detections': self.detections,
            'pick_results': dict(self.results),
            'advice': {part: dict(choices) for part, choices in self.advice.items()},
            'observed_counts': dict(self.counts),
            'counted_parts': {k: list(each.observed) for k, each in self.posteriors.items()},
        }

    def lines(self) -> Iterator[tuple[str, str]]:
        """Yield label and text of each fact."""
        yield 'feeder', f'{time_label(self.start)} to {time_label(self.end)}'
        yield 'seen', f'{self.detections} detections in {self.images} images'
        yield 'done', _listed(self.results) or 'no pick results'
        for part, choices in self.advice.items():
            yield 'advised', f'{part}: {_listed(choices)}'
        for part, number in self.counts.items():
            yield 'counted', f'{part}: {number} messages'
        for part, last in self.posteriors.items():
            classes = ', '.join(f'class {k}: {n}' for k, n in enumerate(last.observed, 1))
            drift = f'. {last.message}' if last.message else ''
            yield 'parts', f'{part}: {last.parts} counted, {classes}{drift}'


def read_feeder_log(log: Path) -> FeederLog | None:
    """Return the content of a log; None if it has no message of a feeder. Raises LogError."""
    found = FeederLog()
    with open_log(log) as file:
        for each in file.of_types(FEEDER_TYPES):
            found.add(_read(log, FEEDER_TYPES[each.type], each.data), each.time)
    return found if found.end else None


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
    counted: list[tuple[int, bytes]] = []
    parts = set()
    for log in nested or [path]:
        with open_log(log) as file:
            for each in file.of_types([COUNTS_TYPE]):
                name = _read(log, ObservedCounts, each.data).part
                parts.add(name)
                if part in ('', name):
                    counted.append((each.time, each.data))
    if not counted or (not part and len(parts) > 1):
        raise InvalidValueError(
            f'invalid counts in {named("log", path)}: expected observed_counts of '
            f'{part or "one part"}, found {shown(", ".join(sorted(parts))) if parts else "none"}'
        )
    return observed_from(counted, str(path), ids)


def _read(log: Path, kind: Any, data: bytes) -> Any:
    return parsed(log, partial(deserialize_message, message_type=kind), data)


def _listed(counts: Counter[str]) -> str:
    return ', '.join(f'{number} {name}' for name, number in counts.items())
