"""What the classifier knows of parts, of logs of earlier runs, and of transitions."""

import dataclasses
import re
import time
from collections.abc import Callable
from hashlib import sha256
from pathlib import Path

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.serialization import deserialize_message
from resting_aspects_interfaces.msg import AspectDistribution, PartDescription, TransitionMatrix

from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.aspects.find import ASPECT_NUMBERING, find_aspects
from resting_aspects_ros.errors import LogError, PartError, RestingAspectsError, shown
from resting_aspects_ros.input_files import is_folder, printable
from resting_aspects_ros.logs.reader import messages, open_log
from resting_aspects_ros.logs.topics import (
    DISTRIBUTION_TYPE,
    PART_TYPE,
    POSES_TYPE,
    TRANSITIONS_TYPE,
)
from resting_aspects_ros.nodes.aspect_classifier.counting import Tallies, Tally
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.ros.callbacks import advertise, sleep_for
from resting_aspects_ros.ros.conversions import (
    check_description,
    part_from,
    run_from,
    serialized_part,
    serialized_poses,
)
from resting_aspects_ros.ros.distribution_conversions import (
    check_numbering,
    check_transitions,
    distribution_from,
    serialized_transitions,
)
from resting_aspects_ros.ros.file_worker import FileWorker
from resting_aspects_ros.ros.health import TopicDiscovery, count_text
from resting_aspects_ros.ros.interface import LATCHED, TRANSITIONS
from resting_aspects_ros.ros.requests import NotAvailableError, unknown_part
from resting_aspects_ros.simulation.job import RunDescription
from resting_aspects_ros.statistics.distribution import Distribution

# The parts of a simulator arrive one after another. Time without a new part after which all parts
# have arrived, s.
QUIET_PERIOD = 5.0
# Interval of checks for a requested part while parts arrive, s.
CHECK_PERIOD = 0.1


def read_part(data: bytes, name: str) -> tuple[Part, AspectSet]:
    """Return the part in a serialized description on parts/<name>; runs in a FileWorker."""
    message = deserialize_message(data, PartDescription)
    check_description(message, name)
    part = part_from(message)
    return part, find_aspects(part)


@dataclasses.dataclass(eq=False)
class _Offer:
    """The newest description of a part.

    digest : hash of the description, by which a repeated one is recognised
    part : None while the description is being read, and if it cannot be used
    problem : why it cannot be used
    """

    digest: bytes
    part: Part | None = None
    problem: str = ''


