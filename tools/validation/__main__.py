"""Validation of drops and actions: convergence, two engines, comparison with measurements.

Prints tables and writes docs/explanation/validation.md. Takes about four hours on two cores.
`PYTHONPATH=tools .venv/bin/python -m validation world` runs and replaces only one section.
"""

import datetime as dt
import platform
import re
import sys
from collections.abc import Callable, Iterator
from importlib.metadata import version

from rich.console import Console

from resting_aspects_ros.simulation.job import BULLET, KERNEL, engine_version
from resting_aspects_ros.simulation.workers import LocalWorkers, default_workers
from validation.calibration import calibration
from validation.dropper import ROOT, SEED, Dropper
from validation.engine import convergence, decision
from validation.engines import engines
from validation.feeder import feeder
from validation.identification import identification
from validation.reorientation import reorientation
from validation.surroundings import surroundings
from validation.surroundings_steps import surroundings_steps
from validation.tosses import tosses
from validation.track import track
from validation.world import world

RESULT = ROOT / 'docs' / 'explanation' / 'validation.md'
SECTIONS: dict[str, Callable[[Dropper], Iterator[str]]] = {
    'convergence': convergence,
    'engines': engines,
    'decision': decision,
    'world': world,
    'tosses': tosses,
    'reorientation': reorientation,
    'surroundings': surroundings,
    'surroundings_steps': surroundings_steps,
    'identification': lambda _: identification(),
    'feeder': lambda _: feeder(20, 3, over_ros=True),
    'calibration': calibration,
    'track': track,
}


HEADING = """# Validation

Written by `make validate`, section by section; each states when and with what. A section is
replaced, for example, by `PYTHONPATH=tools .venv/bin/python -m validation tosses`.
"""
# Comments that separate the sections in the file.
MARK = re.compile('^<!-- section: (\\w+) -->$', re.MULTILINE)


def _written(workers: int) -> str:
    today = dt.datetime.now(tz=dt.timezone.utc).date()
    versions = f'kernel {engine_version(KERNEL)}, Bullet {engine_version(BULLET)}'
    return (
        f'*{today}: {versions}, NumPy {version("numpy")}, Python {platform.python_version()}, '
        f'{platform.machine()}, {workers} workers, seed {SEED}.*'
    )


def _sections() -> dict[str, str]:
    """Return the text of each section of the file, by name."""
    _, *found = MARK.split(RESULT.read_text(encoding='utf-8')) if RESULT.exists() else ['']
    texts = [text.rstrip() + '\n' for text in found[1::2]]
    return dict(zip(found[::2], texts, strict=True))


def _write(sections: dict[str, str]) -> None:
    parts = [f'<!-- section: {k} -->{sections[k]}' for k in SECTIONS if k in sections]
    RESULT.write_text('\n'.join([HEADING, *parts]).rstrip() + '\n', encoding='utf-8')


def main() -> None:
    """Run all sections, or the sections given as arguments."""
    workers = LocalWorkers(default_workers())
    console = Console()
    try:
        dropper = Dropper(workers)
        for name in sys.argv[1:] or SECTIONS:
            lines = []
            for line in SECTIONS[name](dropper):
                console.print(line, highlight=False, soft_wrap=True)
                lines.append(line)
            text = '\n'.join(['', _written(workers.count), '', *lines]).rstrip() + '\n'
            _write(_sections() | {name: text})  # at once, because each section takes long
    finally:
        workers.stop()
    print(f'Written: {RESULT}')


if __name__ == '__main__':
    main()
