"""Simulate the actions that `resting_aspects reorient` requests, show and save the results."""

import argparse
import dataclasses
import sys
from functools import partial
from pathlib import Path
from typing import Any

from resting_aspects_ros.api.load_part import load_part
from resting_aspects_ros.api.reorient import reorient_each
from resting_aspects_ros.api.reorient_result import ReorientResult
from resting_aspects_ros.api.roadmap import (
    MeasuredComparison,
    MeasuredTrials,
    compare_measured,
    read_roadmap,
    with_measured,
)
from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.cli.action_options import requested_actions
from resting_aspects_ros.cli.life_cycle import (
    INTERRUPTED,
    Session,
    exit_code,
    finish,
    partial_result,
    result_folder,
)
from resting_aspects_ros.cli.options import parse_numbers, parse_share, requested_conditions
from resting_aspects_ros.cli.reorient_show import (
    DOCUMENT,
    ROADMAP,
    Answer,
    answer_files,
    print_answer,
    write_page,
)
from resting_aspects_ros.errors import InvalidValueError, analysis, warn
from resting_aspects_ros.simulation.actions import NamedAction
from resting_aspects_ros.statistics.intervals import check_precision
from resting_aspects_ros.statistics.markov import wanted_mask

# Rows with at least this number of measured trials replace the simulated ones.
MIN_TRIALS = 50


def reorient_and_show(arguments: argparse.Namespace, session: Session, confidence: float) -> int:
    """Simulate and show; returns the exit code. Raises RestingAspectsError for wrong input."""
    actions = requested_actions(arguments)
    options = _options(arguments, confidence)
    measured = None if arguments.measured is None else read_roadmap(arguments.measured)
    part = load_part(arguments.part, arguments.unit, arguments.parts, arguments.body)
    wanted = _wanted(arguments, find_aspects(part))
    out = _folder(arguments, part.name, actions)
    simulated, failure = partial_result(
        partial(reorient_each, part, actions, arguments.per_aspect, **options, **session.options)
    )
    results, checks = _with_trials(measured, simulated)
    replaced = any(
        (one.matrix.counts != other.matrix.counts).any()
        for one, other in zip(results, simulated, strict=True)
    )
    answer = Answer(tuple(results), wanted, tuple(checks))
    # Measured rows are those of single aspects, which a class would mix with simulated ones.
    by_class = not (arguments.each or arguments.wanted is not None or replaced)

    def show() -> None:
        with analysis('the tables of the result'):
            print_answer(answer, by_class=by_class, as_json=arguments.json)

    finish(
        arguments,
        out,
        answer_files(answer, simulated, part, pictures=not arguments.report),
        show,
        partial(write_page, answer, simulated) if arguments.report else None,
    )
    code = exit_code(
        f'{sum(int(result.matrix.actions.sum()) for result in simulated)} actions',
        complete=all(result.complete for result in simulated),
        failure=failure,
    )
    checked = all(result.convergence is not None for result in simulated)
    if not code and arguments.check_convergence and session.stop.asked and not checked:
        print('interrupted; convergence was not checked', file=sys.stderr)
        return INTERRUPTED
    return code


def _options(arguments: argparse.Namespace, confidence: float) -> dict[str, Any]:
    """Return the options of the simulation that the flags request; raises InvalidValueError."""
    precision = 0.0
    if arguments.precision is not None:
        precision = parse_share('--precision', arguments.precision)
        check_precision(precision)
    return {
        'surface': requested_conditions(arguments),
        'precision': precision,
        'drops': arguments.drops,
        'seed': arguments.seed,
        'confidence': confidence,
        'check_convergence': arguments.check_convergence,
        'engine': arguments.engine,
    }


def _wanted(arguments: argparse.Namespace, aspects: AspectSet) -> tuple[int, ...]:
    """Return the ids of the wanted aspects."""
    if arguments.wanted is not None:
        numbers = parse_numbers('--wanted', arguments.wanted)
        wanted_mask(numbers, len(aspects))
        return tuple(sorted(set(numbers)))
    if arguments.wanted_classes is None:
        return ()
    classes = aspects.classes()
    numbers = parse_numbers('--wanted-classes', arguments.wanted_classes)
    wanted_mask(numbers, len(classes), 'symmetry class')
    return tuple(sorted({a.id for number in numbers for a in classes[number - 1]}))


def _folder(arguments: argparse.Namespace, part: str, actions: list[NamedAction]) -> Path | None:
    """Return the folder of the result, None if it is not saved.

    Raises InvalidValueError if the folder cannot be written, or has the file of measured trials,
    which would be replaced.
    """

    def check_report(flag: str, out: Path) -> None:
        # This import is slow, and only needed for a report.
        from resting_aspects_ros.api.reorientation_files import check_reorientation_report

        check_reorientation_report(flag, out, [action.name for action in actions])

    out = result_folder(arguments, part, (DOCUMENT,), check_report)
    measured: Path | None = arguments.measured
    if out is not None and measured is not None:
        roadmap = out / ROADMAP
        if roadmap.exists() and measured.samefile(roadmap):
            raise InvalidValueError(
                f'invalid folder {str(out)!r}: expected another one than that of --measured, '
                'whose trials would be lost'
            )
    return out


def _with_trials(
    measured: MeasuredTrials | None, results: list[ReorientResult]
) -> tuple[list[ReorientResult], list[MeasuredComparison]]:
    """Return the results with measured rows, and the comparisons with measured trials."""
    if measured is None:
        return results, []
    replaced: list[ReorientResult] = []
    checks: list[MeasuredComparison] = []
    for result in results:
        name, matrix = result.action.name, result.matrix
        if name in measured.actions:
            checks += compare_measured(measured, matrix, name)
            matrix = with_measured(measured, matrix, name, MIN_TRIALS)
        replaced.append(dataclasses.replace(result, matrix=matrix))
    if not checks:
        names = ', '.join(result.action.name for result in results)
        warn(f'{measured.source} has no trials of {names}')
    return replaced, checks
