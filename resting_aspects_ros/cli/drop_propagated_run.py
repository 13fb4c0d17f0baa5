"""Drop a part on a calibrated surface with its uncertainty, and show both intervals."""

import argparse
import sys
from pathlib import Path

from resting_aspects_ros.api.load_part import load_part
from resting_aspects_ros.api.progress import DropProgress
from resting_aspects_ros.cli.drop_request import DropRequest
from resting_aspects_ros.cli.options import changed_conditions, flag_of, requested_conditions
from resting_aspects_ros.cli.result_folder import make_result_folder
from resting_aspects_ros.errors import EngineError, InvalidValueError, analysis, warn
from resting_aspects_ros.simulation.conditions import all_surfaces
from resting_aspects_ros.simulation.interruption import Interruption
from resting_aspects_ros.simulation.job import DEFAULT_SEED, check_drops, check_seed
from resting_aspects_ros.simulation.workers import Workers
from resting_aspects_ros.studies.propagate import (
    DROPS,
    PAGE,
    SAMPLES,
    UncertainSurface,
    named_surface,
    propagate,
    uncertain_surface,
)

INTERRUPTED = 130
DOCUMENT = 'propagated.json'
# Flags of `drop` that have no meaning for several conditions, or are not offered for them.
REFUSED = (
    *('from_log', 'initial_states', 'replicates', 'log', 'poses', 'each'),
    *('check_convergence', 'precision', 'noise_orientation', 'noise_velocity', 'noise_spin'),
)


def drop_propagated_and_show(
    arguments: argparse.Namespace, workers: Workers, confidence: float, stop: Interruption
) -> int:
    """Drop and show; returns the exit code. Raises RestingAspectsError for wrong input."""
    _check_flags(arguments)
    drops = DROPS if arguments.drops is None else arguments.drops
    seed = DEFAULT_SEED if arguments.seed is None else arguments.seed
    check_drops(drops)
    check_seed(seed)
    surface = _surface(arguments)
    part = load_part(arguments.part, arguments.unit, arguments.parts, arguments.body)
    if not arguments.force:
        DropRequest(part, surface.conditions, seed, drops, 0.0).check_height()
    out = make_result_folder(arguments, part.name, (DOCUMENT, PAGE), lambda *_: None)
    for warning in part.warnings:
        warn(warning)
    samples = min(SAMPLES, len(surface.draws))
    with DropProgress(part.name, drops // samples * samples) as progress:
        result = propagate(
            part,
            surface,
            drops,
            samples=samples,
            seed=seed,
            confidence=confidence,
            workers=workers,
            progress=progress.update,
            stopped=lambda: stop.asked,
        )
        progress.end(result.drops)
    if len(result.counts) < 2:
        raise EngineError('interrupted before two samples were complete: there is no result')
    # The result is printed first, so that it is not lost if the disk is full.
    with analysis('the table of the shares'):
        print(result.to_json(), end='') if arguments.json else print(result)
    if out is not None:
        result.save_json(out / DOCUMENT)
        written = [out / DOCUMENT]
        with analysis('the report'):
            written.append(result.report(out))
        if not arguments.json:
            print(f'Written: {", ".join(map(str, written))}')
    if not result.complete:
        print(f'interrupted; the result has {len(result.counts)} samples', file=sys.stderr)
        return INTERRUPTED
    return 0


def _check_flags(arguments: argparse.Namespace) -> None:
    """Raise InvalidValueError for flags that cannot be combined with --propagate."""
    if arguments.part is None:
        raise InvalidValueError('missing part: expected a name or a mesh file before --propagate')
    for name in REFUSED:
        if getattr(arguments, name, None) not in (None, False, ''):
            raise InvalidValueError(f'invalid {flag_of(name)}: expected only without --propagate')
    if arguments.interval != 'wilson':
        raise InvalidValueError(
            f'invalid --interval {arguments.interval}: expected wilson with --propagate'
        )


def _surface(arguments: argparse.Namespace) -> UncertainSurface:
    """Return the uncertain surface with the conditions that the flags change.

    It is that of a calibration; without a file, the named one.
    """
    if not arguments.propagate:
        given = named_surface(arguments.surface, all_surfaces(arguments.surfaces))
    elif arguments.surface or arguments.surfaces:
        raise InvalidValueError(
            f'invalid --surface {arguments.surface or arguments.surfaces}: expected only with '
            '--propagate without a file, whose surface it replaces'
        )
    else:
        given = uncertain_surface(Path(arguments.propagate))
    fitted = {name for draw in given.draws for name in draw}
    for name in sorted(fitted & set(changed_conditions(arguments))):
        raise InvalidValueError(
            f'invalid {flag_of(name)}: expected only a condition that the calibration did not fit'
        )
    return UncertainSurface(requested_conditions(arguments, given.conditions), given.draws)
