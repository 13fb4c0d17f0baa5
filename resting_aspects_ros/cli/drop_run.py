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
from resting_aspects_ros.api.plan import read_state_csv
from resting_aspects_ros.api.result import make_folder, poses_file
from resting_aspects_ros.cli import life_cycle
from resting_aspects_ros.cli.console import print_result, show_table, show_texts
from resting_aspects_ros.cli.options import refuse, requested_conditions, requested_part
from resting_aspects_ros.errors import (
    InvalidValueError,
    OutputError,
    RestingAspectsError,
    StoppedError,
)
from resting_aspects_ros.part.library import mesh_file
from resting_aspects_ros.simulation.conditions import (
    DEFAULT_SEED,
    QUANTITIES,
    Noise,
    quantities_of,
)

DOCUMENT, PICTURE, POSES = 'distribution.json', 'distribution.png', 'poses.csv'
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
    """Return the options that the drops of a part, of a log and of a batch have."""
    return {
        'interval': arguments.interval,
        'confidence': arguments.confidence,
        'model_range': not arguments.no_model_range,
    }


def _releases(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the options that the drops of a part and of a batch have."""
    return {
        'surface': requested_conditions(arguments),
        'seed': DEFAULT_SEED if arguments.seed is None else arguments.seed,
        'precision': arguments.precision or 0.0,
        **_options(arguments),
    }


# -- One part or one log --------------------------------------------------------------------------


def drop_and_show(arguments: argparse.Namespace, session: dict[str, Any]) -> int:
    """Drop, count and show; returns the exit code.

    Raises RestingAspectsError before the first drop for wrong input, and after saving the partial
    result if something failed.
    """
    simulate, part = _requested(arguments)
    out = life_cycle.result_folder(arguments, part, (DOCUMENT, PICTURE, POSES))
    simulate = partial(
        simulate,
        check_convergence=arguments.check_convergence,
        engine=arguments.engine,
        keep_poses=False,
        **session,
    )
    result, failure = _result(simulate, arguments, out)
    result = dataclasses.replace(result, mesh_file=mesh_file(arguments.part))
    _show(result, arguments, out)
    has = f'{result.distribution.drops} of {result.run.drops} drops'
    return life_cycle.exit_code(has, session, failure)


def _requested(arguments: argparse.Namespace) -> tuple[Callable[..., DropResult], str]:
    """Return what makes the requested drops, and the name of the part."""
    if arguments.initial_states is None:
        refuse(arguments, _OF_STATES, 'with --initial-states')
    if arguments.from_log is not None:
        refuse(arguments, _OF_A_LOG, 'without --from-log, which defines it', 'PART_OR_MESH')
        logged = logged_drops(arguments.from_log)
        return partial(repeat_log, logged, **_options(arguments)), logged[0].name
    if arguments.part is None:
        raise InvalidValueError(
            'missing part: expected a name, a mesh file, or --from-log (see --help)'
        )
    states: dict[str, Any] = {}
    if arguments.initial_states is not None:
        refuse(arguments, _OF_RELEASES, 'without --initial-states, which replace the releases')
        noise = {name: getattr(arguments, f'noise_{name}') or 0.0 for name in quantities_of(Noise)}
        states = {
            'initial_states': read_state_csv(arguments.initial_states),
            'replicates': 1 if arguments.replicates is None else arguments.replicates,
            'noise': Noise(**noise),
        }
    part = requested_part(arguments)
    if arguments.log is not None:
        make_folder('--log', arguments.log)
    options = {**_releases(arguments), **states, 'log': arguments.log}
    return partial(drop, part, arguments.drops, **options), part.name


def _result(
    simulate: Callable[..., DropResult], arguments: argparse.Namespace, out: Path | None
) -> tuple[DropResult, RestingAspectsError | None]:
    """Simulate, and write files of the poses meanwhile; returns the result, and an error."""
    files: list[tuple[str, Path]] = []
    if out is not None:
        files.append(('--report' if arguments.out is None else '--out', out / POSES))
    if arguments.poses is not None:
        files.append(('--poses', arguments.poses))
    result: DropResult | None = None
    failure: RestingAspectsError | None = None
    try:
        with ExitStack() as stack:
            writers = [stack.enter_context(poses_file(*each)) for each in files]
            try:
                result, failure = life_cycle.partial_result(partial(simulate, consumers=writers))
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
    document = DOCUMENT, result.to_json
    life_cycle.finish(arguments, out, document, files, show, result.report, written)
    if out is None:
        life_cycle.say(arguments, 'Add --report for pictures of the aspects.')


# -- A batch of parts -----------------------------------------------------------------------------


def drop_batch_and_show(arguments: argparse.Namespace, session: dict[str, Any]) -> int:
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
        unit=arguments.unit,
        out=arguments.out or Path('out') / 'batch',
        **_releases(arguments),
        **session,
    )
    for entry in batch.entries:
        if entry.error:
            print(f'{entry.source}: {entry.error}', file=sys.stderr)
    show_table(batch_table(batch))
    show_texts(*batch_range_texts(batch))
    assert batch.folder is not None
    print(f'Index: {batch.folder / INDEX}')
    if session['stopped']():
        print(f'interrupted after {len(batch.entries)} parts', file=sys.stderr)
        return life_cycle.INTERRUPTED
    return 0 if batch.complete else 1
