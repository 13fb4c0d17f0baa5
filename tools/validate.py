"""Validation of drops and actions: time step, decision by energy, comparison with measurements.

Prints tables and writes docs/explanation/validation.md. Takes about three hours on two cores.
`tools/validate.py world` prints only one section.
"""

import datetime as dt
import platform
import sys
from collections.abc import Callable, Iterator
from importlib.metadata import version

from dropper import ROOT, SEED, Dropper
from rich.console import Console
from validate_engine import decision, time_step
from validate_reorientation import reorientation
from validate_tosses import tosses
from validate_world import world

from resting_aspects_ros.simulation.plan import ENGINE, ENGINE_VERSION
from resting_aspects_ros.simulation.process_workers import ProcessWorkers, default_workers

RESULT = ROOT / 'docs' / 'explanation' / 'validation.md'
SECTIONS: dict[str, Callable[[Dropper], Iterator[str]]] = {
    'time_step': time_step,
    'decision': decision,
    'world': world,
    'tosses': tosses,
    'reorientation': reorientation,
}


def _heading(workers: int) -> Iterator[str]:
    today = dt.datetime.now(tz=dt.timezone.utc).date()
    yield '# Validation'
    yield ''
    yield (
        f'Written by `make validate` on {today}: {ENGINE} {ENGINE_VERSION}, NumPy '
        f'{version("numpy")}, Python {platform.python_version()}, {platform.machine()}, '
        f'{workers} workers, seed {SEED}.'
    )
    yield ''


def main() -> None:
    """Run all sections, or the sections given as arguments."""
    workers = ProcessWorkers(default_workers())
    console = Console()
    lines = list(_heading(workers.count))
    try:
        dropper = Dropper(workers)
        for name in sys.argv[1:] or SECTIONS:
            for line in SECTIONS[name](dropper):
                console.print(line, highlight=False, soft_wrap=True)
                lines.append(line)
            if not sys.argv[1:]:  # written after each section, because each takes long
                RESULT.write_text('\n'.join(lines), encoding='utf-8')
    finally:
        workers.stop()
    if not sys.argv[1:]:
        print(f'Written: {RESULT}')


if __name__ == '__main__':
    main()
