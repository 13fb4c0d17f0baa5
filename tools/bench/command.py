"""Run time and peak memory of the command line and of the import."""

import re
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator

from rich.progress import track
from validation.document import paragraphs, table
from validation.dropper import ROOT

from bench.case import EXAMPLE

# Runs of which the time is the median, and of the long commands.
REPEATS = 3
# Drops, runs, and the aim, s.
DROPS = ((1000, REPEATS, '1.2'), (100_000, 1, '5'), (1_000_000, 1, ''))
POINTS, POINT_DROPS = 64, 2000
STUDY = [
    *('study', EXAMPLE, '--points', str(POINTS), '--drops', str(POINT_DROPS)),
    *('--vary', 'restitution=0.3:0.7', '--vary', 'friction=0.1:0.5', '--out'),
]
IMPORT = 'import resting_aspects_ros'
# Runs the command, and prints the memory of its process on standard error at its end.
PROGRAM = """
import atexit, runpy, sys
from pathlib import Path

atexit.register(lambda: print(Path('/proc/self/status').read_text(), file=sys.stderr))
runpy.run_module('resting_aspects_ros.cli', run_name='__main__')
"""


def command() -> Iterator[str]:
    """Measure the times and the peak memory."""
    cases = [
        (f'drop, {n} drops', PROGRAM, ['drop', EXAMPLE, '--drops', str(n)], repeats, aim)
        for n, repeats, aim in DROPS
    ]
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        study = [*STUDY, f'{folder}/study']
        cases.append((f'study, {POINTS} points of {POINT_DROPS} drops', PROGRAM, study, 1, '8'))
        cases.append((IMPORT, IMPORT, [], REPEATS, '0.1'))
        for name, program, arguments, repeats, aim in track(cases, 'command', transient=True):
            runs = [_run(program, arguments) for _ in range(repeats)]
            seconds, memory = statistics.median(run[0] for run in runs), runs[-1][1]
            rows.append([name, f'{seconds:.2f}', aim, f'{memory:.0f}' if memory else ''])
    yield from paragraphs(
        '## Run time of the command',
        f'`resting_aspects drop {EXAMPLE} --drops N`, a study over restitution and friction with '
        'its page, and the import of the package, each from the start of the process to its end, '
        f'with a kernel that was compiled before. The time is the median of {REPEATS} runs, for '
        'the long commands of one. Memory is the peak of the resident memory (VmHWM); that of '
        'the drops must not grow with their number.',
    )
    yield from table(['', 'seconds', 'aim', 'peak memory (MiB)'], rows, numbers=True)


def _run(program: str, arguments: list[str]) -> tuple[float, float]:
    """Run Python code; returns the time, s, and the peak memory, MiB, if it prints it."""
    started = time.perf_counter()
    words = [sys.executable, '-c', program, *arguments]
    done = subprocess.run(words, cwd=ROOT, check=True, text=True, capture_output=True)
    seconds = time.perf_counter() - started
    memory = re.search(r'^VmHWM:\s+(\d+)', done.stderr, re.MULTILINE)
    return seconds, int(memory[1]) / 1024 if memory else 0.0
