"""What a run is: which drops of which part, under which conditions, made with what."""

import re
from dataclasses import dataclass

from resting_aspects_ros.core.errors import InvalidValueError, shown
from resting_aspects_ros.simulation.conditions import DropConditions

MAX_DROPS = 2_000_000
MAX_SEED = 2**64 - 1
_LONGEST_RUN_ID = 64
# Part of the name of the run's log.
_RUN_ID = re.compile(rf'[A-Za-z0-9][A-Za-z0-9_.-]{{0,{_LONGEST_RUN_ID - 1}}}')
# Of a run for which none was given: the same question has the same answer.
DEFAULT_SEED = 1
DEFAULT_DROPS = 1000


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
            self.suite_version,
            self.time_step,
        )


def check_drops(drops: int) -> None:
    """Raises InvalidValueError if a run cannot have so many drops."""
    _check_whole('drops', drops, 1, MAX_DROPS)


def check_seed(seed: int) -> None:
    """Raises InvalidValueError if the number is no seed."""
    _check_whole('seed', seed, 0, MAX_SEED)


def check_run_id(run_id: str) -> None:
    """Raises InvalidValueError if a run cannot have this id; empty stands for a new one."""
    if run_id and not _RUN_ID.fullmatch(run_id):
        raise InvalidValueError(
            f'invalid run_id {shown(run_id)}: expected up to {_LONGEST_RUN_ID} letters, digits, '
            '"_", "-" and ".", a letter or digit first'
        )


def check_first_drop(first_drop: int, drops: int) -> None:
    """Raises InvalidValueError if so many drops cannot begin there."""
    _check_whole('first_drop', first_drop, 0, MAX_SEED - drops)


def _check_whole(name: str, value: object, low: int, high: int) -> None:
    if not isinstance(value, int) or isinstance(value, bool) or not low <= value <= high:
        raise InvalidValueError(
            f'invalid {name} {value!r}: expected an integer from {low} to {high}'
        )
