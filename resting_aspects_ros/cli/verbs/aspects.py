"""`resting_aspects aspects`: the aspects of a part, computed from its shape."""

import argparse

from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.cli import options
from resting_aspects_ros.cli.console import show_table, show_texts
from resting_aspects_ros.cli.life_cycle import show_result
from resting_aspects_ros.errors import warn
from resting_aspects_ros.report.document import aspects_document, to_json
from resting_aspects_ros.report.drops import aspect_table, symmetry_text
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
    options.add_part(parser)
    options.add_output(parser)


def run(arguments: argparse.Namespace) -> None:
    """Find and show the aspects. Raises RestingAspectsError."""
    part = options.requested_part(arguments)
    for warning in part.warnings:
        warn(warning)
    aspects = find_aspects(part)

    def show() -> None:
        count, classes = len(aspects), len(aspects.classes())
        words = f'{_number(count, "aspect")} in {_number(classes, "class")}'
        title = f'{part.name}, {size_text(part)}: {words}'
        show_table(aspect_table(aspects, part, title, each=arguments.each))
        symmetry = aspects.symmetry
        show_texts(
            '' if symmetry is None else f'Symmetry: {symmetry_text(symmetry)}.',
            'For pictures, run resting_aspects drop with --report.',
        )

    show_result(arguments, lambda: to_json(aspects_document(part, aspects)), show)


def _number(number: int, word: str) -> str:
    return f'{number} {word}{"" if number == 1 else "es" if word.endswith("s") else "s"}'
