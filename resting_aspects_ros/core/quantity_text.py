"""Numbers with a unit, as people write them: ``60mm``, ``45 deg``."""

import re

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
# A number and, perhaps, what follows it.
NUMBER = re.compile(r'\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(\S*)\s*')


def parse_quantity(name: str, text: str, unit: str) -> float:
    """Return a number in the SI unit ``unit``: ``60mm`` is 0.06 m. A bare number is in that unit.

    Raises InvalidValueError, which lists the units.
    """
    match = NUMBER.fullmatch(text)
    factors = _FACTORS[unit]
    if match is None or (match[2] and match[2] not in factors):
        expected = (
            f'a number, in {unit} or with one of {", ".join(factors)}' if unit else 'a number'
        )
        raise InvalidValueError(f'invalid {name} {shown(text)}: expected {expected}')
    return float(match[1]) * factors.get(match[2], 1.0)
