"""Tables and texts on standard output."""

import dataclasses
from collections.abc import Iterable

from rich.console import Console
from rich.measure import Measurement

from resting_aspects_ros.api.conditions import outcome_hints, pieces_text, simulated_pieces
from resting_aspects_ros.api.drop import DropResult
from resting_aspects_ros.api.model_range import model_range_text
from resting_aspects_ros.cli.life_cycle import shown_tables
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.drops import contact_table, distribution_table
from resting_aspects_ros.report.format import size_text
from resting_aspects_ros.report.page import Item, Page, Text
from resting_aspects_ros.report.table import Table
from resting_aspects_ros.statistics.distribution import Distribution

# Width of a table that is written to a pipe or a file.
PIPED_WIDTH = 80
# Maximum width of a table.
MAX_WIDTH = 1000


def make_console() -> Console:
    """Return a console on standard output, as wide as the terminal if there is one."""
    console = Console()
    if not console.is_terminal:
        # Otherwise rich would use the width of the terminal in which the command was typed.
        console.width = PIPED_WIDTH
    return console


def show_table(table: Table, name: str = '') -> None:
    """Print a table without cutting off digits, even if it is wider than the terminal.

    ``name`` is its title in the file of --table if it has none.
    """
    shown_tables.append(dataclasses.replace(table, title=table.title or name))
    console = make_console()
    options = console.options.update(width=MAX_WIDTH)
    console.width = max(console.width, Measurement.get(console, options, table).maximum)
    console.print(table)


def show_texts(*texts: str) -> None:
    """Print texts in lines of the width of the terminal, except empty ones."""
    console = make_console()
    for text in filter(None, texts):
        console.print(text, markup=False, highlight=False)


def show_page(page: Page) -> None:
    """Print the title, the texts and the tables of a page, without its figures."""
    show_texts(f'{page.title}: {page.subtitle}')
    for section in page.sections:
        print()
        show_texts(section.heading)
        show_items(section.items, section.heading)


def show_items(items: Iterable[Item], heading: str = '') -> None:
    """Print the texts and the tables among the items of a section."""
    title = ''
    for item in items:
        if isinstance(item, Text) and item.style == 'part':
            title = f'{heading}: {item.text}'
        elif isinstance(item, Table):
            print()
            show_table(dataclasses.replace(item, title=item.title or title), heading)
        elif isinstance(item, str | Text):
            show_texts(item if isinstance(item, str) else item.text)


def print_table(
    distribution: Distribution,
    title: str,
    part: Part | None = None,
    *,
    each: bool = False,
    no_model_range: str = '',
) -> None:
    """Print the table of a distribution, and what the model range covers."""
    show_table(distribution_table(distribution, title, part, each=each))
    show_texts(model_range_text(distribution.model, no_model_range))


def print_result(result: DropResult, *, each: bool = False) -> None:
    """Print a result as tables and texts.

    With ``each`` the table has a row for each aspect, even where several look the same.
    """
    part = result.part
    # The size shows if the mesh was read in a wrong unit.
    size = f', {size_text(part)}' if part else ''
    title = f'{result.run.part}{size}\n{result.subtitle}'
    missing = result.no_model_range
    print_table(result.distribution, title, part, each=each, no_model_range=missing)
    if result.contacts is not None and result.contacts.placements:
        show_table(contact_table(result.contacts, result.distribution))
    if pieces := simulated_pieces(part, result.run.conditions):
        show_texts(pieces_text(pieces, 'The surroundings meet'))
    show_texts(*outcome_hints(result.distribution, result.run.conditions))
    if result.convergence is not None:
        print(result.convergence.text())
