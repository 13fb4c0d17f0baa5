"""Benchmark of everything that must be fast; writes docs/explanation/bench.md.

`PYTHONPATH=tools .venv/bin/python -m bench latency` runs and replaces only one section.
"""

from validation.document import Section, write_sections
from validation.dropper import ROOT

from bench.command import command
from bench.drops import drops
from bench.geometry import geometry
from bench.latency import latency
from bench.logs import logs
from bench.studio import studio

SECTIONS: dict[str, Section] = {
    'drops': drops,
    'command': lambda _: command(),
    'geometry': lambda _: geometry(),
    'latency': lambda _: latency(),
    'logs': lambda _: logs(),
    'studio': lambda _: studio(),
}
HEADING = """# Benchmark

Written by `make bench`, section by section; each states when and on which machine. A section is
replaced, for example, by `PYTHONPATH=tools .venv/bin/python -m bench latency`. Times are
wall-clock times, unless a section says otherwise, and include the effect of other processes.
The machine is a virtual one whose speed varies by a factor of two from hour to hour, so only the
numbers of a section can be compared with each other.

The sections `gpu`, `estimators`, `identification`, `hulls`, `actions`, `surroundings` are finished
comparisons. They were made once and stay as they are; the programs of all but the first were
removed on 2026-11-27 and are in the history of the repository.
"""

if __name__ == '__main__':
    write_sections(ROOT / 'docs' / 'explanation' / 'bench.md', HEADING, SECTIONS)
