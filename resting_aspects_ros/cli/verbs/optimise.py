"""`resting_aspects optimise`: the conditions with the most of the wanted aspects."""

import argparse
from functools import partial

from resting_aspects_ros.api.conditions import requested_surroundings
from resting_aspects_ros.cli import life_cycle, options
from resting_aspects_ros.cli.console import show_table, show_texts
from resting_aspects_ros.studies.design import parse_ranges
from resting_aspects_ros.studies.optimise import optimise
from resting_aspects_ros.studies.optimum import PAGE, OptimiseResult

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
    options.add_part(parser)
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
    text = 'find the largest share of these aspects, such as 1,3'
    options.add_numbers(parser, '--wanted', 'IDS', text)
    options.add_numbers(parser, '--wanted-classes', 'NUMBERS', 'the same for symmetry classes')
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
    options.add_actions_file(parser)
    options.add_integer(
        parser,
        '--budget',
        'number of all drops: half of them search, and half are fresh drops that compare the best '
        'conditions with others (200000)',
        default=200_000,
    )
    options.add_seed(parser, 'result')
    options.add_confidence(parser)
    options.add_workers(parser)
    options.add_out(
        parser, 'write optimum.json, points.csv and the page report.html into this folder'
    )
    options.add_output(parser, each=False)
    options.add_conditions(parser)
    options.add_surroundings(parser)


def run(arguments: argparse.Namespace) -> int:
    """Search and show; returns the exit code. Raises RestingAspectsError for wrong input."""
    with life_cycle.session(arguments) as started:
        action = None
        if arguments.action is not None:
            action = options.known_actions(arguments).get(arguments.action)
        else:
            options.refuse(arguments, ('actions',), 'with --action')
        part = options.requested_part(arguments)
        out = life_cycle.result_folder(arguments, part.name, (DOCUMENT, POINTS, PAGE))
        result = optimise(
            part,
            parse_ranges(arguments.vary),
            wanted=arguments.wanted,
            wanted_classes=arguments.wanted_classes,
            minimise_entropy=arguments.minimise_entropy,
            surface=options.requested_surface(arguments),
            surroundings=requested_surroundings(arguments.surroundings, arguments.set),
            action=action,
            budget=arguments.budget,
            seed=arguments.seed,
            confidence=arguments.confidence,
            **started,
        )
        document = DOCUMENT, result.to_json
        files = {POINTS: result.save_csv}
        life_cycle.finish(arguments, out, document, files, partial(_show, result), result.report)
        has = f'{result.drops} of {result.budget} drops'
        return life_cycle.exit_code(has, started)


def _show(result: OptimiseResult) -> None:
    show_table(result.candidate_table())
    show_texts(*result.notes)
