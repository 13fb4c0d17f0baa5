"""The drops that the sections of the benchmark time."""

from validation.dropper import SEED

import resting_aspects_ros as ra
from resting_aspects_ros.api.conditions import shipped_surfaces
from resting_aspects_ros.simulation.conditions import KERNEL
from resting_aspects_ros.simulation.job import DropJob, make_job

EXAMPLE = 'l_bracket'


def job_of(name: str = EXAMPLE, surface: str = 'rubber_mat', engine: str = KERNEL) -> DropJob:
    """Return the job of an example part on a surface."""
    return make_job(ra.load_part(name), shipped_surfaces().get(surface), SEED, engine=engine)
