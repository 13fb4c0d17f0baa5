"""Run time and peak memory of the command line and of the import."""

import re
import statistics
import subprocess
import sys
import tempfile
import time

from rich.progress import track
from validation.dropper import ROOT

from bench.case import EXAMPLE
from bench.report import Section, Table

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


def command() -> Section:
    """Measure the times and the peak memory."""
    table = Table(['', 'seconds', 'aim', 'peak memory (MiB)'])
    found: dict[str, float] = {}

    def add(name: str, program: str, arguments: list[str], repeats: int, aim: str) -> None:
        runs = [_run(program, arguments) for _ in range(repeats)]
        seconds, memory = statistics.median(run[0] for run in runs), runs[-1][1]
        table.rows.append([name, f'{seconds:.2f}', aim, f'{memory:.0f}' if memory else ''])
        found[name] = seconds
        if memory:
            found[f'{name}, MiB'] = memory

    for drops, repeats, aim in track(DROPS, 'command', transient=True):
        arguments = ['drop', EXAMPLE, '--drops', str(drops)]
        add(f'drop, {drops} drops', PROGRAM, arguments, repeats, aim)
    with tempfile.TemporaryDirectory() as folder:
        name = f'study, {POINTS} points of {POINT_DROPS} drops'
        add(name, PROGRAM, [*STUDY, f'{folder}/study'], 1, '8')
    add(IMPORT, IMPORT, [], REPEATS, '0.1')
    text = (
        f'`resting_aspects drop {EXAMPLE} --drops N`, a study over restitution and friction with '
        'its page, and the import of the package, each from the start of the process to its end, '
        f'with a kernel that was compiled before. The time is the median of {REPEATS} runs, for '
        'the long commands of one. Memory is the peak of the resident memory (VmHWM); that of '
        'the drops must not grow with their number.'
    )
    return Section('Run time of the command', text, [table], {'command': found})


def _run(program: str, arguments: list[str]) -> tuple[float, float]:
    """Run Python code; returns the time, s, and the peak memory, MiB, if it prints it."""
    started = time.perf_counter()
    words = [sys.executable, '-c', program, *arguments]
    done = subprocess.run(words, cwd=ROOT, check=True, text=True, capture_output=True)
    seconds = time.perf_counter() - started
    memory = re.search(r'^VmHWM:\s+(\d+)', done.stderr, re.MULTILINE)
    return seconds, int(memory[1]) / 1024 if memory else 0.0
