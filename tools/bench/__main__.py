"""Benchmark of everything that must be fast, in one run.

Prints tables, and writes out/bench.json and docs/explanation/bench.md.
"""

import json
import os

from rich.console import Console
from validation.dropper import ROOT

from bench.actions import actions
from bench.command import command
from bench.geometry import geometry
from bench.hulls import hulls
from bench.latency import latency
from bench.memory import memory
from bench.rates import rates
from bench.report import machine, markdown, show
from bench.surroundings import surroundings
from bench.vision import vision
from resting_aspects_ros.simulation.workers import default_workers

FIGURES = ROOT / 'out' / 'bench.json'
DOCUMENT = ROOT / 'docs' / 'explanation' / 'bench.md'
# Of the tables in a file or a pipe: none is wider.
WIDTH = 200


def main() -> None:
    """Run all sections, print them, and write the results."""
    console = Console()
    if not console.is_terminal:
        console.width = WIDTH
    conditions = machine()
    sections = []
    for measure in (
        lambda: rates(default_workers()),
        actions,
        surroundings,
        command,
        hulls,
        geometry,
        vision,
        latency,
        memory,
    ):
        section = measure()
        show(console, section)
        sections.append(section)
    conditions['load_after'] = round(os.getloadavg()[0], 2)
    figures = {'machine': conditions}
    for section in sections:
        figures |= section.found
    FIGURES.parent.mkdir(parents=True, exist_ok=True)
    FIGURES.write_text(json.dumps(figures, indent=2) + '\n', encoding='utf-8')
    DOCUMENT.write_text(markdown(conditions, sections), encoding='utf-8')
    print(f'Written: {FIGURES.relative_to(ROOT)}, {DOCUMENT.relative_to(ROOT)}')


if __name__ == '__main__':
    main()
