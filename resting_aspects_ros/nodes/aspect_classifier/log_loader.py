"""Results of earlier runs, read from their logs when a node starts."""

import re
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path

from rclpy.node import Node
from rclpy.serialization import deserialize_message
from resting_aspects_interfaces.msg import AspectDistribution, TransitionMatrix

from resting_aspects_ros.aspects.find import ASPECT_NUMBERING, find_aspects
from resting_aspects_ros.errors import LogError, RestingAspectsError
from resting_aspects_ros.input_files import is_folder, printable
from resting_aspects_ros.logs.reader import messages, open_log
from resting_aspects_ros.logs.topics import (
    DISTRIBUTION_TYPE,
    PART_TYPE,
    POSES_TYPE,
    TRANSITIONS_TYPE,
)
from resting_aspects_ros.nodes.aspect_classifier.distribution_store import (
    DistributionStore,
    RunCounts,
)
from resting_aspects_ros.nodes.aspect_classifier.transition_store import TransitionStore
from resting_aspects_ros.ros.callbacks import guarded_task
from resting_aspects_ros.ros.conversions import run_from, serialized_part, serialized_poses
from resting_aspects_ros.ros.distribution_conversions import distribution_from
from resting_aspects_ros.ros.file_worker import FileWorker
from resting_aspects_ros.ros.formatting import count_text
from resting_aspects_ros.ros.transition_conversions import serialized_transitions
from resting_aspects_ros.simulation.job import RunDescription
from resting_aspects_ros.statistics.distribution import Distribution
from resting_aspects_ros.statistics.poses import RestingPoses

# Limits for reading: number of logs (1000 take about 10 s), and total time, s.
MAX_LOGS = 1000
MAX_SECONDS = 120.0
# Maximum number of unusable logs that are listed with the reason.
MAX_LISTED = 10
# <part>_<start>_<run id>, see logs.writer.run_folder_name; _<number> may follow.
_STARTED = re.compile(r'_(\d{8}T\d{6}Z)_')

LoggedRun = tuple[RunDescription, Distribution]


def logs_in(folder: Path) -> list[Path]:
    """Return the folders of logs: the newest of each part, then the second newest, and so on.

    Runs in a FileWorker. The result is empty if the folder does not exist or cannot be read.
    """
    try:
        found = [p for p in folder.iterdir() if _STARTED.search(p.name) and is_folder(p)]
    except OSError:
        return []  # no log has been written yet

    def started(path: Path) -> str:
        return str(_STARTED.findall(path.name)[-1])

    newer: Counter[str] = Counter()  # by part: number of newer logs
    rank: dict[Path, int] = {}
    for path in sorted(found, key=lambda path: (started(path), path.name), reverse=True):
        part = path.name[: path.name.rindex(f'_{started(path)}_')]
        rank[path] = newer[part]
        newer[part] += 1
    # Sorting is stable: of logs with the same rank, the newest is first.
    return sorted(rank, key=lambda path: rank[path])


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
        if not file.has_index:
            return _count_first_drops(log)
        outcome = file.outcome
        last = file.last(DISTRIBUTION_TYPE)
        matrix = None if last is not None else file.last(TRANSITIONS_TYPE)
    if matrix is not None:
        return serialized_transitions(matrix)
    if outcome is not None and outcome.whole and last is not None:
        message = deserialize_message(last, AspectDistribution)
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
    sequence = run.sequence()
    for poses in RestingPoses.blocks(each for of, each in batches if of.sequence() == sequence):
        if poses.first_drop <= run.first_drop < poses.end:
            counts = RunCounts(run, pending=[poses.between(run.first_drop, run.end)])
            counts.count(part, find_aspects(part))
            return run, counts.counted
    raise LogError('it does not contain the first drops of its run')


class LogLoader:
    """Reads the logs in a folder, up to MAX_LOGS: the newest of each part first.

    ready : whether all logs have been read
    state : text describing the progress

    Parameters
    ----------
    folder : folder of the logs; None: read nothing
    files : reads the logs, so that a file cannot block the node
    known : receives the distributions
    transitions : receives the transition matrices
    """

    def __init__(
        self,
        node: Node,
        folder: Path | None,
        files: FileWorker,
        known: DistributionStore,
        transitions: TransitionStore,
    ) -> None:
        self._node = node
        self._folder = folder
        self._files = files
        self._known = known
        self._transitions = transitions
        self._unused: dict[str, str] = {}  # reasons by name
        self._used = 0
        self.ready = False
        self.state = 'the logs of earlier runs are still being read'

    async def load(self, done: Callable[[], None]) -> None:
        """Read all logs, skipping unreadable ones, then call ``done``."""
        await guarded_task(self._node, 'the logs of earlier runs were not read', self._load)()
        self.ready = True
        done()

    async def _load(self) -> None:
        if self._folder is None:
            return
        start = time.monotonic()
        try:
            logs: list[Path] = await self._files.run(logs_in, self._folder)
        except RestingAspectsError as error:
            self._node.get_logger().warning(f'log_folder {str(self._folder)!r}: {error}')
            return
        skipped = len(logs[MAX_LOGS:])
        for k, log in enumerate(logs[:MAX_LOGS]):
            if time.monotonic() - start > MAX_SECONDS:
                skipped += len(logs[k:MAX_LOGS])
                break
            self.state = f'{k} of {len(logs)} logs of earlier runs have been read, try again soon'
            await self._read(log)
        self._log_summary(len(logs), skipped, time.monotonic() - start)

    async def _read(self, log: Path) -> None:
        try:
            logged: LoggedRun | TransitionMatrix | None = await self._files.run(load_log, log)
            if isinstance(logged, TransitionMatrix):
                self._transitions.add(logged)
            elif logged is not None:
                self._known.add(*logged)
            self._used += logged is not None
        except RestingAspectsError as error:
            self._unused[printable(log.name)] = str(error)

    def _log_summary(self, logs: int, skipped: int, seconds: float) -> None:
        if not logs:
            return
        known = count_text(len(self._known), 'distribution is', 'distributions are')
        if matrices := len(self._transitions):
            matrix = count_text(matrices, 'transition matrix', 'transition matrices')
            known = f'{matrix} and {known}'
        self._node.get_logger().info(
            f'{self._used} of {count_text(logs, "log of an earlier run", "logs of earlier runs")} '
            f'in {self._folder} read in {seconds:.1f} s: {known} known'
        )
        if skipped:
            self._node.get_logger().warning(
                f'{count_text(skipped, "log", "logs")} in {self._folder} not read: the limit is '
                f'{MAX_LOGS} logs or {MAX_SECONDS:g} s, newest logs of each part first'
            )
        if self._unused:
            named = list(self._unused.items())[:MAX_LISTED]
            more = len(self._unused) - len(named)
            unused = count_text(len(self._unused), 'log', 'logs')
            self._node.get_logger().warning(
                f'{unused} in {self._folder} cannot be used: '
                + '; '.join(f'{name}: {why}' for name, why in named)
                + (f'; and {more} more' if more else '')
            )
