"""What earlier runs found, read from their logs when a node starts."""

import re
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path

from rclpy.node import Node

from resting_aspects_ros import __version__
from resting_aspects_ros.core.distribution import Distribution
from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.drops.run import RunDescription
from resting_aspects_ros.logs.indexed_log import IndexedLog, NoIndexError
from resting_aspects_ros.logs.outcome import Outcome
from resting_aspects_ros.logs.topics import DISTRIBUTION_TYPE
from resting_aspects_ros.nodes.callbacks import guarded, steady_timer
from resting_aspects_ros.nodes.distribution_messages import serialized_distribution

# Logs that are read at most; 1000 take some 10 s.
MOST_LOGS = 1000
# A log at each turn of the executor: others get theirs in between, s.
READ_PERIOD = 0.0
# <part>_<start>_<run id>, see logs.run_log.run_folder_name.
_STARTED = re.compile(r'_(\d{8}T\d{6}Z)_')


class Memory:
    """Reads the logs in a folder one by one, newest first, while the node does its work.

    If there are more than MOST_LOGS, as many of each part are read.

    Parameters
    ----------
    folder : Path, optional
        None: there is nothing to remember.
    take : called with the run and the distribution of each log that is whole; raises
        InvalidValueError if it cannot be used
    loaded : called once all are read
    """

    def __init__(
        self,
        node: Node,
        folder: Path | None,
        take: Callable[[RunDescription, Distribution], None],
        loaded: Callable[[], None],
    ) -> None:
        self._node = node
        self._folder = folder
        self._take = take
        self._loaded = loaded
        logs = _logs_in(folder) if folder else []
        self._logs, self._unread = logs[-MOST_LOGS:], len(logs[:-MOST_LOGS])
        self._total = len(self._logs)
        self._begun = time.monotonic()
        self._taken = self._broken_off = self._other_versions = 0
        read = guarded(node, 'earlier runs are not used', self._read_next)
        self._timer = steady_timer(node, READ_PERIOD, read)

    @property
    def loading(self) -> str:
        """How far it is, in words; empty when all is read."""
        if not self._logs:
            return ''
        done = self._total - len(self._logs)
        return f'loading: {done} of {self._total} logs of earlier runs are read, ask again soon'

    def _read_next(self) -> None:
        if self._logs:
            self._read(self._logs.pop())
        if not self._logs:
            self._node.destroy_timer(self._timer)
            self._tell()
            self._loaded()

    def _read(self, log: Path) -> None:
        try:
            with IndexedLog(log) as indexed:
                outcome = Outcome.of(indexed.notes())
                data = indexed.last(DISTRIBUTION_TYPE)
            if outcome is None or not outcome.whole or data is None:
                return
            distribution, run, complete = serialized_distribution(data)
        except NoIndexError:
            self._broken_off += 1
            return
        except Exception as error:  # noqa: BLE001 - whatever is in a log, the suite starts
            self._other_versions += 1
            self._node.get_logger().debug(f'log {log} is not used: {error!r}')
            return
        if run.suite_version != __version__:
            self._other_versions += 1  # its aspects may have other ids
        elif complete:
            self._use(log, run, distribution)

    def _use(self, log: Path, run: RunDescription, distribution: Distribution) -> None:
        try:
            self._take(run, distribution)
        except InvalidValueError as error:
            self._other_versions += 1
            self._node.get_logger().warning(f'log {log} is not used: {error}')
        else:
            self._taken += 1

    def _tell(self) -> None:
        if not self._total:
            return
        seconds = time.monotonic() - self._begun
        words = f'{self._taken} distributions of earlier runs in {self._folder}, read in '
        self._node.get_logger().info(f'{words}{seconds:.1f} s')
        if self._unread:
            self._node.get_logger().warning(
                f'{self._unread} logs in {self._folder} are not read: allowed are {MOST_LOGS}, '
                'of each part the newest'
            )
        if self._broken_off:
            self._node.get_logger().warning(
                f'{self._broken_off} logs in {self._folder} were broken off and are not used: '
                '"resting_aspects recover" makes them whole'
            )
        if self._other_versions:
            self._node.get_logger().warning(
                f'{self._other_versions} logs in {self._folder} are of other versions of the '
                'suite, or damaged, and are not used'
            )


def _logs_in(folder: Path) -> list[Path]:
    """Folders of logs; last the newest of each part, before them the second of each, and so on."""
    try:
        found = [path for path in folder.iterdir() if _STARTED.search(path.name) and path.is_dir()]
    except OSError:
        return []  # no log was written yet

    def started(path: Path) -> str:
        return _STARTED.findall(path.name)[-1]

    newer: Counter[str] = Counter()  # logs of a part that are newer than the one in turn
    turn: dict[Path, int] = {}
    for path in sorted(found, key=started, reverse=True):
        part = path.name[: path.name.rindex(f'_{started(path)}_')]
        turn[path] = newer[part]
        newer[part] += 1
    return sorted(turn, key=lambda path: (-turn[path], started(path)))
