"""What a run is: which drops of which part, under which conditions, made with what."""

from dataclasses import dataclass

from resting_aspects_ros import __version__
from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.drops.conditions import DropConditions
from resting_aspects_ros.drops.engine import ENGINE, ENGINE_VERSION, DropJob, make_job

MOST_DROPS = 2_000_000
MOST_SEED = 2**64 - 1
# Of a run for which none was given: the same question has the same answer.
DEFAULT_SEED = 1


@dataclass(frozen=True)
class RunDescription:
    """n drops of one part under one set of conditions and one seed; the message's fields.

    time_step in s; started in ns since the epoch.
    """

    run_id: str
    part: str
    part_sha256: str
    conditions: DropConditions
    seed: int
    first_drop: int
    drops: int
    precision: float
    engine: str
    engine_version: str
    suite_version: str
    time_step: float
    started: int

    @property
    def end(self) -> int:
        """Index after the last drop asked for."""
        return self.first_drop + self.drops

    def sequence(self) -> tuple[object, ...]:
        """What the drops follow from: where it is the same, drops of one index end alike."""
        return (
            self.part_sha256,
            self.conditions.values(),
            self.seed,
            self.engine,
            self.engine_version,
            self.time_step,
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
) -> tuple[DropJob, RunDescription]:
    """The job and the description of a run, checked; raises InvalidValueError."""
    check_drops(drops)
    check_seed(seed)
    if not 0 <= first_drop <= MOST_SEED - drops:
        raise InvalidValueError(f'first_drop is {first_drop}, allowed is 0 to {MOST_SEED - drops}')
    job = make_job(part, conditions, seed)
    return job, RunDescription(
        run_id=run_id,
        part=part.name,
        part_sha256=part.part_sha256,
        conditions=conditions,
        seed=seed,
        first_drop=first_drop,
        drops=drops,
        precision=0.0,
        engine=ENGINE,
        engine_version=ENGINE_VERSION,
        suite_version=__version__,
        time_step=job.time_step,
        started=started,
    )


def check_drops(drops: int) -> None:
    """Raises InvalidValueError if a run cannot have so many drops."""
    if not 1 <= drops <= MOST_DROPS:
        raise InvalidValueError(f'drops is {drops}, allowed is 1 to {MOST_DROPS}')


def check_seed(seed: int) -> None:
    """Raises InvalidValueError if the number is no seed."""
    if not 0 <= seed <= MOST_SEED:
        raise InvalidValueError(f'seed is {seed}, allowed is 0 to {MOST_SEED}')