@dataclasses.dataclass(eq=False)
class PartRegistry:
    """The parts as currently described, and the aspects of every version received.

    files : reads descriptions, so that a mesh cannot block the node
    changed : called with the part when a description has been read
    simulator_is_ready : returns whether a simulator offers parts
    check_ready : raises NotAvailableError while the node is not ready for requests
    """

    node: Node
    files: FileWorker
    changed: Callable[[Part], None]
    simulator_is_ready: Callable[[], bool]
    check_ready: Callable[[], None]

    def __post_init__(self) -> None:
        self._offers: dict[str, _Offer] = {}
        self._last: dict[str, Part] = {}  # by name, including parts that are no longer offered
        self._versions: dict[str, tuple[Part, AspectSet]] = {}
        self._last_arrival = time.monotonic()
        self._simulator_was_ready = False

    async def describe(self, name: str, data: bytes) -> None:
        """Read a serialized description of a part; ignore the result if a newer one has arrived.

        The same description is read only once: a looped replay repeats it, possibly faster than
        it can be read.
        """
        digest = sha256(data).digest()
        if name in self._offers and self._offers[name].digest == digest:
            return
        self._offers[name] = offer = _Offer(digest)
        try:
            part, aspects = await self.files.run(read_part, data, name)
        except RestingAspectsError as error:
            offer.problem = f'part {name!r} cannot be used: {error}'
            self.node.get_logger().warning(offer.problem)
            return
        finally:
            self._last_arrival = time.monotonic()
        self._versions[part.part_sha256] = part, aspects
        if self._offers.get(name) is offer:
            offer.part = self._last[name] = part
            self.changed(part)

    def remove(self, name: str) -> None:
        """Remove a part that is no longer offered; its aspects stay known."""
        self._offers.pop(name, None)

    def get(self, name: str) -> Part | None:
        """Return the currently offered part of a name, or None."""
        return self._offers[name].part if name in self._offers else None

    def offered(self) -> dict[str, Part]:
        """Return the offered parts by name."""
        return {name: each.part for name, each in self._offers.items() if each.part is not None}

    def problem(self, name: str) -> str:
        """Return why an offered part cannot be used; empty if it can."""
        return self._offers[name].problem if name in self._offers else ''

    def aspects(self, part_sha256: str) -> AspectSet | None:
        """Return the aspects of a version of a part, or None if it has not been read."""
        known = self._versions.get(part_sha256)
        return known[1] if known else None

    def version(self, part_sha256: str) -> tuple[Part, AspectSet]:
        """Return a version of a part that has been read, and its aspects."""
        return self._versions[part_sha256]

    async def usable(self, name: str) -> dict[str, Part]:
        """Return the parts that can be requested, by name; waits for the named part to arrive.

        Without a simulator, no part is offered, and the result contains the parts offered before.
        Raises PartError if the part is offered but cannot be used, and NotAvailableError while the
        node is not ready.
        """
        self.check_ready()
        while True:
            is_ready = self.simulator_is_ready()
            if is_ready and not self._simulator_was_ready:
                self._last_arrival = time.monotonic()  # its parts are not discovered yet
            self._simulator_was_ready = is_ready
            if problem := self.problem(name):
                raise PartError(problem)
            parts = self.offered() if is_ready else dict(self._last)
            is_being_read = name in self._offers and self._offers[name].part is None
            is_quiet = time.monotonic() - self._last_arrival >= QUIET_PERIOD
            if not is_being_read and (name in parts or is_quiet):
                return parts
            await sleep_for(self.node, CHECK_PERIOD)

    async def requested(self, name: str) -> Part:
        """Return a part by name; raises as ``usable``, or UnknownPartError with the parts."""
        parts = await self.usable(name)
        if name in parts:
            return parts[name]
        raise unknown_part(name, parts)


# Maximum number of kept matrices.
MAX_KNOWN = 1000
# Time in which the first matrix of a part arrives that was published before a request, s. The
# topic is found within 0.5 s on an idle machine.
ARRIVAL = 5.0


