"""From a question to a run: the job for the workers, and the description for everybody else."""

from resting_aspects_ros import __version__
from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.stopping import check_precision
from resting_aspects_ros.drops.conditions import DropConditions
from resting_aspects_ros.drops.engine import ENGINE, ENGINE_VERSION
from resting_aspects_ros.drops.job import DropJob, make_job
from resting_aspects_ros.drops.run import (
    RunDescription,
    check_drops,
    check_first_drop,
    check_seed,
)


def plan_run(
    part: Part,
    conditions: DropConditions,
    *,
    seed: int,
    drops: int,
    run_id: str,
    started: int,
    first_drop: int = 0,
    precision: float = 0.0,
) -> tuple[DropJob, RunDescription]:
    """The job and the description of a run, checked; raises InvalidValueError.

    Parameters
    ----------
    precision : float
        Half width of the intervals at which the run stops; 0: it makes all its drops.
    """
    check_drops(drops)
    if precision != 0:
        check_precision(precision)
        if first_drop != 0:
            raise InvalidValueError(
                f'first_drop is {first_drop}, allowed is 0 for a run that stops at a precision'
            )
    check_seed(seed)
    check_first_drop(first_drop, drops)
    job = make_job(part, conditions, seed)
    return job, RunDescription(
        run_id=run_id,
        part=part.name,
        part_sha256=part.part_sha256,
        conditions=conditions,
        seed=seed,
        first_drop=first_drop,
        drops=drops,
        precision=precision,
        engine=ENGINE,
        engine_version=ENGINE_VERSION,
        suite_version=__version__,
        time_step=job.time_step,
        started=started,
    )
