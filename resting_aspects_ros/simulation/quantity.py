"""Numbers with a unit, a label and bounds, declared once as the metadata of dataclass fields."""

import dataclasses
import math
from dataclasses import dataclass, field
from typing import Any

from resting_aspects_ros.core.errors import InvalidValueError, shown


@dataclass(frozen=True)
class Quantity:
    """A number with a unit and bounds.

    label : str
        Readable name, such as 'horizontal speed spread'.
    above : bool
        Whether the lower bound itself is excluded. The upper bound is always included.
    at_release : bool
        Whether it describes the release of a part, so that it has no effect on a part at rest.
    """

    label: str
    unit: str
    text: str
    low: float = 0.0
    high: float = math.inf
    above: bool = False
    at_release: bool = False

    def allowed(self) -> str:
        """Return the allowed range as text, such as '0 to 10000 rad/s'."""
        unit = f' {self.unit}' if self.unit else ''
        if self.unit == 'rad' and math.isfinite(self.high):
            unit += f' ({math.degrees(self.low):.4g} to {math.degrees(self.high):.4g} deg)'
        lower = f'more than {self.low:g} and at most' if self.above else f'{self.low:g} to'
        return f'{lower} {self.high:g}{unit}'

    def check(self, name: str, value: Any) -> float:
        """Return the value as a float; raises InvalidValueError if it is out of bounds."""
        number = isinstance(value, int | float) and not isinstance(value, bool)
        # The comparison precedes the conversion, because an integer can be too large for a float.
        within = number and self.low <= value <= self.high and math.isfinite(value)
        if within and (value > self.low or not self.above):
            return float(value)
        raise InvalidValueError(f'invalid {name} {shown(value)}: expected {self.allowed()}')


def quantity(label: str, unit: str, text: str, *, default: Any = ..., **options: Any) -> Any:
    """Return a dataclass field with a Quantity; ``...`` stands for a field without a default."""
    given = {} if default is ... else {'default': default}
    return field(metadata={'quantity': Quantity(label, unit, text, **options)}, **given)


def quantities_of(declared: Any) -> dict[str, Quantity]:
    """Return the quantities of a dataclass by the names of their fields, in their order."""
    return {
        f.name: f.metadata['quantity']
        for f in dataclasses.fields(declared)
        if 'quantity' in f.metadata
    }


def check_quantities(values: Any) -> None:
    """Replace the quantities of a frozen dataclass by floats; raises InvalidValueError."""
    for name, each in quantities_of(values).items():
        object.__setattr__(values, name, each.check(name, getattr(values, name)))