class TransitionStore:
    """Subscribes to transitions/*, and keeps the newest matrix of each part and action.

    The simulator publishes the matrices of its runs. While no node publishes those of a part, the
    store does, so that late subscribers receive what was known before the simulator was restarted.
    """

    def __init__(self, node: Node, parts: PartRegistry) -> None:
        self._node = node
        self._parts = parts
        self._known: dict[tuple[str, str, str], TransitionMatrix] = {}
        self._published: dict[str, tuple[Publisher, str]] = {}  # by part, with the run id
        self._discovery = TopicDiscovery(
            node, TRANSITIONS, TransitionMatrix, self._receive, gone=self.publish
        )

    def __len__(self) -> int:
        """Return the number of known matrices."""
        return len(self._known)

    def add(self, message: TransitionMatrix) -> None:
        """Add a valid matrix."""
        key = (message.run.part, message.run.part_sha256, message.action.name)
        candidates = [message, self._known.pop(key, message)]
        self._known[key] = max(candidates, key=_order)
        while len(self._known) > MAX_KNOWN:
            self._known.pop(next(iter(self._known)))

    def find(self, part: str, part_sha256: str, action: str) -> TransitionMatrix | None:
        """Return the newest matrix of an action on a version of a part, or None."""
        return self._known.get((part, part_sha256, action))

    def publish(self, part: str) -> None:
        """Publish the newest matrix of a part, unless another node publishes its matrices."""
        known = [each for each in self._of(part) if each.ended]
        topic = self._discovery.topic(part)
        if not known or part in self._published or self._node.count_publishers(topic):
            return
        newest = max(known, key=_order)
        publisher = advertise(self._node, TransitionMatrix, topic, LATCHED)
        publisher.publish(newest)
        self._published[part] = (publisher, newest.run.run_id)

    async def newest(self, name: str, action: str) -> TransitionMatrix:
        """Return the matrix that a request names; any action if it is empty.

        If no matrix of a part has arrived yet, but a node publishes matrices of this part, the
        first one is waited for. Raises RestingAspectsError.
        """
        offered = await self._parts.usable(name)
        sha = offered[name].part_sha256 if name in offered else ''
        until = time.monotonic() + ARRIVAL
        topic = self._discovery.topic(name)
        while not (of_part := self._of(name, sha)) and self._node.count_publishers(topic):
            if time.monotonic() > until:
                break
            await sleep_for(self._node, CHECK_PERIOD)
        is_ready = self._parts.simulator_is_ready()
        if name not in offered and (is_ready or (offered and not of_part)):
            raise unknown_part(name, offered)
        known = [each for each in of_part if action in ('', each.action.name)]
        if known:
            return max(known, key=_order)
        asked = f' by action {shown(action)}' if action else ''
        raise NotAvailableError(
            f'no transitions of {shown(name)}{asked} are known, request reorient_part'
        )

    def _of(self, part: str, part_sha256: str = '') -> list[TransitionMatrix]:
        """Return the matrices of a version of a part; by default the offered one, else of all."""
        if not part_sha256 and (described := self._parts.get(part)) is not None:
            part_sha256 = described.part_sha256
        return [
            each
            for (name, sha, _), each in self._known.items()
            if name == part and part_sha256 in ('', sha)
        ]

    def _receive(self, part: str, message: TransitionMatrix) -> None:
        check_transitions(message, part)
        check_numbering(message)
        self.add(message)
        if part in self._published and message.run.run_id != self._published[part][1]:
            self._node.destroy_publisher(self._published.pop(part)[0])  # another node publishes


def _order(message: TransitionMatrix) -> tuple[object, ...]:
    """Sort key: complete matrices first, then by start, and within a run by progress."""
    started = message.run.started
    made = sum(message.actions)
    return (
        message.complete,
        started.sec,
        started.nanosec,
        message.run.run_id,
        made,
        message.ended,
    )


# Maximum number of logs that are read; they take about 10 s.
MAX_LOGS = 1000
# Maximum number of unusable logs that are listed with the reason.
MAX_LISTED = 10
# <part>_<start>_<run id>, see logs.writer.run_folder_name; _<number> may follow.
_STARTED = re.compile(r'_(\d{8}T\d{6}Z)_')

LoggedRun = tuple[RunDescription, Distribution]


def logs_in(folder: Path) -> list[Path]:
    """Return the folders of logs, the newest first; runs in a FileWorker.

    The result is empty if the folder does not exist or cannot be read.
    """
    try:
        found = [p for p in folder.iterdir() if _STARTED.search(p.name) and is_folder(p)]
    except OSError:
        return []  # no log has been written yet
    return sorted(found, key=lambda p: (_STARTED.findall(p.name)[-1], p.name), reverse=True)


def load_log(log: Path) -> LoggedRun | TransitionMatrix | None:
    """Return a run and its distribution, or a matrix, or None if the log is being written.

    Runs in a FileWorker. The result is the distribution in the log if it counts all drops of the
    run and uses the current aspect numbering; otherwise the consecutive drops from the first one
    on are counted. From a log of actions, it is the last matrix, which is that of an unfinished
    run if the log was cut off. Raises RestingAspectsError if the log contains none of these.
    """
    with open_log(log) as file:
        if file.being_written:
            return None
        if not file.closed:
            raise LogError('it is not closed: repair it with "resting_aspects recover"')
        results = file.of_types([DISTRIBUTION_TYPE, TRANSITIONS_TYPE])
        last = {each.type: each.data for each in results}
    if DISTRIBUTION_TYPE not in last and TRANSITIONS_TYPE in last:
        return serialized_transitions(last[TRANSITIONS_TYPE])
    if file.outcome is not None and file.outcome.whole and DISTRIBUTION_TYPE in last:
        message = deserialize_message(last[DISTRIBUTION_TYPE], AspectDistribution)
        if message.complete and message.aspect_numbering == ASPECT_NUMBERING:
            return run_from(message.run), distribution_from(message)
    return _count_first_drops(log)


