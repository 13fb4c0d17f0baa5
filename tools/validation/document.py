"""A document of sections, each written by itself, with the date, the machine and the versions."""

import datetime as dt
import os
import platform
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path

from rich.console import Console

from resting_aspects_ros.simulation.conditions import BULLET, KERNEL
from resting_aspects_ros.simulation.job import engine_version
from resting_aspects_ros.simulation.workers import LocalWorkers
from resting_aspects_ros.system import available_cores
from validation.dropper import SEED, Dropper

Section = Callable[[Dropper], Iterator[str]]
# Comments that separate the sections in the file.
MARK = re.compile('^<!-- section: (\\w+) -->$', re.MULTILINE)
CPUINFO = Path('/proc/cpuinfo')


def write_sections(document: Path, heading: str, sections: Mapping[str, Section]) -> None:
    """Run all sections, or those that the command line names, and replace them in a document.

    Other sections of the document, such as finished comparisons, stay as they are.
    """
    names = sys.argv[1:] or list(sections)
    for name in names:
        if name not in sections:
            raise SystemExit(f'invalid section {name}: expected one of {", ".join(sections)}')
    workers = LocalWorkers(available_cores())
    console = Console()
    try:
        dropper = Dropper(workers)
        for name in names:
            lines = []
            for line in sections[name](dropper):
                console.print(line, highlight=False, soft_wrap=True)
                lines.append(line)
            text = '\n'.join(['', _written(), '', *lines]).rstrip() + '\n'
            found = _read(document) | {name: text}
            order = dict.fromkeys([*sections, *found])
            parts = [f'<!-- section: {key} -->{found[key]}' for key in order if key in found]
            # At once, because each section takes long.
            document.write_text('\n'.join([heading, *parts]).rstrip() + '\n', encoding='utf-8')
    finally:
        workers.stop()
    print(f'Written: {document}')


def paragraphs(*texts: str) -> Iterator[str]:
    """Yield headings and paragraphs, each with an empty line."""
    for text in texts:
        yield text
        yield ''


def table(
    headings: Sequence[str], rows: Iterable[Sequence[str]], *, numbers: bool = False
) -> Iterator[str]:
    """Yield a table in Markdown and an empty line.

    With ``numbers``, all columns but the first are aligned on the right.
    """
    yield f'| {" | ".join(headings)} |'
    yield '|---|' + ('---:|' if numbers else '---|') * (len(headings) - 1)
    for row in rows:
        yield f'| {" | ".join(row)} |'
    yield ''


def _read(document: Path) -> dict[str, str]:
    """Return the text of each section of a document, by name, in their order."""
    _, *found = MARK.split(document.read_text(encoding='utf-8')) if document.exists() else ['']
    texts = [text.rstrip() + '\n' for text in found[1::2]]
    return dict(zip(found[::2], texts, strict=True))


def _written() -> str:
    today = dt.datetime.now(tz=dt.timezone.utc).date()
    packages = ', '.join(f'{name} {version(name)}' for name in ('numpy', 'scipy', 'numba'))
    return (
        f'*{today}: kernel {engine_version(KERNEL)}, Bullet {engine_version(BULLET)}, {packages}, '
        f'Python {platform.python_version()}, {available_cores()} cores of {_processor()}, '
        f'load average {os.getloadavg()[0]:.1f}, seed {SEED}.*'
    )


def _processor() -> str:
    """Return the kernel's name of the processor."""
    lines = CPUINFO.read_text(encoding='utf-8').splitlines() if CPUINFO.exists() else []
    names = [line.partition(':')[2].strip() for line in lines if line.startswith('model name')]
    return names[0] if names else platform.machine()
