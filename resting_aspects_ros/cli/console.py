"""What the commands print on standard output: tables, or one JSON document."""

import sys

from rich.console import Console
from rich.measure import Measurement
from rich.table import Table

from resting_aspects_ros.api.drop_result import DropResult
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.statistics.distribution import Distribution
from resting_aspects_ros.report.rounding import size_text
from resting_aspects_ros.report.table import distribution_table, never_seen_text

# Of a table that goes into a pipe or a file.
PIPED_WIDTH = 80
# No table is wider.
WIDEST = 1000


def make_console() -> Console:
    """Standard output, as wide as its terminal, if it is one."""
    console = Console()
    if not console.is_terminal:
        # Not that of the terminal in which the command was typed.
        console.width = PIPED_WIDTH
    return console


def show_table(console: Console, table: Table) -> None:
    """Print a table whole: where it is wider than the terminal no digit is cut off."""
    before = console.width
    options = console.options.update(width=WIDEST)
    console.width = max(before, Measurement.get(console, options, table).maximum)
    console.print(table)
    console.width = before


def print_table(
    distribution: Distribution, title: str, part: Part | None = None, *, each: bool = False
) -> None:
    """Print the table of a distribution, with what is known of aspects that were never seen."""
    console = make_console()
    show_table(console, distribution_table(distribution, title, part, each=each))
    if unseen := never_seen_text(distribution, each=each):
        console.print(unseen, highlight=False)


def print_result(result: DropResult, *, as_json: bool, each: bool = False) -> None:
    """Print a result as a document and nothing else, or as a table.

    ``each`` asks for a row for each aspect, also where several look alike.
    """
    if as_json:
        sys.stdout.write(result.to_json())
        return
    part = result.part
    # A mesh that is read in a wrong unit shows by its size.
    size = f', {size_text(part)}' if part else ''
    title = f'{result.run.part}{size}\n{result.words}'
    print_table(result.distribution, title, part, each=each)
    if result.convergence is not None:
        print(result.convergence.text())
