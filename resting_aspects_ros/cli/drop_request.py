"""Which drops a person asks for: by flags, or as a log has them."""

import argparse
from dataclasses import dataclass
from pathlib import Path

from resting_aspects_ros.api.condition_text import shipped_surfaces
from resting_aspects_ros.api.load_part import load_part
from resting_aspects_ros.cli.options import conditions_of, drops_of
from resting_aspects_ros.core.errors import InvalidValueError, LogError, warn
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.simulation.conditions import QUANTITIES, DropConditions
from resting_aspects_ros.simulation.run_description import DEFAULT_SEED, RunDescription, check_seed

# A fall from higher than this, hull radii, was probably meant in another unit, and takes minutes.
MAX_HEIGHT = 500
# What a log says, so that nobody else may.
_OF_LOG = ('unit', 'body', 'parts', 'surface', *QUANTITIES, 'height_of', 'seed')


@dataclass(frozen=True)
class DropRequest:
    """Drops that are asked for; ``drops`` and ``precision`` as max_drops has them.

    logged : RunDescription
        The run that is made again, if it is one.
    ranges : tuple of (int, int)
        If just the drops are made again that a log has, those: [first, end) of each row of them.
        Then ``precision`` is that at which the run was to stop, and what ends it is ``drops``.
    """

    part: Part
    conditions: DropConditions
    seed: int
    drops: int
    precision: float
    logged: RunDescription | None = None
    ranges: tuple[tuple[int, int], ...] = ()

    @property
    def stop_at(self) -> float:
        """The precision at which to stop; 0: when all drops are made."""
        return 0.0 if self.ranges else self.precision

    @property
    def first_drop(self) -> int:
        """Index of the first of them."""
        return 0 if self.logged is None else self.logged.first_drop

    def check_height(self) -> None:
        """Raise InvalidValueError for a height that is probably a mistake of the unit."""
        height, highest = self.conditions.height, MAX_HEIGHT * self.part.hull_radius
        if self.logged is None and height > highest:
            raise InvalidValueError(
                f'invalid --height {height:g} m: expected at most {MAX_HEIGHT} times the radius '
                f'of {self.part.name}, {highest:.3g} m, or --force; millimetres are written '
                f'{height:g}mm'
            )

    def check_engine(self, run: RunDescription) -> None:
        """Warn if what the drops follow from is not what it was when they were logged."""
        if self.logged is None or run.sequence() == self.logged.sequence():
            return
        before, now = (
            f'{each.engine} {each.engine_version}, resting_aspects_ros {each.suite_version}, '
            f'time step {each.time_step:.6g} s'
            for each in (self.logged, run)
        )
        warn(
            f'the log was made with {before}, and this is {now}: the poses can differ, the '
            'probabilities should not'
        )


def requested_drops(arguments: argparse.Namespace) -> DropRequest:
    """What the flags ask for; raises RestingAspectsError for wrong input."""
    drops, precision = drops_of(arguments)
    if arguments.from_log is not None:
        return _logged(arguments, drops, precision)
    if arguments.part is None:
        raise InvalidValueError(
            'missing part: expected a name, a mesh file, or --from-log (see --help)'
        )
    seed = DEFAULT_SEED if arguments.seed is None else arguments.seed
    check_seed(seed)
    conditions = conditions_of(arguments, shipped_surfaces())
    part = load_part(arguments.part, arguments.unit, arguments.parts, arguments.body)
    return DropRequest(part, conditions, seed, drops, precision)


def _logged(arguments: argparse.Namespace, drops: int, precision: float) -> DropRequest:
    log: Path = arguments.from_log
    if arguments.log is not None:
        raise InvalidValueError(
            f'invalid --log {str(arguments.log)!r}: expected only without --from-log, whose drops '
            'have a log'
        )
    for name in ('part', *_OF_LOG):
        given = getattr(arguments, name)
        if given not in (None, ''):
            flag = f'--{name.replace("_", "-")}' if name in _OF_LOG else 'PART_OR_MESH'
            raise InvalidValueError(
                f'invalid {flag} {str(given)!r}: expected only without --from-log, which '
                'defines it'
            )
    # It imports ROS, which other drops do not need.
    from resting_aspects_ros.run_logs.contents import read_logged_run

    try:
        logged = read_logged_run(log)
    except LogError as error:
        raise InvalidValueError(f'--from-log: {error}') from None
    part, run = logged.part, logged.run
    if run is None:
        raise InvalidValueError(f'invalid --from-log {str(log)!r}: expected a log with drops')
    if part is None or part.part_sha256 != run.part_sha256:
        raise InvalidValueError(
            f'invalid --from-log {str(log)!r}: expected a log with the description of its part'
        )
    logged.warn_if_unfinished()
    if arguments.drops is not None or arguments.precision is not None:
        return DropRequest(part, run.conditions, run.seed, drops, precision, run)
    # Those that are there, wherever the run ended: it can have been canceled, or broken off.
    ranges = tuple(logged.ranges)
    drops = sum(end - first for first, end in ranges)
    if not drops:
        raise InvalidValueError(f'invalid --from-log {str(log)!r}: expected a log with drops')
    return DropRequest(part, run.conditions, run.seed, drops, run.precision, run, ranges)
