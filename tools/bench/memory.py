"""Time that a classifier needs at its start to read the logs of earlier runs."""

import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from bench.case import EXAMPLE
from bench.report import Section, Table

LOGS = 200
TIMEOUT = 60.0
# Part of the log message of the node.
READ = re.compile(r'read in ([0-9.]+) s')


def memory() -> Section:
    """Measure the time that the node reports."""
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    with tempfile.TemporaryDirectory() as folder:
        log = _log_of_a_run(Path(folder) / 'demo')
        logs = Path(folder) / 'logs'
        for k in range(LOGS):
            shutil.copytree(log, logs / f'{EXAMPLE}_20200101T{k:06}Z_{k}')
        seconds = _seconds_to_read(logs)
    table = Table(['', 'time (s)'], [[f'{LOGS} logs', f'{seconds:.1f}']])
    note = (
        f'Time that a classifier needs at its start to read {LOGS} logs, each a copy of the log '
        'of `make demo`, as reported by the node. Aim: at most 5 s.'
    )
    return Section('Logs of earlier runs', note, [table], {'memory': {'logs_read_s': seconds}})


def _log_of_a_run(folder: Path) -> Path:
    command = [sys.executable, '-m', 'resting_aspects_ros.cli', 'demo', '--out', str(folder)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    (log,) = (folder / 'logs').iterdir()
    return log


def _seconds_to_read(logs: Path) -> float:
    words = ['--ros-args', '-r', f'__ns:=/bench_{os.getpid()}', '-p', f'log_folder:={logs}']
    classifier = subprocess.Popen(
        [sys.executable, '-m', 'resting_aspects_ros.nodes.aspect_classifier.node', *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    try:
        assert classifier.stdout is not None
        for line in classifier.stdout:
            if found := READ.search(line):
                return float(found[1])
        raise SystemExit(f'the classifier exited before it had read {logs}')
    finally:
        classifier.terminate()
        classifier.wait(TIMEOUT)
