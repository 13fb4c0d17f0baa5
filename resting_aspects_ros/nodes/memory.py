"""What earlier runs found, read from their logs when a node starts."""

import re
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from rclpy.node import Node

from resting_aspects_ros import __version__
from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.drops.run import RunDescription
from resting_aspects_ros.logs.indexed_log import IndexedLog, NoIndexError
from resting_aspects_ros.logs.log_reader import is_being_written
from resting_aspects_ros.logs.outcome import Outcome
from resting_aspects_ros.logs.topics import DISTRIBUTION_TYPE, POSES_TYPE
from resting_aspects_ros.nodes.callbacks import guarded, steady_timer
from resting_aspects_ros.nodes.convert import serialized_batch
from resting_aspects_ros.nodes.distribution_messages import serialized_distribution
from resting_aspects_ros.nodes.first_drops import count_first_drops
from resting_aspects_ros.nodes.run_accounts import KnownDistributions
from resting_aspects_ros.nodes.words import counted

# Logs that are read at most; 1000 take some 10 s.
MOST_LOGS = 1000
# A log, or a batch of one, at each turn of the executor: others get theirs in between, s.
READ_PERIOD = 0.0
# <part>_<start>_<run id>, see logs.run_log.run_folder_name; _<number> after it is another log.
_STARTED = re.compile(r'_(\d{8}T\d{6}Z)_')
_RUN = re.compile(r'.*_\d{8}T\d{6}Z_[^_]*')


class Memory:
    """Reads the logs in a folder one by one, newest first, while the node does its work.

    If there are more than MOST_LOGS, as many of each part are read.

    Parameters
    ----------
    folder : Path, optional
        None: there is nothing to remember.
    known : takes the distribution of each log that is closed; of one that holds only a part of
        its run, that of its first drops
    loaded : called once all are read
    """

    def __init__(
        self,
        node: Node,
        folder: Path | None,
        known: KnownDistributions,
        loaded: Callable[[], None],
    ) -> None:
        self._node = node
        self._folder = folder
        self._known = known
        self._loaded = loaded
        logs = _logs_in(folder) if folder else []
        self._logs, self._unread = logs[-MOST_LOGS:], len(logs[:-MOST_LOGS])
        self._parts: list[tuple[Path, RunDescription]] = []  # logs with a part of their run
        self._whole: set[str] = set()  # names of runs, as folders have them, that a log has whole
        self._broken_off: list[Path] = []
        self._total = len(self._logs)
        self._begun = time.monotonic()
        self._taken = self._unused = 0
        self._steps = self._read_all()
        step = guarded(node, 'earlier runs are not used', self._step)
        self._timer = steady_timer(node, READ_PERIOD, step)

    @property
    def loading(self) -> str:
        """How far it is, in words; empty when all is read."""
        left = len(self._logs) + len(self._parts)
        if not left:
            return ''
        done = self._total - left
        return f'loading: {done} of {self._total} logs of earlier runs are read, ask again soon'

    def _step(self) -> None:
        """A log, or a batch of one, at each turn of the executor: others get theirs in between."""
        for _ in self._steps:
            return
        self._node.destroy_timer(self._timer)
        self._logs.clear()  # one that went away just now ends the reading
        self._parts.clear()
        self._tell()
        self._loaded()

    def _read_all(self) -> Iterator[None]:
        while self._logs:
            with self._reading(self._logs[-1]):
                self._read(self._logs[-1])
            self._logs.pop()
            yield
        while self._parts:
            log, run = self._parts[-1]
            with self._reading(log):
                if _run_name(log) not in self._whole:
                    self._known.add(run, (yield from count_first_drops(log, run)))
                    self._taken += 1
            self._parts.pop()

    @contextmanager
    def _reading(self, log: Path) -> Iterator[None]:
        try:
            yield
        except NoIndexError:
            if not is_being_written(log):
                self._broken_off.append(log)
        except InvalidValueError as error:
            self._unused += 1
            self._node.get_logger().warning(f'log {str(log)!r} is not used: {error}')
        except Exception as error:  # noqa: BLE001 - whatever is in a log, the suite starts
            self._unused += 1
            self._node.get_logger().debug(f'log {str(log)!r} is not used: {error!r}')

    def _read(self, log: Path) -> None:
        with IndexedLog(log) as indexed:
            outcome = Outcome.of(indexed.notes())
            batch, last = indexed.first(POSES_TYPE), indexed.last(DISTRIBUTION_TYPE)
        if outcome is None:
            return
        if outcome.whole and last is not None:
            distribution, run, complete = serialized_distribution(last)
            if complete:
                if self._is_of_this_version(run):
                    self._known.add(run, distribution)
                    self._whole.add(_run_name(log))
                    self._taken += 1
                return
        if batch is not None:
            run = serialized_batch(batch)[0]
            if self._is_of_this_version(run):
                self._parts.append((log, run))

    def _is_of_this_version(self, run: RunDescription) -> bool:
        if run.suite_version != __version__:
            self._unused += 1  # its aspects may have other ids
            return False
        return True

    def _tell(self) -> None:
        if not self._total:
            return
        seconds = time.monotonic() - self._begun
        logs = counted(self._taken, 'log of an earlier run', 'logs of earlier runs')
        known = counted(len(self._known), 'distribution is', 'distributions are')
        self._node.get_logger().info(
            f'{logs} in {self._folder} read in {seconds:.1f} s: {known} known, the longest of '
            'those that begin with the same drops'
        )
        if self._unread:
            logs = counted(self._unread, 'log', 'logs')
            self._node.get_logger().warning(
                f'{logs} in {self._folder}, not read: allowed are {MOST_LOGS}, of each part the '
                'newest'
            )
        # Those of runs that another log has whole are of no use to anybody.
        broken_off = [log for log in self._broken_off if _run_name(log) not in self._whole]
        if broken_off:
            logs = counted(len(broken_off), 'log', 'logs')
            self._node.get_logger().warning(
                f'{logs} in {self._folder}, broken off, not used: "resting_aspects recover" '
                'closes a log, then the drops that it holds are'
            )
        if self._unused:
            logs = counted(self._unused, 'log', 'logs')
            self._node.get_logger().warning(
                f'{logs} in {self._folder}, not used: of another version of the suite, damaged, '
                'or without the part or the first drops'
            )


def _run_name(log: Path) -> str:
    """The name that all logs of a run begin with."""
    found = _RUN.match(log.name)
    return found.group() if found else log.name


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
    for path in sorted(found, key=lambda path: (started(path), path.name), reverse=True):
        part = path.name[: path.name.rindex(f'_{started(path)}_')]
        turn[path] = newer[part]
        newer[part] += 1
    return sorted(turn, key=lambda path: (-turn[path], started(path), path.name))
