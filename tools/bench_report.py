"""What the benchmark found: shown, and written down with what it was measured on."""

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
from resting_aspects_ros.simulation.process_workers import default_workers

PACKAGES = ('pybullet', 'numpy', 'scipy', 'mujoco', 'bpy')
CPUINFO = Path('/proc/cpuinfo')


@dataclass(frozen=True)
class Table:
    """Rows of text; the first column is read as words, the others as numbers."""

    columns: list[str]
    rows: list[list[str]] = field(default_factory=list)


@dataclass(frozen=True)
class Section:
    """One thing that was measured.

    text : str
        How it was measured, in Markdown.
    found : dict
        For out/bench.json: groups of figures by name.
    """

    title: str
    text: str
    tables: list[Table]
    found: dict[str, Any]


def show(console: Console, section: Section) -> None:
    """On the terminal."""
    for table in section.tables:
        rich = RichTable(title=section.title, box=box.SIMPLE_HEAD)
        for k, column in enumerate(table.columns):
            rich.add_column(column, justify='right' if k else 'left', no_wrap=k == 0)
        for row in table.rows:
            rich.add_row(*row)
        console.print(rich)


def machine() -> dict[str, Any]:
    """What it is measured on, and how busy that was before."""
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
    """The whole of docs/explanation/bench.md."""
    return '\n'.join([*_heading(conditions), *(line for s in sections for line in _lines(s))])


def _heading(conditions: dict[str, Any]) -> Iterator[str]:
    c = conditions
    versions = ', '.join(f'{p} {c[p]}' if c[p] else f'{p} not installed' for p in PACKAGES)
    yield '# Benchmark'
    yield ''
    yield (
        f'Written by `make bench` on {c["date"]}, in one run on one machine: {c["cores"]} cores '
        f'of {c["processor"]}, Python {c["python"]}, {versions}. Load average before it began: '
        f'{c["load_before"]}; after: {c["load_after"]}, of which up to {c["cores"]} are the '
        'benchmark itself. Times are those of the clock on the wall, so whatever else ran at '
        'the time is in them.'
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
    """As the kernel names it."""
    lines = CPUINFO.read_text(encoding='utf-8').splitlines() if CPUINFO.exists() else []
    names = [line.partition(':')[2].strip() for line in lines if line.startswith('model name')]
    return names[0] if names else platform.machine()
