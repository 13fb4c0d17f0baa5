"""`resting_aspects aspects`: the aspects of a part, computed from its shape."""

import argparse
import sys

from resting_aspects_ros.api.load_part import load_part
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.cli.console import make_console, show_table
from resting_aspects_ros.cli.options import add_output, add_part
from resting_aspects_ros.errors import warn
from resting_aspects_ros.report.document import aspects_document, to_json
from resting_aspects_ros.report.drops import aspect_table, merged_text, symmetry_text
from resting_aspects_ros.report.format import size_text

DESCRIPTION = """Show the aspects in which a part can rest, and which of them look the same
because a rotation maps the part onto itself. The basin of an aspect is the
share of all initial orientations from which the part rolls into it without
initial speed. The barrier is the minimum rise of the centre of mass that is
needed to leave it."""
EXAMPLES = """examples:
  resting_aspects aspects hex_nut
  resting_aspects aspects my_part.stl --unit mm --json
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_part(parser)
    add_output(parser)


def run(arguments: argparse.Namespace) -> int:
    """Find and show the aspects; returns the exit code. Raises RestingAspectsError."""
    part = load_part(arguments.part, arguments.unit, arguments.parts, arguments.body)
    for warning in part.warnings:
        warn(warning)
    aspects = find_aspects(part)
    if arguments.json:
        sys.stdout.write(to_json(aspects_document(part, aspects)))
        return 0
    count, classes = len(aspects), len(aspects.classes())
    words = f'{_number(count, "aspect")} in {_number(classes, "class")}'
    title = f'{part.name}, {size_text(part)}: {words}'
    console = make_console()
    show_table(console, aspect_table(aspects, part, title, each=arguments.each))
    if merged := merged_text(aspects):
        console.print(merged, highlight=False)
    if aspects.symmetry is not None:
        console.print(f'Symmetry: {symmetry_text(aspects.symmetry)}.', highlight=False)
    console.print('For pictures, run resting_aspects drop with --report.', highlight=False)
    return 0


def _number(number: int, word: str) -> str:
    return f'{number} {word}{"" if number == 1 else "es" if word.endswith("s") else "s"}'
