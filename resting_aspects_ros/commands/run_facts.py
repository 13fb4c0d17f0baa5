"""What a run was made of, as labels and values for people."""

from collections.abc import Iterator
from datetime import datetime, timezone

from resting_aspects_ros.drops.conditions import QUANTITIES, DropConditions

_NANOSECONDS = 1_000_000_000


def condition_facts(conditions: DropConditions) -> Iterator[tuple[str, str]]:
    """Label and value of each condition."""
    for name, quantity in QUANTITIES.items():
        of = f' ({conditions.height_of.label})' if name == 'height' else ''
        yield quantity.label, f'{getattr(conditions, name):g} {quantity.unit}'.rstrip() + of


def when_text(started: int) -> str:
    """A time, ns since the epoch, as '2025-01-31 12:00:00 UTC'."""
    return f'{datetime.fromtimestamp(started / _NANOSECONDS, timezone.utc):%Y-%m-%d %H:%M:%S} UTC'
