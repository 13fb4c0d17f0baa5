"""What earlier runs found, read from their logs when a node starts."""

import re
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from rclpy.node import Node

from resting_aspects_ros import __version__
from resting_aspects_ros.core.distribution import Distribution
from resting_aspects_ros.core.errors import RestingAspectsError
from resting_aspects_ros.drops.run import RunDescription
from resting_aspects_ros.logs.indexed_log import IndexedLog, NoIndexError
from resting_aspects_ros.logs.log_reader import is_being_written
from resting_aspects_ros.logs.outcome import Outcome
from resting_aspects_ros.logs.topics import DISTRIBUTION_TYPE, POSES_TYPE
from resting_aspects_ros.nodes.convert import serialized_batch
from resting_aspects_ros.nodes.distribution_messages import serialized_distribution
from resting_aspects_ros.nodes.first_drops import count_first_drops

# Logs that are read, the newest of those that are there; 1000 take some 10 s.
MOST_LOGS = 1000
# <part>_<start>_<run id>, see logs.run_log.run_folder_name; _<number> after it is another log.
_STARTED = re.compile(r'_(\d{8}T\d{6}Z)_')
_RUN = re.compile(r'.*_\d{8}T\d{6}Z_[^_]*')


class Memory:
    """Reads the logs in a folder one by one, newest first, while the node does its work.

    Parameters
    ----------
    folder : Path, optional
        None: there is nothing to remember.
    take : called with the run and the distribution of each log that is closed; of one that holds
        only a part of its run, that of its first drops
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
        self._logs = _newest_logs(folder) if folder else []
        self._parts: list[tuple[Path, RunDescription]] = []  # logs with a part of their run
        self._whole: set[str] = set()  # names of runs, as folders have them, that a log has whole
        self._broken_off: list[Path] = []
        self._total = len(self._logs)
        self._begun = time.monotonic()
        self._taken = self._other_versions = 0
        self._steps = self._read_all()
        self._timer = node.create_timer(0.0, self._step)

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
                    self._take(run, (yield from count_first_drops(log, run)))
                    self._taken += 1
            self._parts.pop()

    @contextmanager
    def _reading(self, log: Path) -> Iterator[None]:
        try:
            yield
        except NoIndexError:
            if not is_being_written(log):
                self._broken_off.append(log)
        except (RestingAspectsError, RuntimeError) as error:  # the second is all that rclpy raises
            self._other_versions += 1
            self._node.get_logger().debug(f'log {log} is not used: {error}')

    def _read(self, log: Path) -> None:
        with IndexedLog(log) as indexed:
            outcome = Outcome.of(indexed.notes())
            batch, counted = indexed.first(POSES_TYPE), indexed.last(DISTRIBUTION_TYPE)
        if outcome is None or batch is None:
            return
        run = serialized_batch(batch)[0]
        if run.suite_version != __version__:
            self._other_versions += 1  # its aspects may have other ids
            return
        if outcome.whole and counted is not None:
            distribution, run, complete = serialized_distribution(counted)
            if complete:
                self._whole.add(_run_name(log))
                self._taken += 1
                self._take(run, distribution)
                return
        self._parts.append((log, run))

    def _tell(self) -> None:
        if not self._total:
            return
        seconds = time.monotonic() - self._begun
        words = f'{self._taken} distributions of earlier runs in {self._folder}, read in '
        self._node.get_logger().info(f'{words}{seconds:.1f} s')
        # Those of runs that another log has whole are of no use to anybody.
        broken_off = [log for log in self._broken_off if _run_name(log) not in self._whole]
        if broken_off:
            self._node.get_logger().warning(
                f'{len(broken_off)} logs in {self._folder} were broken off and are not used: '
                '"resting_aspects recover" closes them; then the drops that they hold are'
            )
        if self._other_versions:
            self._node.get_logger().warning(
                f'{self._other_versions} logs in {self._folder} are of other versions of the '
                'suite, damaged, or lack the part or the first drops, and are not used'
            )


def _run_name(log: Path) -> str:
    """The name that all logs of a run begin with."""
    found = _RUN.match(log.name)
    return found.group() if found else log.name


def _newest_logs(folder: Path) -> list[Path]:
    """Folders of logs, the newest last."""
    try:
        found = [path for path in folder.iterdir() if _STARTED.search(path.name) and path.is_dir()]
    except OSError:
        return []  # no log was written yet

    def started(path: Path) -> str:
        return _STARTED.findall(path.name)[-1]

    return sorted(found, key=started)[-MOST_LOGS:]
