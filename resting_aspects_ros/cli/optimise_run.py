"""Make the search that `resting_aspects optimise` requests, show and save its result."""

import argparse
import sys
from pathlib import Path

from resting_aspects_ros.api.condition_text import shipped_actions
from resting_aspects_ros.api.load_part import load_part
from resting_aspects_ros.api.output_files import check_output, make_folder
from resting_aspects_ros.api.progress import DropProgress
from resting_aspects_ros.api.surroundings import requested_surroundings
from resting_aspects_ros.cli.console import make_console, show_table
from resting_aspects_ros.cli.forecast_options import parse_numbers
from resting_aspects_ros.cli.options import changed_conditions
from resting_aspects_ros.core.aspects.aspect import find_aspects
from resting_aspects_ros.core.aspects.landscape import Landscape
from resting_aspects_ros.core.errors import (
    EngineError,
    InvalidValueError,
    RestingAspectsError,
    analysis,
    warn,
)
from resting_aspects_ros.simulation.actions import Actions, NamedAction
from resting_aspects_ros.simulation.chunks import Workers
from resting_aspects_ros.simulation.interruption import Interruption
from resting_aspects_ros.simulation.surfaces import all_surfaces
from resting_aspects_ros.studies.design import Setting, parse_factor
from resting_aspects_ros.studies.objectives import make_objective
from resting_aspects_ros.studies.optimisation import Optimisation
from resting_aspects_ros.studies.optimise import contacts_wanted
from resting_aspects_ros.studies.optimise_result import PAGE, OptimiseResult
from resting_aspects_ros.studies.optimise_tables import candidate_table, factor_table
from resting_aspects_ros.studies.optimum_problem import BUDGET, Amounts

INTERRUPTED = 130
DOCUMENT, POINTS = 'optimum.json', 'points.csv'


def optimise_and_show(
    arguments: argparse.Namespace, workers: Workers, confidence: float, stop: Interruption
) -> int:
    """Search and show; returns the exit code. Raises RestingAspectsError for wrong input."""
    base, amounts = _base(arguments), _amounts(arguments)
    factors = [parse_factor(text, base) for text in arguments.vary]
    out = _folder(arguments)
    part = load_part(arguments.part, arguments.unit, arguments.parts, arguments.body)
    for warning in part.warnings:
        warn(warning)
    landscape = Landscape(part)
    aspects = find_aspects(part, landscape)
    objective = make_objective(
        aspects,
        _numbers('--wanted', arguments.wanted),
        _numbers('--wanted-classes', arguments.wanted_classes),
        minimise_entropy=arguments.minimise_entropy,
        contacts=contacts_wanted(arguments.wanted_contacts, part, base, aspects),
    )
    failure: EngineError | None = None
    with DropProgress(part.name, amounts.total) as progress:
        optimisation = Optimisation(
            part,
            factors,
            base,
            objective,
            amounts,
            arguments.seed,
            workers,
            landscape=landscape,
            confidence=confidence,
            progress=progress.update,
            stopped=lambda: stop.asked,
        )
        try:
            optimisation.run()
            if not stop.asked:
                progress.end(optimisation.drops)
        except EngineError as error:
            failure = error
    if out is not None:
        optimisation.save_csv(out / POINTS)
    result = optimisation.result()
    if result is None:
        if failure is not None:
            raise failure
        if not stop.asked:
            raise RestingAspectsError('the drops give no result: too few points or no surrogate')
        print('interrupted; too few points were simulated for a result', file=sys.stderr)
        return INTERRUPTED
    _show(result, arguments, out)
    if failure is not None:
        raise EngineError(f'{failure}; the result has {result.drops} of {amounts.total} drops')
    if not result.complete:
        print(
            f'interrupted; the result has {result.drops} of {amounts.total} drops',
            file=sys.stderr,
        )
        return INTERRUPTED
    return 0


def _amounts(arguments: argparse.Namespace) -> Amounts:
    """Return the number of points and drops; raises InvalidValueError."""
    budget = arguments.budget
    if budget is None:
        budget = BUDGET * arguments.points * arguments.drops
    return Amounts(arguments.points, arguments.drops, budget)


def _folder(arguments: argparse.Namespace) -> Path | None:
    """Return the folder of the result, None if it is not saved; raises InvalidValueError."""
    out: Path | None = arguments.out
    if out is not None:
        make_folder('--out', out)
        for name in (DOCUMENT, POINTS, PAGE):
            check_output('--out', out / name)
    return out


def _base(arguments: argparse.Namespace) -> Setting:
    """Return the conditions from which the factors differ; raises InvalidValueError."""
    conditions = all_surfaces(arguments.surfaces).get(arguments.surface)
    action: NamedAction | None = None
    if arguments.action is not None:
        known = shipped_actions() if arguments.actions is None else Actions.read(arguments.actions)
        action = known.get(arguments.action)
    elif arguments.actions is not None:
        raise InvalidValueError(
            f'invalid --actions {str(arguments.actions)!r}: expected only with --action'
        )
    return Setting(
        conditions.changed(**changed_conditions(arguments)),
        requested_surroundings(arguments.surroundings, arguments.set),
        action,
    )


def _numbers(flag: str, text: str | None) -> tuple[int, ...] | None:
    return None if text is None else parse_numbers(flag, text)


def _show(result: OptimiseResult, arguments: argparse.Namespace, out: Path | None) -> None:
    """Print the result, and then save it: it is not lost if the disk is full."""
    if arguments.json:
        sys.stdout.write(result.to_json())
    else:
        with analysis('the tables of the result'):
            console = make_console()
            show_table(console, candidate_table(result))
            show_table(console, factor_table(result))
            for note in result.notes:
                console.print(note, markup=False, highlight=False)
    if out is None:
        return
    result.save_json(out / DOCUMENT)
    written = [out / DOCUMENT, out / POINTS]
    with analysis('the report'):
        written.append(result.report(out))
    if not arguments.json:
        print(f'Written: {", ".join(map(str, written))}')
