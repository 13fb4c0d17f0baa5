"""Read numbers with and without units from the texts of options."""

import argparse
from decimal import Decimal, InvalidOperation

from resting_aspects_ros.errors import InvalidValueError, shown
from resting_aspects_ros.input_files import NUMBER, parse_quantity

__all__ = ['parse_integer', 'parse_quantity', 'parse_share']

MAX_DIGITS = 20


def parse_share(name: str, text: str) -> float:
    """Return 0.02 for ``0.02`` or ``2%``; raises InvalidValueError."""
    match = NUMBER.fullmatch(text)
    if match is None or match[2] not in ('', '%'):
        raise InvalidValueError(
            f'invalid {name} {shown(text)}: expected a number, such as 0.02 or 2%'
        )
    number = float(match[1])
    if number > 1 and not match[2]:
        raise InvalidValueError(
            f'invalid {name} {shown(text)}: expected at most 1; {number:g} percent is '
            f'{match[1]}% or {number / 100:g}'
        )
    return number / (100 if match[2] else 1)


def parse_integer(text: str) -> int:
    """Return ``1000``, ``10_000`` or ``1e4`` as an integer; the type of an option."""
    try:
        return int(text)
    except ValueError:
        pass
    try:
        number = Decimal(text)
    except InvalidOperation:
        number = Decimal('NaN')
    # Refuses NaN, infinity, fractions, and more digits than any option accepts.
    if not number.is_finite() or number.adjusted() > MAX_DIGITS or number != int(number):
        raise argparse.ArgumentTypeError(f'{shown(text)} is not an integer, such as 1000 or 1e4')
    return int(number)
