"""`resting_aspects demo`: the suite as three processes, asked by a client, on a real part."""

import argparse
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from resting_aspects_ros.commands.progress import DropProgress
from resting_aspects_ros.commands.request import show
from resting_aspects_ros.config_files import surfaces_file
from resting_aspects_ros.core.errors import RestingAspectsError
from resting_aspects_ros.drops.surfaces import Surfaces

PART, DROPS, SEED = 'l_bracket', 1000, 1
NODES = ('drop_simulator', 'aspect_classifier', 'drop_recorder')
STOP_TIMEOUT = 10.0
LOG_TIMEOUT = 20.0


def add(subparsers: Any) -> None:
    """Declare the subcommand."""
    parser = subparsers.add_parser(
        'demo',
        help=f'drop {PART} {DROPS} times over ROS and show the result',
        description='Start drop_simulator, aspect_classifier and drop_recorder as three processes '
        f'that talk over DDS, ask for the distribution of {PART}, {DROPS} drops, as a ROS client, '
        'show it, and stop everything.',
    )
    parser.add_argument(
        '--out', metavar='DIR', type=Path, default=Path('out/demo'), help='folder (out/demo)'
    )
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Do it."""
    out: Path = arguments.out
    out.mkdir(parents=True, exist_ok=True)
    # A name of its own keeps it apart from other suites on this machine, and this machine from
    # others in the network.
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    namespace = ['-r', f'__ns:=/demo_{os.getpid()}']
    print(f'Starting {", ".join(NODES)} as three processes ...', flush=True)
    with _processes(out, namespace) as processes:
        from resting_aspects_ros.nodes.client import distribution_request, suite_client

        request = distribution_request(PART, Surfaces.read(surfaces_file()).get(), DROPS, SEED)
        with suite_client(['--ros-args', *namespace]) as client:
            with DropProgress(PART, DROPS) as progress:
                answer = client.get(request, progress.update, lambda: _check(processes, out))
            picture = out / f'{PART}.png'
            show(answer, client.part(PART), as_json=False, picture=picture)
            logs = out / 'logs'
            found = client.wait(lambda: _log(logs, answer.run.run_id) is not None, LOG_TIMEOUT)
        if not found:
            raise RestingAspectsError(f'no log of run {answer.run.run_id} came to be in {logs}')
    print(f'Log:     {_log(logs, answer.run.run_id)}')
    print(f'Picture: {picture}')
    return 0


def _log(folder: Path, run_id: str) -> Path | None:
    """The MCAP file of a run, once it is whole: metadata.yaml is written last."""
    for metadata in folder.glob(f'*_{run_id}/metadata.yaml'):
        return next(metadata.parent.glob('*.mcap'), None)
    return None


@contextmanager
def _processes(out: Path, namespace: list[str]) -> Iterator[dict[str, subprocess.Popen[bytes]]]:
    """The nodes, each in a process of its own; stopped in any case."""
    running: dict[str, subprocess.Popen[bytes]] = {}
    try:
        for node in NODES:
            parameters = ['-p', f'log_folder:={out / "logs"}'] if node == 'drop_recorder' else []
            with (out / f'{node}.log').open('wb') as log:
                running[node] = subprocess.Popen(
                    [
                        sys.executable,
                        '-m',
                        f'resting_aspects_ros.nodes.{node}',
                        '--ros-args',
                        *namespace,
                        *parameters,
                    ],
                    stdin=subprocess.DEVNULL,
                    stdout=log,
                    stderr=subprocess.STDOUT,
                    # Ctrl-C is for this process, which then stops them in order.
                    start_new_session=True,
                )
        yield running
    finally:
        _stop(running)


def _stop(running: dict[str, subprocess.Popen[bytes]]) -> None:
    """The way a person would, and the hard way if that does not help."""
    for process in running.values():
        process.send_signal(signal.SIGINT)
    for process in running.values():
        try:
            process.wait(STOP_TIMEOUT)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def _check(running: dict[str, subprocess.Popen[bytes]], out: Path) -> None:
    for node, process in running.items():
        if process.poll() is not None:
            raise RestingAspectsError(
                f'{node} ended with exit code {process.returncode}: see {out / f"{node}.log"}'
            )
