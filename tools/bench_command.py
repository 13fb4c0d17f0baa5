"""Run time and peak memory of the command line."""

import re
import statistics
import subprocess
import sys
import time
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path

from bench_case import EXAMPLE
from bench_report import Section, Table
from dropper import ROOT
from rich.progress import track

from resting_aspects_ros.simulation.run_description import DEFAULT_DROPS

REPEATS = 3
# Memory is compared between these numbers of drops.
FEW, MANY = 2000, 20_000
# Period of reading the memory, s. The kernel stores the peak, so only the last period can be
# missed.
PERIOD = 0.05
PROCESSES = Path('/proc')


@dataclass(frozen=True)
class Run:
    """A finished command; peak memory, MiB, of the parent and of the largest worker."""

    seconds: float
    parent: float
    worker: float


def command() -> Section:
    """Measure the run time and the peak memory."""
    numbers = [*[DEFAULT_DROPS] * REPEATS, FEW, MANY]
    runs = [(n, _run(n)) for n in track(numbers, 'command', transient=True)]
    by_number: dict[int, list[Run]] = defaultdict(list)
    for n, run in runs:
        by_number[n].append(run)
    table = Table(['drops', 'seconds', 'peak memory of the parent', 'of a worker'])
    for n, same in by_number.items():
        last = same[-1]
        seconds = statistics.median(run.seconds for run in same)
        table.rows.append(
            [f'{n}', f'{seconds:.2f}', f'{last.parent:.1f} MiB', f'{last.worker:.1f} MiB']
        )
    found = {
        f'seconds_{DEFAULT_DROPS}_drops': statistics.median(
            run.seconds for run in by_number[DEFAULT_DROPS]
        ),
        **{
            f'{who}_peak_mib_{n}_drops': getattr(by_number[n][-1], who)
            for n in (FEW, MANY)
            for who in ('parent', 'worker')
        },
    }
    text = (
        f'`resting_aspects drop {EXAMPLE} --drops N`, from the start of the process to its end, '
        f'including the printed table. For {DEFAULT_DROPS} drops (the default), the time is the '
        f'median of {REPEATS} runs. Memory is the peak of the resident memory (VmHWM).'
    )
    return Section('Run time of the command', text, [table], {'command': found})


def _run(drops: int) -> Run:
    started = time.perf_counter()
    with subprocess.Popen(
        [
            *(sys.executable, '-m', 'resting_aspects_ros.cli'),
            *('drop', EXAMPLE, '--drops', str(drops)),
        ],
        cwd=ROOT,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    ) as process:
        peaks: dict[int, float] = {}
        while True:
            peaks |= _peaks(process.pid)
            try:
                code = process.wait(PERIOD)
                break
            except subprocess.TimeoutExpired:
                continue
        seconds = time.perf_counter() - started
    if code:
        raise subprocess.CalledProcessError(code, process.args)
    parent = peaks.pop(process.pid)
    return Run(seconds, parent, max(peaks.values()))


def _peaks(parent: int) -> dict[int, float]:
    """Return the peak memory of a process and of its children, MiB, by process id."""
    found = {}
    for folder in PROCESSES.glob('[0-9]*'):
        try:
            status = (folder / 'status').read_text(encoding='utf-8')
        except OSError:  # the process has ended
            continue
        numbers = {key: int(n) for key, n in re.findall(r'^(\w+):\s+(\d+)', status, re.MULTILINE)}
        if parent in (numbers['Pid'], numbers['PPid']) and 'VmHWM' in numbers:
            found[numbers['Pid']] = numbers['VmHWM'] / 1024
    return found
