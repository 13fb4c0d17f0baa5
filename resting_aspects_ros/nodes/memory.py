"""What earlier runs found, read from their logs when a node starts."""

import re
import time
from collections.abc import Callable
from pathlib import Path

from rclpy.node import Node

from resting_aspects_ros import __version__
from resting_aspects_ros.core.errors import RestingAspectsError
from resting_aspects_ros.logs.indexed_log import IndexedLog, NoIndexError
from resting_aspects_ros.logs.outcome import Outcome
from resting_aspects_ros.logs.topics import DISTRIBUTION_TYPE
from resting_aspects_ros.nodes.distribution_messages import serialized_distribution
from resting_aspects_ros.nodes.run_accounts import KnownDistributions
from resting_aspects_ros.nodes.words import counted

# Logs that are read, the newest of those that are there; 1000 take some 10 s.
MOST_LOGS = 1000
# <part>_<start>_<run id>, see logs.run_log.run_folder_name.
_STARTED = re.compile(r'_(\d{8}T\d{6}Z)_')


class Memory:
    """Reads the logs in a folder one by one, newest first, while the node does its work.

    Parameters
    ----------
    folder : Path, optional
        None: there is nothing to remember.
    known : takes the distribution of each log that is whole
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
        self._logs = _newest_logs(folder) if folder else []
        self._total = len(self._logs)
        self._begun = time.monotonic()
        self._taken = self._broken_off = self._other_versions = 0
        # A log at each turn of the executor: others get theirs in between.
        self._timer = node.create_timer(0.0, self._read_next)

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
        except (RestingAspectsError, RuntimeError) as error:  # the second is all that rclpy raises
            self._other_versions += 1
            self._node.get_logger().debug(f'log {log} is not used: {error}')
            return
        if run.suite_version != __version__:
            self._other_versions += 1  # its aspects may have other ids
        elif complete:
            self._taken += 1
            self._known.add(run, distribution)

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
        if self._broken_off:
            logs = counted(self._broken_off, 'log', 'logs')
            self._node.get_logger().warning(
                f'{logs} in {self._folder}, broken off, not used: "resting_aspects recover" makes '
                'a log whole'
            )
        if self._other_versions:
            logs = counted(self._other_versions, 'log', 'logs')
            self._node.get_logger().warning(
                f'{logs} in {self._folder}, of another version of the suite or damaged, not used'
            )


def _newest_logs(folder: Path) -> list[Path]:
    """Folders of logs, the newest last."""
    try:
        found = [path for path in folder.iterdir() if _STARTED.search(path.name) and path.is_dir()]
    except OSError:
        return []  # no log was written yet

    def started(path: Path) -> str:
        return _STARTED.findall(path.name)[-1]

    return sorted(found, key=started)[-MOST_LOGS:]
