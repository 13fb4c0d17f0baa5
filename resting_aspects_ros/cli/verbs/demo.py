"""`resting_aspects demo`: the suite as three processes, and a client that requests drops."""

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path

from resting_aspects_ros.api.result import check_files
from resting_aspects_ros.api.runner import DropProgress
from resting_aspects_ros.cli.console import print_result
from resting_aspects_ros.cli.node_processes import NodeProcesses, own_namespace
from resting_aspects_ros.cli.verbs.request import result_from
from resting_aspects_ros.client.client import RestingAspectsClient
from resting_aspects_ros.errors import RestingAspectsError
from resting_aspects_ros.run_logs import logged_result
from resting_aspects_ros.system import Interruption

PART, DROPS, SEED = 'l_bracket', 1000, 1
NODES = ('drop_simulator', 'aspect_classifier', 'drop_recorder')
# Maximum time for the drops, s.
TIMEOUT = 600.0
LOG_TIMEOUT = 20.0  # s
LOG_PERIOD = 0.1  # s

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


def run(arguments: argparse.Namespace) -> None:
    """Run the demo. Raises RestingAspectsError if a node fails."""
    out: Path = arguments.out
    logs = out / 'logs'
    check_files('--out', out, [f'{node}.log' for node in NODES])
    namespace = ['-r', f'__ns:={own_namespace("demo")}']
    parameters = {
        'drop_recorder': ['-p', f'log_folder:={logs}'],
        # Without logs, a second demo makes its drops again.
        'aspect_classifier': ['-p', "log_folder:=''"],
    }
    print(f'Starting {", ".join(NODES)} as three processes ...', flush=True)
    with Interruption() as stop, NodeProcesses(out, stop.check) as processes:
        for node in NODES:
            processes.start(node, [*namespace, *parameters.get(node, [])])
        processes.wait_until_ready()
        log = _ask(namespace, logs, processes.check)
        print(f'Log:    {log}', flush=True)
        stop.check()
    print(f'Report: {logged_result(log).report(out)}')


def _ask(namespace: list[str], logs: Path, check: Callable[[], None]) -> Path:
    """Request and show the distribution, and wait for the log; returns the path of the log."""
    with RestingAspectsClient(ros_args=namespace, check=check) as client:
        with DropProgress(PART, DROPS) as progress:
            message = client.get_distribution(
                PART, drops=DROPS, seed=SEED, timeout=TIMEOUT, progress=progress.update
            )
        result = result_from(message, client.get_part(PART))
    print_result(result)
    sys.stdout.flush()
    run_id = result.run.run_id
    end = time.monotonic() + LOG_TIMEOUT
    while time.monotonic() < end:
        # metadata.yaml is written last.
        for metadata in logs.glob(f'*_{run_id}/metadata.yaml'):
            return next(metadata.parent.glob('*.mcap'))
        check()
        time.sleep(LOG_PERIOD)
    raise RestingAspectsError(
        f'no log of run {run_id} was written to {str(logs)!r} within {LOG_TIMEOUT:g} s'
    )
