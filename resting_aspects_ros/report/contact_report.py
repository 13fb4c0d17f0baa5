"""Contacts with floor and walls: rows of the JSON document, and a table for the terminal."""

from collections import Counter

from rich.table import Table

from resting_aspects_ros.report.document import numbers, share_fields
from resting_aspects_ros.report.table import plain_table, shares
from resting_aspects_ros.statistics.distribution import Distribution, Placements

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
    named = [contacts.named(placement) for placement, _ in rows]
    texts = [['-' if one[name] is None else str(one[name]) for name in names] for one in named]
    _letter_repeated(texts)
    for (placement, interval), cells in zip(rows[:MAX_ROWS], texts, strict=False):
        table.add_row(*cells, *shares(interval, placement.count, distribution.drops))
    if len(rows) > MAX_ROWS:
        rest = sum(placement.count for placement, _ in rows[MAX_ROWS:])
        table.add_row(f'{len(rows) - MAX_ROWS} more', *[''] * (len(names) + 1), str(rest))
    return table


def _letter_repeated(rows: list[list[str]]) -> None:
    """Add letters to rows with the same cells, which differ in the orientation of the part.

    The letter follows the last cell that is not an aspect: 'edge a', 'edge b'.
    """
    total = Counter(map(tuple, rows))
    seen: Counter[tuple[str, ...]] = Counter()
    for row in rows:
        key = tuple(row)
        if total[key] > 1:
            column = max((k for k, cell in enumerate(row) if cell[0].isalpha()), default=-1)
            row[column] += f' {_letters(seen[key])}'
            seen[key] += 1


def _letters(number: int) -> str:
    """Return a, b, ... z, aa, ab, ... for 0, 1, ..."""
    first, last = divmod(number, 26)
    return (_letters(first - 1) if first else '') + chr(ord('a') + last)
