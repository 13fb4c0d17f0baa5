"""Make the drops that `resting_aspects drop` requests: of a part, of a log, or of a batch."""

import argparse
import dataclasses
import sys
from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

from resting_aspects_ros.api.drop import DropResult, drop, logged_drops, repeat_log
from resting_aspects_ros.api.plan import DEFAULT_REPLICATES, read_state_csv
from resting_aspects_ros.api.result import check_output, make_folder, poses_file
from resting_aspects_ros.cli.console import print_result, show_table, show_texts
from resting_aspects_ros.cli.life_cycle import (
    INTERRUPTED,
    Session,
    exit_code,
    finish,
    partial_result,
    result_folder,
    say,
)
from resting_aspects_ros.cli.options import (
    refuse,
    requested_conditions,
    requested_part,
    requested_precision,
)
from resting_aspects_ros.errors import (
    InvalidValueError,
    OutputError,
    RestingAspectsError,
    StoppedError,
)
from resting_aspects_ros.input_files import parse_quantity
from resting_aspects_ros.part.library import mesh_file
from resting_aspects_ros.simulation.conditions import (
    DEFAULT_SEED,
    QUANTITIES,
    Noise,
    quantities_of,
)

DOCUMENT, PICTURE, POSES = 'distribution.json', 'distribution.png', 'poses.csv'
BATCH_FOLDER = Path('out') / 'batch'
NOISES = tuple(f'noise_{name}' for name in quantities_of(Noise))
# Flags without an effect or a meaning: with a log, which has these values; without given states;
# with given states; and with a batch of parts.
_OF_A_LOG = (
    *('part', 'unit', 'body', 'parts', 'surface', 'surfaces', *QUANTITIES, 'height_of', 'seed'),
    *('drops', 'precision', 'surroundings', 'set', 'initial_states', 'log'),
)
_OF_STATES = ('replicates', *NOISES)
_OF_RELEASES = (
    *(name for name, quantity in QUANTITIES.items() if quantity.at_release),
    'height_of',
)
_SINGLE = (
    *('body', 'parts', 'from_log', 'initial_states', 'replicates', 'log', 'poses', *NOISES),
    *('engine', 'check_convergence', 'json', 'table', 'each'),
)


