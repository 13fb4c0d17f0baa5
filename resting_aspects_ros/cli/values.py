"""Read numbers with and without units from the texts of options."""

import argparse
import re
from decimal import Decimal, InvalidOperation

from resting_aspects_ros.core.errors import InvalidValueError, shown

# Factors to SI units, by the SI unit of the quantity.
_FACTORS: dict[str, dict[str, float]] = {
    'm': {'m': 1.0, 'um': 1e-6, 'mm': 1e-3, 'cm': 1e-2, 'in': 0.0254, 'ft': 0.3048},
    'm/s': {'m/s': 1.0, 'mm/s': 1e-3, 'cm/s': 1e-2},
    'm/s2': {'m/s2': 1.0, 'm/s^2': 1.0, 'mm/s2': 1e-3, 'mm/s^2': 1e-3},
    'rad/s': {'rad/s': 1.0, 'deg/s': 0.017453292519943295, 'rpm': 0.10471975511965977},
    'rad': {'rad': 1.0, 'deg': 0.017453292519943295},
    's': {'s': 1.0, 'ms': 1e-3},
    'Hz': {'Hz': 1.0},
    'N s': {'Ns': 1.0, 'mNs': 1e-3},
    '': {},
}
MAX_DIGITS = 20
_NUMBER = re.compile(r'\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(\S*)\s*')


def parse_quantity(name: str, text: str, unit: str) -> float:
    """Return a number in the SI unit ``unit``: ``60mm`` is 0.06 m. A bare number is in that unit.

    Raises InvalidValueError, which lists the units.
    """
    match = _NUMBER.fullmatch(text)
    factors = _FACTORS[unit]
    if match is None or (match[2] and match[2] not in factors):
        expected = (
            f'a number, in {unit} or with one of {", ".join(factors)}' if unit else 'a number'
        )
        raise InvalidValueError(f'invalid {name} {shown(text)}: expected {expected}')
    return float(match[1]) * factors.get(match[2], 1.0)


def parse_share(name: str, text: str) -> float:
    """Return 0.02 for ``0.02`` or ``2%``; raises InvalidValueError."""
    match = _NUMBER.fullmatch(text)
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
