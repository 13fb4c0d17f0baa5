"""Output of the commands on standard output: tables, or one JSON document."""

import sys
from typing import TYPE_CHECKING

from rich.console import Console
from rich.measure import Measurement

from resting_aspects_ros.api.conditions import outcome_hints, simulated_shapes
from resting_aspects_ros.api.drop_result import DropResult
from resting_aspects_ros.api.model_range import model_range_text
from resting_aspects_ros.api.runner import ShownProgress
from resting_aspects_ros.cli.life_cycle import note_table
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.drops import (
    contact_table,
    distribution_table,
    merged_text,
    never_seen_text,
)
from resting_aspects_ros.report.format import size_text
from resting_aspects_ros.report.table import Table
from resting_aspects_ros.statistics.distribution import Distribution

if TYPE_CHECKING:
    from resting_aspects_ros.nodes.log_replayer.node import ReplayPosition

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


def show_table(console: Console, table: Table) -> None:
    """Print a table without cutting off digits, even if it is wider than the terminal."""
    note_table(table)
    before = console.width
    options = console.options.update(width=MAX_WIDTH)
    console.width = max(before, Measurement.get(console, options, table).maximum)
    console.print(table)
    console.width = before


def print_table(
    distribution: Distribution,
    title: str,
    part: Part | None = None,
    *,
    each: bool = False,
    no_model_range: str = '',
) -> None:
    """Print the table of a distribution, with bounds for aspects that were never seen."""
    console = make_console()
    show_table(console, distribution_table(distribution, title, part, each=each))
    texts = (
        model_range_text(distribution, no_model_range),
        never_seen_text(distribution, each=each),
        merged_text(distribution.aspects),
    )
    for text in filter(None, texts):
        console.print(text, highlight=False)


def print_result(result: DropResult, *, as_json: bool, each: bool = False) -> None:
    """Print a result as one JSON document, or as a table.

    With ``each`` the table has a row for each aspect, even where several look the same.
    """
    if as_json:
        sys.stdout.write(result.to_json())
        return
    part = result.part
    # The size shows if the mesh was read in a wrong unit.
    size = f', {size_text(part)}' if part else ''
    title = f'{result.run.part}{size}\n{result.subtitle}'
    missing = result.no_model_range
    print_table(result.distribution, title, part, each=each, no_model_range=missing)
    if result.contacts is not None and result.contacts.placements:
        show_table(make_console(), contact_table(result.contacts, result.distribution))
    if shapes := simulated_shapes(part, result.run.conditions):
        for sentence in shapes.sentences():
            make_console().print(sentence, highlight=False)
    radius = part.hull_radius if part else None
    for hint in outcome_hints(result.distribution, result.run.conditions, radius):
        make_console().print(hint, highlight=False)
    if result.convergence is not None:
        print(result.convergence.text())


class ReplayProgress(ShownProgress):
    """Progress bar with the position of a replay; only on a terminal."""

    def __init__(self) -> None:
        super().__init__('', 1.0)

    def update(self, position: 'ReplayPosition') -> None:
        """Update the displayed position; the first call shows the bar, the end removes it."""
        if self._bar is None:
            return
        self._bar.update(
            self._task,
            description='paused' if position.paused else 'replay',
            completed=1.0 if position.over else position.seconds / (position.length or 1.0),
            text=str(position),
        )
        self._bar.start()
        if position.over:
            self._bar.stop()
            self._bar = None
