"""The drops that the sections of the benchmark time."""

from validation.dropper import ROOT, SEED

from resting_aspects_ros.api.conditions import shipped_surfaces
from resting_aspects_ros.part.library import PartLibrary
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.simulation.conditions import KERNEL
from resting_aspects_ros.simulation.job import DropJob, make_job

EXAMPLE = 'l_bracket'


def example_part(name: str = EXAMPLE) -> Part:
    """Return an example part."""
    return PartLibrary(ROOT / 'config' / 'parts').load(name)


def job_of(part: Part, surface: str = 'rubber_mat', engine: str = KERNEL) -> DropJob:
    """Return the job of a part on a surface."""
    return make_job(part, shipped_surfaces().get(surface), SEED, engine=engine)
