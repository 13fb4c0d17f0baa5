"""`resting_aspects aspects`: how a part can rest, from its shape alone."""

import argparse
import sys

from resting_aspects_ros.cli.console import make_console, show_table
from resting_aspects_ros.cli.options import add_output, add_part
from resting_aspects_ros.cli.part_argument import part_of
from resting_aspects_ros.core.aspects.aspect import find_aspects
from resting_aspects_ros.report.document import aspects_document, to_json
from resting_aspects_ros.report.rounding import size_text
from resting_aspects_ros.report.table import aspect_table, symmetry_text

DESCRIPTION = """Show in which aspects a part can rest, which of them look alike because a
rotation maps the part onto itself, from which share of all directions it
rolls into each if it is let go without speed (basin), and by how much its
centre of mass must rise to leave it (barrier)."""
EXAMPLES = """examples:
  resting_aspects aspects hex_nut
  resting_aspects aspects my_part.stl --unit mm --json
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_part(parser)
    add_output(parser)


def run(arguments: argparse.Namespace) -> int:
    """Do it; raises RestingAspectsError for wrong input."""
    part = part_of(arguments)
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
