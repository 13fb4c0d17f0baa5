"""`resting_aspects optimise`: the conditions with the most of the wanted aspects."""

import argparse
from functools import partial
from typing import TYPE_CHECKING

from resting_aspects_ros.cli.life_cycle import exit_code, finish, result_folder, session
from resting_aspects_ros.cli.options import (
    add_actions_file,
    add_conditions,
    add_confidence,
    add_integer,
    add_out,
    add_output,
    add_part,
    add_seed,
    add_surroundings,
    add_workers,
    changed_conditions,
    parse_numbers,
    refuse,
    requested_part,
)

if TYPE_CHECKING:
    from resting_aspects_ros.simulation.actions import NamedAction
    from resting_aspects_ros.studies.optimum import OptimiseResult

DESCRIPTION = """Find the conditions, within given ranges, in which most parts come to rest in
wanted aspects, or whose distribution has the least entropy. Fresh drops at the
best conditions, at the second best and at those of the other flags show how
certain the answer is. No ROS nodes are needed."""
EXAMPLES = """examples:
  resting_aspects optimise l_bracket --vary height=20mm:200mm --wanted 1
  resting_aspects optimise hex_nut --vary friction=0.1:0.5 --wanted-classes 1
  resting_aspects optimise part.stl --vary height=5mm:0.2 --wanted 1 --out best
  resting_aspects optimise l_bracket --vary height=20mm:0.2 --minimise-entropy
"""

DOCUMENT, POINTS = 'optimum.json', 'points.csv'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_part(parser)
    parser.add_argument(
        '--vary',
        metavar='NAME=LOW:HIGH',
        action='append',
        required=True,
        help='what varies, and its range: a condition, surroundings.NAME or action.NAME, such as '
        'height=20mm:200mm, surroundings.angle=0deg:20deg or action.speed=0.1:1; a third value is '
        'a number of levels, or log; can be repeated',
    )
    # No group of exclusive options, whose usage would be too wide: make_objective checks them.
    parser.add_argument(
        '--wanted', metavar='IDS', help='find the largest share of these aspects, such as 1,3'
    )
    parser.add_argument(
        '--wanted-classes', metavar='NUMBERS', help='the same for symmetry classes'
    )
    parser.add_argument(
        '--minimise-entropy',
        action='store_true',
        help='instead find the least entropy over the symmetry classes',
    )
    parser.add_argument(
        '--action',
        metavar='NAME',
        help='an action of config/actions.yaml or of --actions, which is done once to each part '
        'that was dropped, before it is counted (none)',
    )
    add_actions_file(parser)
    add_integer(
        parser,
        '--budget',
        'number of all drops: half of them search, and half are fresh drops that compare the best '
        'conditions with others (200000)',
        default=200_000,
    )
    add_seed(parser, 'result')
    add_confidence(parser)
    add_workers(parser)
    add_out(parser, 'write optimum.json, points.csv and the page report.html into this folder')
    add_output(parser, each=False)
    add_conditions(parser)
    add_surroundings(parser)


def run(arguments: argparse.Namespace) -> int:
    """Search and show; returns the exit code. Raises RestingAspectsError for wrong input."""
    with session(arguments) as started:
        from resting_aspects_ros.api.conditions import requested_surroundings
        from resting_aspects_ros.simulation.conditions import all_surfaces
        from resting_aspects_ros.studies.design import parse_ranges
        from resting_aspects_ros.studies.optimise import optimise
        from resting_aspects_ros.studies.optimum import PAGE

        conditions = all_surfaces(arguments.surfaces).get(arguments.surface)
        part = requested_part(arguments)
        out = result_folder(arguments, part.name, (DOCUMENT, POINTS, PAGE))
        result = optimise(
            part,
            parse_ranges(arguments.vary),
            wanted=_numbers('--wanted', arguments.wanted),
            wanted_classes=_numbers('--wanted-classes', arguments.wanted_classes),
            minimise_entropy=arguments.minimise_entropy,
            surface=conditions.changed(**changed_conditions(arguments)),
            surroundings=requested_surroundings(arguments.surroundings, arguments.set),
            action=_action(arguments),
            budget=arguments.budget,
            seed=arguments.seed,
            confidence=arguments.confidence,
            **started.options,
        )
        document = DOCUMENT, result.to_json
        files = {POINTS: result.save_csv}
        finish(arguments, out, document, files, partial(_show, result), result.report)
        return exit_code(f'{result.drops} of {result.budget} drops', complete=result.complete)


def _action(arguments: argparse.Namespace) -> 'NamedAction | None':
    """Return the action that is done to parts that were dropped; raises InvalidValueError."""
    from resting_aspects_ros.cli.action_options import known_actions

    if arguments.action is not None:
        return known_actions(arguments).get(arguments.action)
    refuse(arguments, ('actions',), 'with --action')
    return None


def _numbers(flag: str, text: str | None) -> tuple[int, ...] | None:
    return None if text is None else parse_numbers(flag, text)


def _show(result: 'OptimiseResult') -> None:
    from resting_aspects_ros.cli.console import show_table, show_texts

    show_table(result.candidate_table())
    show_texts(*result.notes)
