"""The requested drops: described by flags, or by a log that is to be repeated."""

import argparse
import dataclasses
from dataclasses import dataclass
from pathlib import Path

from resting_aspects_ros.api.given_states import DEFAULT_REPLICATES, given_starts, read_state_csv
from resting_aspects_ros.api.load_part import load_part
from resting_aspects_ros.cli.options import (
    requested_conditions,
    requested_number,
)
from resting_aspects_ros.cli.values import parse_quantity
from resting_aspects_ros.errors import InvalidValueError, LogError, warn
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.simulation.conditions import QUANTITIES, DropConditions, quantities_of
from resting_aspects_ros.simulation.job import DEFAULT_SEED, RunDescription, check_seed
from resting_aspects_ros.simulation.starts import GivenStates, Noise, Starts

# In hull radii. A greater height is probably a mistake of the unit, and the drops take minutes.
MAX_HEIGHT = 500
# Flags that a log replaces.
_LOGGED_FLAGS = ('unit', 'body', 'parts', 'surface', 'surfaces', *QUANTITIES, 'height_of', 'seed')


@dataclass(frozen=True)
class DropRequest:
    """Drops that were requested; ``drops`` and ``precision`` have the meaning of max_drops.

    logged : RunDescription
        The run to repeat; None for a new run.
    repeats : bool
        Whether as many drops as in the log are repeated. Then ``drops`` ends the run, and
        ``precision`` is only that of the logged run.
    given, starts : GivenStates, Starts
        Given initial states, and how the parts start from them; None for random releases.
    """

    part: Part
    conditions: DropConditions
    seed: int
    drops: int
    precision: float
    logged: RunDescription | None = None
    repeats: bool = False
    given: GivenStates | None = None
    starts: Starts | None = None

    @property
    def stop_at(self) -> float:
        """Return the precision at which to stop, 0 to make all drops."""
        return 0.0 if self.repeats else self.precision

    @property
    def first_drop(self) -> int:
        """Return the index of the first drop."""
        return 0 if self.logged is None else self.logged.first_drop

    def check_height(self) -> None:
        """Raise InvalidValueError if the height is probably in a wrong unit."""
        height, max_height = self.conditions.height, MAX_HEIGHT * self.part.hull_radius
        if self.logged is None and self.starts is None and height > max_height:
            raise InvalidValueError(
                f'invalid --height {height:g} m: expected at most {MAX_HEIGHT} times the radius '
                f'of {self.part.name}, {max_height:.3g} m, or --force; millimetres are written '
                f'{height:g}mm'
            )

    def check_engine(self, run: RunDescription) -> None:
        """Warn if the engine, a version or the time step differs from that of the log."""
        if self.logged is None or run.sequence() == self.logged.sequence():
            return
        before, now = (
            f'{each.engine} {each.engine_version}, resting_aspects_ros {each.suite_version}, '
            f'time step {each.time_step:.6g} s'
            for each in (self.logged, run)
        )
        warn(
            f'the log was recorded with {before}, and this is {now}: the poses can differ, the '
            'probabilities should not'
        )


def requested_drops(arguments: argparse.Namespace) -> DropRequest:
    """Return the drops that the flags request; raises RestingAspectsError for wrong input."""
    drops, precision = requested_number(arguments)
    if arguments.initial_states is None:
        _check_no_states(arguments)
    if arguments.from_log is not None:
        return _logged(arguments, drops, precision)
    if arguments.part is None:
        raise InvalidValueError(
            'missing part: expected a name, a mesh file, or --from-log (see --help)'
        )
    seed = DEFAULT_SEED if arguments.seed is None else arguments.seed
    check_seed(seed)
    conditions = requested_conditions(arguments)
    part = load_part(arguments.part, arguments.unit, arguments.parts, arguments.body)
    if arguments.initial_states is None:
        return DropRequest(part, conditions, seed, drops, precision)
    given = read_state_csv(arguments.initial_states)
    for flag in ('drops', 'precision', 'log'):
        if getattr(arguments, flag) is not None:
            raise InvalidValueError(
                f'invalid --{flag} {getattr(arguments, flag)}: expected only without '
                '--initial-states; --replicates is the number of drops from each state'
            )
    count = DEFAULT_REPLICATES if arguments.replicates is None else arguments.replicates
    starts, drops = given_starts(part, given, _noise(arguments), conditions, count)
    return DropRequest(part, conditions, seed, drops, 0.0, given=given, starts=starts)


def _noise(arguments: argparse.Namespace) -> Noise:
    """Return the noise that the flags request; raises InvalidValueError."""
    return Noise(
        **{
            name: parse_quantity(f'--noise-{name}', text, quantity.unit)
            for name, quantity in quantities_of(Noise).items()
            if (text := getattr(arguments, f'noise_{name}')) is not None
        }
    )


def _check_no_states(arguments: argparse.Namespace) -> None:
    """Raise InvalidValueError if a flag is given that needs --initial-states."""
    for name in ('replicates', *(f'noise_{each}' for each in quantities_of(Noise))):
        if getattr(arguments, name) is not None:
            raise InvalidValueError(
                f'invalid --{name.replace("_", "-")} {getattr(arguments, name)}: expected only '
                'with --initial-states'
            )


def _logged(arguments: argparse.Namespace, drops: int, precision: float) -> DropRequest:
    log: Path = arguments.from_log
    if arguments.initial_states is not None:
        raise InvalidValueError(
            f'invalid --initial-states {str(arguments.initial_states)!r}: expected only without '
            '--from-log'
        )
    if arguments.log is not None:
        raise InvalidValueError(
            f'invalid --log {str(arguments.log)!r}: expected only without --from-log, whose '
            'drops are in a log already'
        )
    for name in ('part', *_LOGGED_FLAGS):
        given = getattr(arguments, name)
        if given not in (None, ''):
            flag = f'--{name.replace("_", "-")}' if name in _LOGGED_FLAGS else 'PART_OR_MESH'
            raise InvalidValueError(
                f'invalid {flag} {str(given)!r}: expected only without --from-log, which '
                'defines it'
            )
    # This imports ROS, which is not needed without a log.
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
    run = logged.known_run
    assert run is not None
    if arguments.drops is not None or arguments.precision is not None:
        return DropRequest(part, run.conditions, run.seed, drops, precision, run)
    # Repeat the recorded drops: a canceled or interrupted run has fewer than requested.
    first, end = logged.extent
    if first == end:
        raise InvalidValueError(f'invalid --from-log {str(log)!r}: expected a log with drops')
    run = dataclasses.replace(run, first_drop=first)
    return DropRequest(part, run.conditions, run.seed, end - first, run.precision, run, True)
