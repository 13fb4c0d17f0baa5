"""Numbers with a unit, a label and bounds, declared once as the metadata of dataclass fields.

The dataclasses are made from mappings of names to values, such as those of YAML files.
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from resting_aspects_ros.core.errors import InvalidValueError, did_you_mean, shown

T = TypeVar('T')
MAX_NAME = 64


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
        plain = f'a plain number in {self.unit}, ' if isinstance(value, str) and self.unit else ''
        raise InvalidValueError(f'invalid {name} {shown(value)}: expected {plain}{self.allowed()}')


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


def check_name(what: str, name: Any) -> str:
    """Return the name of an entry of a YAML file, such as 'a surface'; InvalidValueError."""
    if isinstance(name, str) and name.isidentifier() and len(name) <= MAX_NAME:
        return name
    raise InvalidValueError(
        f'invalid name {shown(name)} of {what}: expected at most {MAX_NAME} letters, digits and '
        '_, without spaces, a letter first, such as my_table'
    )


def described_kind(
    what: str, document: Any, kinds: Mapping[str, Any]
) -> tuple[str, dict[str, Any], str]:
    """Return the kind, the values and the source of an entry of a YAML file.

    ``what`` is what the entry describes, such as 'action'. Raises InvalidValueError.
    """
    if not isinstance(document, Mapping) or 'kind' not in document:
        raise InvalidValueError(
            f'invalid {what} {shown(document)}: expected a mapping with the key kind'
        )
    values = {key if isinstance(key, str) else shown(key): document[key] for key in document}
    kind, source = values.pop('kind'), values.pop('source', '')
    _check_kind(kinds, what, kind)
    if not isinstance(source, str):
        raise InvalidValueError(f'invalid source {shown(source)}: expected text')
    return kind, values, source


def made_from(
    kinds: Mapping[str, type[T]],
    what: str,
    kind: str,
    values: Mapping[str, Any],
    others: Sequence[str] = (),
) -> T:
    """Return the dataclass of a kind with these values; values left out have their defaults.

    ``others`` are names beside those of its fields that an error lists. Raises InvalidValueError.
    """
    _check_kind(kinds, what, kind)
    made: Any = kinds[kind]
    fields = [each for each in dataclasses.fields(made) if each.init and each.repr]
    names = [*(each.name for each in fields), *others]
    for name in values:
        if name not in names:
            raise InvalidValueError(
                f'invalid value {shown(name)} of a {kind}: expected one of {", ".join(names)}'
                f'{did_you_mean(name, names)}'
            )
    for each in fields:
        if each.default is dataclasses.MISSING and each.name not in values:
            raise InvalidValueError(f'missing {each.name} of a {kind}')
        text = values.get(each.name, '')
        if 'quantity' not in each.metadata and not isinstance(text, str | Path):
            raise InvalidValueError(f'invalid {each.name} {shown(text)}: expected text')
    result: T = made(**values)
    return result


def _check_kind(kinds: Mapping[str, Any], what: str, kind: Any) -> None:
    if not isinstance(kind, str) or kind not in kinds:
        raise InvalidValueError(
            f'invalid kind of {what} {shown(kind)}: expected one of {", ".join(kinds)}'
            f'{did_you_mean(kind, kinds) if isinstance(kind, str) else ""}'
        )
