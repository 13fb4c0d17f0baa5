"""Nodes as processes of a command, which end with it."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

from resting_aspects_ros.errors import RestingAspectsError

# Time for a node to start, s: they import for 10 s and more on a busy machine.
START_TIMEOUT, START_PERIOD = 600.0, 0.1
STOP_TIMEOUT = 10.0  # s, for a node to end in order


def own_namespace(name: str) -> str:
    """Return a namespace that separates the nodes of this process from other suites.

    They are not seen by other machines in the network.
    """
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    return f'/{name}_{os.getpid()}'


class NodeProcesses:
    """Running nodes, whose output is in <folder>/<node>.log.

    Requires an Interruption: if Ctrl-C raised an exception in `start`, a process could be left.
    ``interruption`` raises KeyboardInterrupt after Ctrl-C.
    """

    def __init__(self, folder: Path, interruption: Callable[[], None]) -> None:
        self._folder, self._interruption = folder, interruption
        self._running: dict[str, subprocess.Popen[bytes]] = {}

    def __enter__(self) -> 'NodeProcesses':  # noqa: PYI034 - Self is newer than Python 3.10
        return self

    def start(self, node: str, ros_args: Sequence[str]) -> None:
        """Start a node of resting_aspects_ros.nodes."""
        module = f'resting_aspects_ros.nodes.{node}.node'
        with log_of(self._folder, node).open('wb') as log:
            self._running[node] = subprocess.Popen(
                [sys.executable, '-m', module, '--ros-args', *ros_args],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                # Ctrl-C reaches only this process, which then stops the nodes in order.
                start_new_session=True,
            )

    def wait_until_ready(self) -> None:
        """Wait until each node has logged that it is ready; raises RestingAspectsError."""
        end = time.monotonic() + START_TIMEOUT
        for node in self._running:
            log = log_of(self._folder, node)
            while b': ready' not in log.read_bytes():
                self.check()
                if time.monotonic() > end:
                    raise RestingAspectsError(
                        f'{node} is not ready after {START_TIMEOUT:g} s: see {str(log)!r}'
                    )
                time.sleep(START_PERIOD)

    def check(self) -> None:
        """Raise RestingAspectsError if a node has ended, and KeyboardInterrupt after Ctrl-C."""
        self._interruption()
        for node, process in self._running.items():
            if (code := process.poll()) is not None:
                raise RestingAspectsError(
                    f'{node} ended with exit code {code}: see {str(log_of(self._folder, node))!r}'
                )

    def __exit__(self, *_: object) -> None:
        # SIGTERM ends a node without a traceback even while it is still importing.
        for process in self._running.values():
            process.terminate()
        end = time.monotonic() + STOP_TIMEOUT
        for process in self._running.values():
            try:
                process.wait(max(0.0, end - time.monotonic()))
            except subprocess.TimeoutExpired:
                with suppress(ProcessLookupError):
                    os.killpg(process.pid, signal.SIGKILL)  # also ends its workers
                process.wait()


def log_of(folder: Path, node: str) -> Path:
    """Return the file with the output of a node."""
    return folder / f'{node}.log'