def _count_first_drops(log: Path) -> LoggedRun:
    """Return a run and the distribution of its drops up to the first missing one.

    They are a run that ended there. Raises RestingAspectsError if the log lacks the first drop or
    the part.
    """
    batches = [serialized_poses(data)[:2] for data in messages(log, POSES_TYPE)]
    if not batches:
        raise LogError('it contains no drops')
    run = batches[0][0]
    parts = (serialized_part(data) for data in messages(log, PART_TYPE))
    part = next((part for part in parts if part.part_sha256 == run.part_sha256), None)
    if part is None:
        raise LogError('it does not describe its part')
    tally = Tally(run)
    for of, poses in batches:
        if of.sequence() == tally.sequence:
            tally.add(of, poses.between(run.first_drop, run.end), last=False)
    tally.count(part, find_aspects(part))
    if not tally.drops:
        raise LogError('it does not contain the first drops of its run')
    return run, tally.counted


@dataclasses.dataclass(eq=False)
class LogLoader:
    """Reads the logs in a folder, the newest ones up to MAX_LOGS.

    folder : of the logs; None: read nothing
    files : reads the logs, so that a file cannot block the node
    known, transitions : receive what is read

    ready : whether all logs have been read
    state : text describing the progress
    """

    node: Node
    folder: Path | None
    files: FileWorker
    known: Tallies
    transitions: TransitionStore

    def __post_init__(self) -> None:
        self._unused: list[str] = []  # names with reasons
        self.ready = False
        self.state = 'the logs of earlier runs are still being read'

    async def load(self, done: Callable[[], None]) -> None:
        """Read all logs, skipping unreadable ones, then call ``done``."""
        try:
            if self.folder is not None:
                await self._load(self.folder)
        except RestingAspectsError as error:
            self.node.get_logger().warning(f'log_folder {str(self.folder)!r}: {error}')
        finally:
            self.ready = True
            done()

    async def _load(self, folder: Path) -> None:
        start = time.monotonic()
        logs: list[Path] = await self.files.run(logs_in, folder)
        for k, log in enumerate(logs[:MAX_LOGS]):
            self.state = f'{k} of {len(logs)} logs of earlier runs have been read, try again soon'
            try:
                await self._read(log)
            except Exception as error:  # noqa: BLE001 - a log must not hide the others
                self._unused.append(f'{printable(log.name)}: {error}')
        logger = self.node.get_logger()
        if logs:
            read = count_text(len(logs[:MAX_LOGS]), 'log', 'logs')
            known = count_text(len(self.known), 'distribution', 'distributions')
            matrices = count_text(len(self.transitions), 'matrix', 'matrices')
            logger.info(
                f'{read} in {folder} read in {time.monotonic() - start:.1f} s; known: {known} of '
                f'drops, {matrices} of transitions'
            )
        if logs[MAX_LOGS:]:
            logger.warning(f'the {len(logs[MAX_LOGS:])} oldest logs in {folder} are not read')
        if self._unused:
            number = count_text(len(self._unused), 'log', 'logs')
            listed = '; '.join(self._unused[:MAX_LISTED])
            logger.warning(f'{number} in {folder} cannot be used: {listed}')

    async def _read(self, log: Path) -> None:
        logged: LoggedRun | TransitionMatrix | None = await self.files.run(load_log, log)
        if isinstance(logged, TransitionMatrix):
            self.transitions.add(logged)
        elif logged is not None:
            self.known.add(*logged)
