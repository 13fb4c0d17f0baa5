"""Description of a run: its part, drops, conditions, seed and engine."""

import dataclasses
import re
from dataclasses import dataclass

from resting_aspects_ros.core.errors import InvalidValueError, shown
from resting_aspects_ros.simulation.conditions import DropConditions

MAX_DROPS = 2_000_000
MAX_SEED = 2**64 - 1
_MAX_RUN_ID_LENGTH = 64
# The run id is a part of the name of the run's log.
_RUN_ID = re.compile(rf'[A-Za-z0-9][A-Za-z0-9_.-]{{0,{_MAX_RUN_ID_LENGTH - 1}}}')
# The default seed is fixed, so that identical requests have identical results.
DEFAULT_SEED = 1
DEFAULT_DROPS = 1000
# The engines: the kernel, for parts that only touch planes, also on a GPU, and Bullet.
KERNEL, CUDA, BULLET = 'kernel', 'cuda', 'bullet'
# The version of the law and its numerical parameters: poses of another version can differ.
KERNEL_VERSION = '1'


@dataclass(frozen=True)
class RunDescription:
    """Drops of one part under one set of conditions and one seed; has the message's fields.

    ``time_step`` is in s, ``started`` in ns since the epoch.
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
        """Index after the last requested drop."""
        return self.first_drop + self.drops

    def document(self) -> dict[str, object]:
        """Return the description as plain JSON types."""
        values = {each.name: getattr(self, each.name) for each in dataclasses.fields(self)}
        return {**values, 'conditions': self.conditions.document()}

    def sequence(self) -> tuple[object, ...]:
        """Return the inputs that, together with a drop's index, determine its resting pose."""
        return (
            self.part_sha256,
            self.conditions.key(),
            self.seed,
            self.engine,
            self.engine_version,
            self.suite_version,
            self.time_step,
        )


def check_drops(drops: int) -> None:
    """Raise InvalidValueError if the number of drops of a run is out of bounds."""
    _check_integer('drops', drops, 1, MAX_DROPS)


def check_seed(seed: int) -> None:
    """Raise InvalidValueError if the seed is out of bounds."""
    _check_integer('seed', seed, 0, MAX_SEED)


def check_run_id(run_id: str) -> None:
    """Raise InvalidValueError if the run id is invalid; an empty one requests a new id."""
    if run_id and not _RUN_ID.fullmatch(run_id):
        raise InvalidValueError(
            f'invalid run_id {shown(run_id)}: expected up to {_MAX_RUN_ID_LENGTH} letters, '
            'digits, "_", "-" and ".", a letter or digit first'
        )


def check_first_drop(first_drop: int, drops: int) -> None:
    """Raise InvalidValueError if the first drop is out of bounds for this number of drops."""
    _check_integer('first_drop', first_drop, 0, MAX_SEED - drops)


def _check_integer(name: str, value: object, low: int, high: int) -> None:
    if not isinstance(value, int) or isinstance(value, bool) or not low <= value <= high:
        raise InvalidValueError(
            f'invalid {name} {shown(value)}: expected an integer from {low} to {high}'
        )
