"""Numbers with a unit, as a person types them."""

import re
from decimal import Decimal, InvalidOperation

from resting_aspects_ros.core.errors import InvalidValueError, shown

# Factors to SI, by the unit that a quantity has inside.
_FACTORS: dict[str, dict[str, float]] = {
    'm': {'m': 1.0, 'um': 1e-6, 'mm': 1e-3, 'cm': 1e-2, 'in': 0.0254, 'ft': 0.3048},
    'm/s': {'m/s': 1.0, 'mm/s': 1e-3, 'cm/s': 1e-2},
    'm/s2': {'m/s2': 1.0, 'm/s^2': 1.0, 'mm/s2': 1e-3, 'mm/s^2': 1e-3},
    'rad/s': {'rad/s': 1.0, 'deg/s': 0.017453292519943295, 'rpm': 0.10471975511965977},
    '': {},
}
MAX_DIGITS = 20
_NUMBER = re.compile(r'\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(\S*)\s*')


def parse_quantity(name: str, text: str, unit: str) -> float:
    """``60mm`` as 0.06, if the unit inside is m. A bare number is in the unit inside.

    Raises InvalidValueError, with the units that are allowed.
    """
    match = _NUMBER.fullmatch(text)
    factors = _FACTORS[unit]
    if match is None or (match[2] and match[2] not in factors):
        allowed = (
            f'a number, in {unit} or with one of {", ".join(factors)}' if unit else 'a number'
        )
        raise InvalidValueError(f'{name} is {shown(text)}, allowed is {allowed}')
    return float(match[1]) * factors.get(match[2], 1.0)


def parse_share(name: str, text: str) -> float:
    """``0.02`` or ``2%`` as 0.02; raises InvalidValueError."""
    match = _NUMBER.fullmatch(text)
    if match is None or match[2] not in ('', '%'):
        raise InvalidValueError(
            f'invalid {name} {shown(text)}: expected a number, such as 0.02 or 2%'
        )
    return float(match[1]) / (100 if match[2] else 1)


def parse_integer(text: str) -> int:
    """``1000``, ``10_000`` or ``1e4`` as an integer; raises ValueError."""
    try:
        return int(text)
    except ValueError:
        pass
    try:
        number = Decimal(text)
    except InvalidOperation:
        raise ValueError(text) from None
    # Not a number, infinite, with a fraction, or of more digits than any option takes.
    if not number.is_finite() or number.adjusted() > MAX_DIGITS or number != int(number):
        raise ValueError(text)
    return int(number)
