"""Make the search that `resting_aspects optimise` requests, show and save its result."""

import argparse
import sys
from pathlib import Path

from resting_aspects_ros.api.condition_text import shipped_actions
from resting_aspects_ros.api.load_part import load_part
from resting_aspects_ros.api.output_files import check_output, make_folder
from resting_aspects_ros.api.surroundings import requested_surroundings
from resting_aspects_ros.cli.console import make_console, show_table
from resting_aspects_ros.cli.forecast_options import parse_numbers
from resting_aspects_ros.cli.options import changed_conditions
from resting_aspects_ros.errors import (
    InvalidValueError,
    RestingAspectsError,
    analysis,
    warn,
)
from resting_aspects_ros.simulation.actions import Actions, NamedAction
from resting_aspects_ros.simulation.conditions import all_surfaces
from resting_aspects_ros.simulation.interruption import Interruption
from resting_aspects_ros.simulation.workers import Workers
from resting_aspects_ros.studies.design import parse_ranges
from resting_aspects_ros.studies.optimise import optimise
from resting_aspects_ros.studies.optimum import PAGE, OptimiseResult

INTERRUPTED = 130
DOCUMENT, POINTS = 'optimum.json', 'points.csv'


def optimise_and_show(
    arguments: argparse.Namespace, workers: Workers, confidence: float, stop: Interruption
) -> int:
    """Search and show; returns the exit code. Raises RestingAspectsError for wrong input."""
    conditions = all_surfaces(arguments.surfaces).get(arguments.surface)
    action = _action(arguments)
    out = _folder(arguments)
    part = load_part(arguments.part, arguments.unit, arguments.parts, arguments.body)
    for warning in part.warnings:
        warn(warning)
    try:
        result = optimise(
            part,
            parse_ranges(arguments.vary),
            wanted=_numbers('--wanted', arguments.wanted),
            wanted_classes=_numbers('--wanted-classes', arguments.wanted_classes),
            wanted_contacts=arguments.wanted_contacts,
            minimise_entropy=arguments.minimise_entropy,
            surface=conditions.changed(**changed_conditions(arguments)),
            surroundings=requested_surroundings(arguments.surroundings, arguments.set),
            action=action,
            budget=arguments.budget,
            seed=arguments.seed,
            confidence=confidence,
            workers=workers,
            progress=True,
            stopped=lambda: stop.asked,
        )
    except RestingAspectsError as error:
        if not stop.asked:
            raise
        print(error, file=sys.stderr)
        return INTERRUPTED
    _show(result, arguments, out)
    if not result.complete:
        print(
            f'interrupted; the result has {result.drops} of {result.budget} drops',
            file=sys.stderr,
        )
        return INTERRUPTED
    return 0


def _folder(arguments: argparse.Namespace) -> Path | None:
    """Return the folder of the result, None if it is not saved; raises InvalidValueError."""
    out: Path | None = arguments.out
    if out is not None:
        make_folder('--out', out)
        for name in (DOCUMENT, POINTS, PAGE):
            check_output('--out', out / name)
    return out


def _action(arguments: argparse.Namespace) -> NamedAction | None:
    """Return the action that is done to parts that were dropped; raises InvalidValueError."""
    if arguments.action is not None:
        known = shipped_actions() if arguments.actions is None else Actions.read(arguments.actions)
        return known.get(arguments.action)
    if arguments.actions is not None:
        raise InvalidValueError(
            f'invalid --actions {str(arguments.actions)!r}: expected only with --action'
        )
    return None


def _numbers(flag: str, text: str | None) -> tuple[int, ...] | None:
    return None if text is None else parse_numbers(flag, text)


def _show(result: OptimiseResult, arguments: argparse.Namespace, out: Path | None) -> None:
    """Print the result, and then save it: it is not lost if the disk is full."""
    if arguments.json:
        sys.stdout.write(result.to_json())
    else:
        with analysis('the tables of the result'):
            console = make_console()
            show_table(console, result.candidate_table())
            if result.facts:
                show_table(console, result.factor_table())
            for note in result.notes:
                console.print(note, markup=False, highlight=False)
    if out is None:
        return
    result.save_json(out / DOCUMENT)
    result.save_csv(out / POINTS)
    written = [out / DOCUMENT, out / POINTS]
    with analysis('the report'):
        written.append(result.report(out))
    if not arguments.json:
        print(f'Written: {", ".join(map(str, written))}')
