"""Contacts with floor and walls: rows of the JSON document, and a table for the terminal."""

from rich.table import Table

from resting_aspects_ros.core.statistics.contact_counts import Placements
from resting_aspects_ros.core.statistics.distribution import Distribution
from resting_aspects_ros.report.document import numbers, share_fields
from resting_aspects_ros.report.table import plain_table, shares

# Rows of the table in a terminal.
MAX_ROWS = 20


def contact_rows(contacts: Placements, distribution: Distribution) -> list[dict[str, object]]:
    """Return a row for each placement, the most frequent first, as plain JSON types.

    Each has ``contacts`` (by the names of the planes: the id of an aspect, 'other side', 'edge',
    'corner', or null), ``symmetry_class``, ``orientation`` (xyzw, tray from part, of its first
    drop), and the fields of a share.
    """
    return [
        {
            'contacts': contacts.named(placement),
            'symmetry_class': placement.symmetry_class,
            'orientation': numbers(placement.orientation),
            **share_fields(placement.count, interval),
        }
        for placement, interval in contacts.sorted_rows(
            distribution.interval, distribution.confidence
        )
    ]


def contact_table(contacts: Placements, distribution: Distribution) -> Table:
    """Return a table of what the parts touch, by aspect ids, the most frequent first."""
    names = list(dict.fromkeys(contacts.planes))
    table = plain_table(
        'Contacts: which side of the part is on which plane, by the number of its aspect',
        *(name.replace('_', ' ') for name in names),
        'proba-\nbility',
        f'{100 * distribution.confidence:g} % interval',
        'count',
    )
    rows = contacts.sorted_rows(distribution.interval, distribution.confidence)
    for placement, interval in rows[:MAX_ROWS]:
        named = contacts.named(placement)
        cells = ['-' if named[name] is None else str(named[name]) for name in names]
        table.add_row(*cells, *shares(interval, placement.count, distribution.drops))
    if len(rows) > MAX_ROWS:
        rest = sum(placement.count for placement, _ in rows[MAX_ROWS:])
        table.add_row(f'{len(rows) - MAX_ROWS} more', *[''] * (len(names) + 1), str(rest))
    return table
