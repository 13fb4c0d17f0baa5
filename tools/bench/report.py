"""Report of the benchmark: tables on the terminal, and the document with the machine's data."""

import datetime as dt
import os
import platform
from collections.abc import Iterator
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from rich import box
from rich.console import Console
from rich.table import Table as RichTable

from resting_aspects_ros import __version__
from resting_aspects_ros.simulation.workers import default_workers

PACKAGES = ('numba', 'pybullet', 'numpy', 'scipy')
CPUINFO = Path('/proc/cpuinfo')


@dataclass(frozen=True)
class Table:
    """Rows of text; the first column has labels, the others have numbers."""

    columns: list[str]
    rows: list[list[str]] = field(default_factory=list)


@dataclass(frozen=True)
class Section:
    """One section of the benchmark.

    text : str
        Description of the measurement, in Markdown.
    found : dict
        Groups of figures by name, for out/bench.json.
    """

    title: str
    text: str
    tables: list[Table]
    found: dict[str, Any]


def show(console: Console, section: Section) -> None:
    """Print a section on the terminal."""
    for table in section.tables:
        rich = RichTable(title=section.title, box=box.SIMPLE_HEAD)
        for k, column in enumerate(table.columns):
            rich.add_column(column, justify='right' if k else 'left', no_wrap=k == 0)
        for row in table.rows:
            rich.add_row(*row)
        console.print(rich)


def machine() -> dict[str, Any]:
    """Return the machine, the versions, and the load before the benchmark."""
    return {
        'date': dt.datetime.now(tz=dt.timezone.utc).date().isoformat(),
        'processor': _processor(),
        'cores': default_workers(),
        'load_before': round(os.getloadavg()[0], 2),
        'suite': __version__,
        'python': platform.python_version(),
        **{package: _version(package) for package in PACKAGES},
    }


def markdown(conditions: dict[str, Any], sections: list[Section]) -> str:
    """Return the content of docs/explanation/bench.md."""
    return '\n'.join([*_heading(conditions), *(line for s in sections for line in _lines(s))])


def _heading(conditions: dict[str, Any]) -> Iterator[str]:
    c = conditions
    versions = ', '.join(f'{p} {c[p]}' if c[p] else f'{p} not installed' for p in PACKAGES)
    yield '# Benchmark'
    yield ''
    yield (
        f'Written by `make bench` on {c["date"]}, in one run on one machine: {c["cores"]} cores '
        f'of {c["processor"]}, Python {c["python"]}, {versions}. The load average was '
        f'{c["load_before"]} before the benchmark and {c["load_after"]} after it, of which up to '
        f'{c["cores"]} are caused by the benchmark itself. All times are wall-clock times, so '
        'they include the effect of other processes.'
    )
    yield ''


def _lines(section: Section) -> Iterator[str]:
    yield f'## {section.title}'
    yield ''
    yield section.text
    yield ''
    for table in section.tables:
        yield _row(table.columns)
        yield '|---|' + '---:|' * (len(table.columns) - 1)
        yield from map(_row, table.rows)
        yield ''


def _row(cells: list[str]) -> str:
    return f'| {" | ".join(cells)} |'


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _processor() -> str:
    """Return the kernel's name of the processor."""
    lines = CPUINFO.read_text(encoding='utf-8').splitlines() if CPUINFO.exists() else []
    names = [line.partition(':')[2].strip() for line in lines if line.startswith('model name')]
    return names[0] if names else platform.machine()
