"""`resting_aspects demo`: the suite as three processes, asked by a client, on a real part."""

import argparse
import os
import sys
import time
from pathlib import Path
from typing import Any

from resting_aspects_ros.commands.interruption import Interruption
from resting_aspects_ros.commands.node_processes import NodeProcesses
from resting_aspects_ros.commands.outputs import check_output, make_folder
from resting_aspects_ros.core.errors import RestingAspectsError

PART, DROPS, SEED = 'l_bracket', 1000, 1
NODES = ('drop_simulator', 'aspect_classifier', 'drop_recorder')
LOG_TIMEOUT = 20.0  # s
LOG_PERIOD = 0.1  # s

EXAMPLES = """examples:
  resting_aspects demo
  resting_aspects demo --out result
"""


def add(subparsers: Any) -> None:
    """Declare the subcommand."""
    parser = subparsers.add_parser(
        'demo',
        description='Start drop_simulator, aspect_classifier and drop_recorder as three\n'
        f'processes that talk over DDS, ask for the distribution of {PART},\n'
        f'{DROPS} drops, as a ROS client, show it, stop everything, and make the report.',
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        '--out',
        metavar='DIR',
        type=Path,
        default=Path('out/demo'),
        help='folder of the report, the log of the run, and what the nodes print (out/demo)',
    )
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Do it; raises RestingAspectsError if a node does not do its part."""
    out: Path = arguments.out
    logs = out / 'logs'
    make_folder('--out', out)
    for node in NODES:
        check_output('--out', out / f'{node}.log')
    # A second to import, which --help does not need.
    from resting_aspects_ros.commands.logged_answer import logged_answer
    from resting_aspects_ros.commands.report_files import check_report, write_report

    check_report('--out', out)
    # A name of its own keeps it apart from other suites on this machine, and this machine from
    # others in the network.
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    namespace = ['-r', f'__ns:=/demo_{os.getpid()}']
    parameters = {
        'drop_recorder': ['-p', f'log_folder:={logs}'],
        # The second demo is to drop, too.
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
    print(f'Report: {write_report(logged_answer(log), out)}')
    return 0


def _ask(namespace: list[str], logs: Path, check: Any) -> Path:
    """Ask for the distribution, show it, and wait for the log; returns where that is."""
    from resting_aspects_ros.commands.progress import DropProgress
    from resting_aspects_ros.commands.request import answer_from
    from resting_aspects_ros.nodes.client import RestingAspectsClient

    check()
    with RestingAspectsClient(ros_args=namespace, check=check) as client:
        with DropProgress(PART, DROPS) as progress:
            message = client.get_distribution(
                PART, drops=DROPS, seed=SEED, progress=progress.update
            )
        answer = answer_from(message, client.get_part(PART))
    answer.print(as_json=False)
    sys.stdout.flush()
    run_id = answer.run.run_id
    end = time.monotonic() + LOG_TIMEOUT
    while not _logs(logs, run_id) and time.monotonic() < end:
        check()
        time.sleep(LOG_PERIOD)
    for log in _logs(logs, run_id):
        return log
    raise RestingAspectsError(f'no log of run {run_id} came to be in {str(logs)!r}')


def _logs(folder: Path, run_id: str) -> list[Path]:
    """The MCAP file of a run, once it is whole: metadata.yaml is written last."""
    whole = folder.glob(f'*_{run_id}/metadata.yaml')
    return [log for metadata in whole for log in metadata.parent.glob('*.mcap')]
