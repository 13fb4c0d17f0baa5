"""Validation of drops and actions: convergence, two engines, comparison with measurements.

Prints tables and writes docs/explanation/validation.md. Takes about four hours on two cores.
`PYTHONPATH=tools .venv/bin/python -m validation thrown` runs and replaces only one section.
"""

from validation.calibration import calibration
from validation.convergence import convergence, convergence_elsewhere, decision
from validation.document import Section, write_sections
from validation.dropper import ROOT
from validation.engines import engines
from validation.feeder import feeder
from validation.mujoco import mujoco
from validation.thrown import thrown
from validation.tosses import tosses
from validation.track import track

SECTIONS: dict[str, Section] = {
    'mujoco': mujoco,
    'tosses': tosses,
    'thrown': thrown,
    'convergence': convergence,
    'convergence_elsewhere': convergence_elsewhere,
    'engines': engines,
    'decision': decision,
    'feeder': lambda _: feeder(20, 3),
    'calibration': calibration,
    'track': lambda _: track(),
}
HEADING = """# Validation

Written by `make validate`, section by section; each states when and with what. A section is
replaced, for example, by `PYTHONPATH=tools .venv/bin/python -m validation tosses`.

Sections under *Finished comparisons*, at the end, were made once and stay as they are. Their
programs were removed on 2026-11-27 and are in the history of the repository.
"""

if __name__ == '__main__':
    write_sections(ROOT / 'docs' / 'explanation' / 'validation.md', HEADING, SECTIONS)
