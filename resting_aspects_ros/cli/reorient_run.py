"""Simulate the actions that `resting_aspects reorient` requests, show and save the results."""

import argparse
import sys
from functools import partial
from typing import Any

from resting_aspects_ros.api.load_part import load_part
from resting_aspects_ros.api.reorient import reorient_each
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
from resting_aspects_ros.cli.options import (
    parse_numbers,
    parse_share,
    requested_conditions,
)
from resting_aspects_ros.cli.reorient_show import (
    DOCUMENT,
    Answer,
    answer_files,
    print_answer,
    write_page,
)
from resting_aspects_ros.errors import analysis
from resting_aspects_ros.statistics.intervals import check_precision


def reorient_and_show(arguments: argparse.Namespace, session: Session, confidence: float) -> int:
    """Simulate and show; returns the exit code. Raises RestingAspectsError for wrong input."""
    actions = requested_actions(arguments)
    options = _options(arguments, confidence)
    part = load_part(arguments.part, arguments.unit, arguments.parts, arguments.body)
    wanted = _wanted(arguments, find_aspects(part))
    out = result_folder(arguments, part.name, (DOCUMENT,))
    results, failure = partial_result(
        partial(reorient_each, part, actions, arguments.per_aspect, **options, **session.options)
    )
    answer = Answer(tuple(results), wanted)
    by_class = not (arguments.each or arguments.wanted is not None)

    def show() -> None:
        with analysis('the tables of the result'):
            print_answer(answer, by_class=by_class, as_json=arguments.json)

    finish(
        arguments,
        out,
        answer_files(answer, part, pictures=not arguments.report),
        show,
        partial(write_page, answer) if arguments.report else None,
    )
    code = exit_code(
        f'{sum(int(result.matrix.actions.sum()) for result in results)} actions',
        complete=all(result.complete for result in results),
        failure=failure,
    )
    checked = all(result.convergence is not None for result in results)
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
    given = [
        None if text is None else parse_numbers(flag, text)
        for flag, text in (
            ('--wanted', arguments.wanted),
            ('--wanted-classes', arguments.wanted_classes),
        )
    ]
    return () if given == [None, None] else aspects.chosen(given[0], given[1], 'wanted')
