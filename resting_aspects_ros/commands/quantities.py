"""Numbers with a unit, as a person types them."""

import re

from resting_aspects_ros.core.errors import InvalidValueError, shown

# Factors to SI, by the unit that a quantity has inside.
_FACTORS: dict[str, dict[str, float]] = {
    'm': {'m': 1.0, 'um': 1e-6, 'mm': 1e-3, 'cm': 1e-2, 'in': 0.0254, 'ft': 0.3048},
    'm/s': {'m/s': 1.0, 'mm/s': 1e-3, 'cm/s': 1e-2},
    'm/s2': {'m/s2': 1.0, 'm/s^2': 1.0, 'mm/s2': 1e-3, 'mm/s^2': 1e-3},
    'rad/s': {'rad/s': 1.0, 'deg/s': 0.017453292519943295, 'rpm': 0.10471975511965977},
    '': {},
}
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
