"""`resting_aspects aspects`: how a part can rest, from its shape alone."""

import argparse
import sys
from typing import Any

from resting_aspects_ros.commands.options import add_each, add_part

EXAMPLES = """examples:
  resting_aspects aspects hex_nut
  resting_aspects aspects my_part.stl --unit mm --json
"""


def add(subparsers: Any) -> None:
    """Declare the subcommand."""
    parser = subparsers.add_parser(
        'aspects',
        description='Show in which aspects a part can rest, which of them look alike because a\n'
        'rotation maps the part onto itself, from which share of all directions it\n'
        'rolls into each if it is let go without speed (basin), and by how much its\n'
        'centre of mass must rise to leave it (barrier).',
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_part(parser)
    add_each(parser)
    parser.add_argument('--json', action='store_true', help='print one JSON document instead')
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Do it; raises RestingAspectsError for wrong input."""
    # What takes a while to import, which --help does not need.
    from resting_aspects_ros.commands.answer import make_console, show_table
    from resting_aspects_ros.commands.given_part import given_part
    from resting_aspects_ros.core.aspects import find_aspects
    from resting_aspects_ros.report.aspect_table import aspect_table, symmetry_text
    from resting_aspects_ros.report.document import aspects_document, to_json
    from resting_aspects_ros.report.rounding import size_text

    part = given_part(arguments.part, arguments.unit, arguments.parts, arguments.body)
    for warning in part.warnings:
        print(f'warning: {warning}', file=sys.stderr)
    aspects = find_aspects(part)
    if arguments.json:
        sys.stdout.write(to_json(aspects_document(part, aspects)))
        return 0
    count, classes = len(aspects), len(aspects.classes())
    words = f'{_number(count, "aspect")} in {_number(classes, "class")}'
    title = f'{part.name}, {size_text(part)}: {words}'
    console = make_console()
    show_table(console, aspect_table(aspects, part, title, each=arguments.each))
    if aspects.symmetry is not None:
        console.print(f'Symmetry: {symmetry_text(aspects.symmetry)}.', highlight=False)
    console.print('Pictures: resting_aspects drop, with --report.', highlight=False)
    return 0


def _number(number: int, word: str) -> str:
    return f'{number} {word}{"" if number == 1 else "es" if word.endswith("s") else "s"}'
