"""Surroundings in words."""

import math
from collections.abc import Iterable, Mapping

from resting_aspects_ros.simulation.quantity import Quantity


def group_text(
    name: str,
    values: Mapping[str, float],
    quantities: Mapping[str, Quantity],
    texts: Iterable[str] = (),
) -> str:
    """Return a name and its values: 'chute (roll 45 deg, pitch 0 deg)'.

    ``texts`` are shown before the values.
    """
    words = [
        f'{quantities[key].label} {value_text(value, quantities[key].unit)}'
        for key, value in values.items()
    ]
    inner = ', '.join([*texts, *words])
    label = name.replace('_', ' ')
    return f'{label} ({inner})' if inner else label


def value_text(value: float, unit: str) -> str:
    """Return a value of SI unit ``unit`` as people read it: angles in degrees, lengths in mm."""
    if unit == 'rad':
        return f'{math.degrees(value):.6g} deg'
    if unit == 'm':
        return f'{1000 * value:.6g} mm'
    return f'{value:g} {unit}'.rstrip()