def _options(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the options that the drops of a part and of a batch have."""
    return {
        'interval': arguments.interval,
        'confidence': arguments.confidence,
        'model_range': not arguments.no_model_range,
    }


# -- One part or one log --------------------------------------------------------------------------


def drop_and_show(arguments: argparse.Namespace, session: Session) -> int:
    """Drop, count and show; returns the exit code.

    Raises RestingAspectsError before the first drop for wrong input, and after saving the partial
    result if something failed.
    """
    simulate, part = _requested(arguments)
    check_output('--poses', arguments.poses)
    out = result_folder(arguments, part, (DOCUMENT, PICTURE, POSES))
    result, failure = _result(partial(simulate, **session.options), arguments, out)
    result = dataclasses.replace(result, mesh_file=mesh_file(arguments.part))
    _show(result, arguments, out)
    unchecked = result.convergence is None and session.stop.asked
    return exit_code(
        f'{result.distribution.drops} of {result.run.drops} drops',
        complete=result.complete,
        failure=failure,
        unchecked=arguments.check_convergence and unchecked,
    )


def _requested(
    arguments: argparse.Namespace,
) -> tuple[Callable[..., DropResult], str]:
    """Return what makes the requested drops, and the name of the part."""
    options = {
        **_options(arguments),
        'check_convergence': arguments.check_convergence,
        'engine': arguments.engine,
        'keep_poses': False,
    }
    if arguments.initial_states is None:
        refuse(arguments, _OF_STATES, 'with --initial-states')
    if arguments.from_log is not None:
        refuse(arguments, _OF_A_LOG, 'without --from-log, which defines it', 'PART_OR_MESH')
        logged = logged_drops(arguments.from_log)
        return partial(repeat_log, logged, **options), logged[0].name
    if arguments.part is None:
        raise InvalidValueError(
            'missing part: expected a name, a mesh file, or --from-log (see --help)'
        )
    if arguments.initial_states is not None:
        refuse(arguments, _OF_RELEASES, 'without --initial-states, which replace the releases')
        options |= {
            'initial_states': read_state_csv(arguments.initial_states),
            'replicates': DEFAULT_REPLICATES
            if arguments.replicates is None
            else arguments.replicates,
            'noise': _noise(arguments),
        }
    part = requested_part(arguments)
    if arguments.log is not None:
        make_folder('--log', arguments.log)
    simulate = partial(
        drop,
        part,
        arguments.drops,
        precision=requested_precision(arguments),
        surface=requested_conditions(arguments),
        seed=DEFAULT_SEED if arguments.seed is None else arguments.seed,
        log=arguments.log,
        **options,
    )
    return simulate, part.name


def _noise(arguments: argparse.Namespace) -> Noise:
    """Return the noise that the flags request; raises InvalidValueError."""
    return Noise(
        **{
            name: parse_quantity(f'--noise-{name}', text, quantity.unit)
            for name, quantity in quantities_of(Noise).items()
            if (text := getattr(arguments, f'noise_{name}')) is not None
        }
    )


def _result(
    simulate: Callable[..., DropResult], arguments: argparse.Namespace, out: Path | None
) -> tuple[DropResult, RestingAspectsError | None]:
    """Simulate, and write files of the poses meanwhile; returns the result, and an error."""
    files: list[tuple[str, Path]] = []
    if out is not None:
        files.append(('--report' if arguments.out is None else '--out', out / POSES))
    poses: Path | None = arguments.poses
    if poses is not None and poses.resolve() not in [path.resolve() for _, path in files]:
        files.append(('--poses', poses))
    result: DropResult | None = None
    failure: RestingAspectsError | None = None
    try:
        with ExitStack() as stack:
            writers = [stack.enter_context(poses_file(*each)) for each in files]
            try:
                result, failure = partial_result(partial(simulate, consumers=writers))
                if not (result and result.distribution.drops):  # earlier files are kept
                    raise failure or StoppedError('interrupted before the first drop')
            except OutputError as error:
                result = error.result
                raise
    except OutputError as error:
        if result is None:
            raise
        failure = error
    assert result is not None
    return result, failure


def _show(result: DropResult, arguments: argparse.Namespace, out: Path | None) -> None:
    def show() -> None:
        print_result(result, each=arguments.each)
        if result.log is not None:
            print(f'Log: {result.log}')

    files = {} if arguments.report else {PICTURE: result.save_picture}
    written = [] if out is None else [out / POSES]
    finish(arguments, out, (DOCUMENT, result.to_json), files, show, result.report, written)
    if out is None:
        say(arguments, 'Add --report for pictures of the aspects.')


# -- A batch of parts -----------------------------------------------------------------------------


def drop_batch_and_show(arguments: argparse.Namespace, session: Session) -> int:
    """Drop each part, and write its report and the index; returns the exit code.

    Raises RestingAspectsError for wrong input that concerns all parts.
    """
    # These imports are slow, and only needed for a batch.
    from resting_aspects_ros.studies.batch import INDEX, drop_batch
    from resting_aspects_ros.studies.pages import batch_range_texts, batch_table

    refuse(arguments, _SINGLE, 'with a single part, not with a batch')
    batch = drop_batch(
        arguments.part,
        arguments.drops,
        precision=requested_precision(arguments),
        surface=requested_conditions(arguments),
        seed=DEFAULT_SEED if arguments.seed is None else arguments.seed,
        unit=arguments.unit,
        out=arguments.out or BATCH_FOLDER,
        **_options(arguments),
        **session.options,
    )
    for entry in batch.entries:
        if entry.error:
            print(f'{entry.source}: {entry.error}', file=sys.stderr)
    show_table(batch_table(batch))
    show_texts(*batch_range_texts(batch))
    assert batch.folder is not None
    print(f'Index: {batch.folder / INDEX}')
    if session.stop.asked:
        print(f'interrupted after {len(batch.entries)} parts', file=sys.stderr)
        return INTERRUPTED
    return 0 if batch.complete else 1
