"""`resting_aspects demo`: the suite as three processes, and a client that requests drops."""

import argparse
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any

from resting_aspects_ros.api.output_files import check_output, make_folder
from resting_aspects_ros.core.errors import RestingAspectsError
from resting_aspects_ros.simulation.interruption import Interruption

PART, DROPS, SEED = 'l_bracket', 1000, 1
NODES = ('drop_simulator', 'aspect_classifier', 'drop_recorder')
LOG_TIMEOUT = 20.0  # s
LOG_PERIOD = 0.1  # s
STOP_TIMEOUT = 10.0  # s, for a node to end in order

DESCRIPTION = f"""Start drop_simulator, aspect_classifier and drop_recorder as three
processes that communicate over DDS. Request the distribution of {PART} in
{DROPS} drops as a ROS client, show it, stop all processes, and write the report."""
EXAMPLES = """examples:
  resting_aspects demo
  resting_aspects demo --out result
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument(
        '--out',
        metavar='DIR',
        type=Path,
        default=Path('out/demo'),
        help='folder of the report, the log of the run and the output of the nodes (out/demo)',
    )


def run(arguments: argparse.Namespace) -> int:
    """Run the demo; returns the exit code. Raises RestingAspectsError if a node fails."""
    out: Path = arguments.out
    logs = out / 'logs'
    make_folder('--out', out)
    for node in NODES:
        check_output('--out', out / f'{node}.log')
    # These imports take a second, and --help does not need them.
    from resting_aspects_ros.api.report_files import check_report, write_report
    from resting_aspects_ros.run_logs.contents import logged_result

    check_report('--out', out)
    # A unique namespace separates the demo from other suites on this machine, and LOCALHOST from
    # other machines in the network.
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    namespace = ['-r', f'__ns:=/demo_{os.getpid()}']
    parameters = {
        'drop_recorder': ['-p', f'log_folder:={logs}'],
        # Without logs, a second demo makes its drops again.
        'aspect_classifier': ['-p', "log_folder:=''"],
    }
    print(f'Starting {", ".join(NODES)} as three processes ...', flush=True)
    with Interruption() as stop, NodeProcesses(out) as processes:
        for node in NODES:
            processes.start(node, [*namespace, *parameters.get(node, [])])

        def check() -> None:
            stop.check()
            processes.check()

        log = _ask(namespace, logs, check)
        print(f'Log:    {log}', flush=True)
        stop.check()
    print(f'Report: {write_report(logged_result(log), out)}')
    return 0


def _ask(namespace: list[str], logs: Path, check: Any) -> Path:
    """Request and show the distribution, and wait for the log; returns the path of the log."""
    from resting_aspects_ros.api.progress import DropProgress
    from resting_aspects_ros.cli.console import print_result
    from resting_aspects_ros.cli.verbs.request import result_from
    from resting_aspects_ros.client.client import RestingAspectsClient

    check()
    with RestingAspectsClient(ros_args=namespace, check=check) as client:
        with DropProgress(PART, DROPS) as progress:
            message = client.get_distribution(
                PART, drops=DROPS, seed=SEED, progress=progress.update
            )
        result = result_from(message, client.get_part(PART))
    print_result(result, as_json=False)
    sys.stdout.flush()
    run_id = result.run.run_id
    end = time.monotonic() + LOG_TIMEOUT
    while not _logs(logs, run_id) and time.monotonic() < end:
        check()
        time.sleep(LOG_PERIOD)
    for log in _logs(logs, run_id):
        return log
    raise RestingAspectsError(
        f'no log of run {run_id} was written to {str(logs)!r} within {LOG_TIMEOUT:g} s'
    )


def _logs(folder: Path, run_id: str) -> list[Path]:
    """Return the MCAP file of a run once it is complete: metadata.yaml is written last."""
    complete = folder.glob(f'*_{run_id}/metadata.yaml')
    return [log for metadata in complete for log in metadata.parent.glob('*.mcap')]


class NodeProcesses:
    """Running nodes, whose output is in <folder>/<node>.log.

    Requires an Interruption: if Ctrl-C raised an exception in `start`, a process could be left.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._running: dict[str, subprocess.Popen[bytes]] = {}

    def __enter__(self) -> 'NodeProcesses':  # noqa: PYI034 - Self is newer than Python 3.10
        return self

    def start(self, node: str, ros_args: Sequence[str]) -> None:
        """Start a node of resting_aspects_ros.nodes."""
        module = f'resting_aspects_ros.nodes.{node}.node'
        with self._log(node).open('wb') as log:
            self._running[node] = subprocess.Popen(
                [sys.executable, '-m', module, '--ros-args', *ros_args],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                # Ctrl-C reaches only this process, which then stops the nodes in order.
                start_new_session=True,
            )

    def check(self) -> None:
        """Raise RestingAspectsError if a node has ended."""
        for node, process in self._running.items():
            if (code := process.poll()) is not None:
                raise RestingAspectsError(
                    f'{node} ended {_manner(code)}: see {str(self._log(node))!r}'
                )

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
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

    def _log(self, node: str) -> Path:
        return self._folder / f'{node}.log'


def _manner(code: int) -> str:
    if code >= 0:
        return f'with exit code {code}'
    return f'by signal {signal.Signals(-code).name}'
