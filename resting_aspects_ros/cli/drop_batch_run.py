"""Drop the parts of a batch, and show them."""

import argparse
import sys
from pathlib import Path

from resting_aspects_ros.cli.drop_request import DropRequest
from resting_aspects_ros.cli.options import flag_of, requested_conditions, requested_number
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.format import class_rows
from resting_aspects_ros.simulation.interruption import Interruption
from resting_aspects_ros.simulation.job import DEFAULT_SEED, check_seed
from resting_aspects_ros.simulation.workers import Workers
from resting_aspects_ros.studies.batch import INDEX, BatchEntry, drop_batch
from resting_aspects_ros.studies.pages import TOP

FAILED, INTERRUPTED = 1, 130
DEFAULT_FOLDER = Path('out') / 'batch'
# Flags of `drop` that are for a single part.
SINGLE = (
    *('body', 'parts', 'from_log', 'initial_states', 'replicates', 'log', 'poses'),
    *(
        'check_convergence',
        'propagate',
        'json',
        'each',
        'noise_orientation',
        'noise_velocity',
        'noise_spin',
    ),
)


def drop_batch_and_show(
    arguments: argparse.Namespace, workers: Workers, confidence: float, stop: Interruption
) -> int:
    """Drop each part, and write its report and the index; returns the exit code.

    Raises RestingAspectsError for wrong input that concerns all parts.
    """
    for name in SINGLE:
        if getattr(arguments, name) not in (None, False):
            raise InvalidValueError(
                f'invalid {flag_of(name)}: expected only with a single part, not with a batch'
            )
    drops, precision = requested_number(arguments)
    seed = DEFAULT_SEED if arguments.seed is None else arguments.seed
    check_seed(seed)
    conditions = requested_conditions(arguments)

    def check(part: Part) -> None:
        if not arguments.force:
            DropRequest(part, conditions, seed, drops, precision).check_height()

    batch = drop_batch(
        arguments.part,
        drops or None,
        surface=conditions,
        precision=precision,
        seed=seed,
        interval=arguments.interval,
        confidence=confidence,
        unit=arguments.unit,
        check=check,
        out=arguments.out or DEFAULT_FOLDER,
        workers=workers,
        progress=True,
        stopped=lambda: stop.asked,
    )
    for entry in batch.entries:
        if entry.error:
            print(f'{entry.source}: {entry.error}', file=sys.stderr)
        else:
            print(_line(entry))
    assert batch.folder is not None
    print(f'Index: {batch.folder / INDEX}')
    if stop.asked:
        print(f'interrupted after {len(batch.entries)} parts', file=sys.stderr)
        return INTERRUPTED
    return 0 if batch.complete else FAILED


def _line(entry: BatchEntry) -> str:
    """Return the most probable classes of a part in one line."""
    assert entry.result is not None
    rows = sorted(class_rows(entry.result.distribution), key=lambda row: -row.count)[:TOP]
    shares = [f'{row.name} {100 * row.interval.probability:.1f} %' for row in rows]
    return f'{entry.case.part.name}: {", ".join(shares)}'
