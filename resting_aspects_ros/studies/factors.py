"""Factors of a study: what varies between its points, and from where to where."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.errors import InvalidValueError, shown
from resting_aspects_ros.core.quantity_text import parse_quantity
from resting_aspects_ros.studies.setting import Setting

Array = npt.NDArray[np.float64]

MAX_LEVELS = 1000
# Values are rounded to this number of digits, so that they do not depend on rounding errors.
DIGITS = 12
EXPECTED = 'LOW:HIGH, LOW:HIGH:LEVELS or LOW:HIGH:log, such as 20mm:200mm:7'


@dataclass(frozen=True)
class Factor:
    """A quantity that varies between two values.

    name : str
        Name of a condition, or of a value of the surroundings or the action, such as
        'surroundings.angle' or 'action.speed'.
    low, high : float
        SI units; both are included.
    levels : int
        Number of values, if only some are used; 0: all values in between.
    logarithmic : bool
        Whether equal ratios instead of equal differences are equally far apart.
    unit, label : str
        Of the quantity.

    Raises
    ------
    InvalidValueError
        If the range is empty, or cannot be logarithmic.
    """

    name: str
    low: float
    high: float
    levels: int = 0
    logarithmic: bool = False
    unit: str = ''
    label: str = ''

    def __post_init__(self) -> None:
        if not self.low < self.high or f'{self.low:.{DIGITS}g}' == f'{self.high:.{DIGITS}g}':
            raise InvalidValueError(
                f'invalid range {self.low:g} to {self.high:g} of {self.name}: expected a lower '
                'and a higher value'
            )
        if self.logarithmic and self.low <= 0:
            raise InvalidValueError(
                f'invalid lowest value {self.low:g} of {self.name}: expected more than 0 for '
                'logarithmic steps'
            )
        if self.levels != 0 and not 2 <= self.levels <= MAX_LEVELS:
            raise InvalidValueError(
                f'invalid number of levels {self.levels} of {self.name}: expected 2 to '
                f'{MAX_LEVELS}'
            )

    @property
    def title(self) -> str:
        """Label with the unit in which values are shown, such as 'height (mm)'."""
        label, unit = self.label or self.name, self._shown[0]
        return f'{label} ({unit})' if unit else label

    @property
    def scale(self) -> float:
        """Shown number of an SI unit: 1000 for lengths, which are shown in mm."""
        return self._shown[1]

    @property
    def _shown(self) -> tuple[str, float]:
        return {'m': ('mm', 1000.0), 'rad': ('deg', 180 / math.pi)}.get(
            self.unit, (self.unit, 1.0)
        )

    def values(self, shares: Array) -> Array:
        """Return the values for numbers from 0 (low) to 1 (high)."""
        u = np.asarray(shares, dtype=np.float64)
        if self.logarithmic:
            found = self.low ** (1 - u) * self.high**u
        else:
            found = (1 - u) * self.low + u * self.high
        rounded = np.array([float(f'{v:.{DIGITS}g}') for v in found.ravel()])
        return np.clip(rounded.reshape(found.shape), self.low, self.high)

    def shares(self, values: Array) -> Array:
        """Return the numbers from 0 to 1 for values; the inverse of ``values``."""
        v = np.asarray(values, dtype=np.float64)
        if self.logarithmic:
            return np.asarray(np.log(v / self.low) / np.log(self.high / self.low))
        return np.asarray((v - self.low) / (self.high - self.low))

    def text(self, value: float) -> str:
        """Return a value with its unit, such as '50 mm'; lengths in mm and angles in degrees."""
        unit, scale = self._shown
        number = scale * value
        text = f'{number:.0f}' if abs(number) >= 1000 else f'{number:.3g}'
        return f'{text} {unit}'.rstrip()

    @property
    def document(self) -> dict[str, Any]:
        """The factor as plain values, as `read_factor` reads it."""
        document: dict[str, Any] = {'low': self.low, 'high': self.high}
        if self.levels:
            document['levels'] = self.levels
        if self.logarithmic:
            document['logarithmic'] = True
        return document


def parse_factor(text: str, base: Setting) -> Factor:
    """Return the factor of a text such as ``height=20mm:200mm:7``; raises InvalidValueError."""
    name, equals, values = text.partition('=')
    if not equals:
        raise InvalidValueError(f'invalid factor {shown(text)}: expected NAME={EXPECTED}')
    return read_factor(name.strip(), values.strip(), base)


def read_factor(name: str, given: Any, base: Setting) -> Factor:
    """Return a factor from its range: a text, or a mapping; raises InvalidValueError."""
    name = name.replace('-', '_')
    quantity = base.quantity(name)
    if isinstance(given, str):
        given = _range(name, given)
    known = {'low', 'high', 'levels', 'logarithmic'}
    if not isinstance(given, Mapping) or not {'low', 'high'} <= given.keys() <= known:
        raise InvalidValueError(
            f'invalid range {shown(given)} of {name}: expected {EXPECTED}, or a mapping with low, '
            'high and perhaps levels and logarithmic'
        )
    low, high = (
        quantity.check(
            f'{end} of {name}',
            parse_quantity(name, each, quantity.unit) if isinstance(each, str) else each,
        )
        for end, each in (('low', given['low']), ('high', given['high']))
    )
    levels, logarithmic = given.get('levels'), given.get('logarithmic', False)
    if type(levels) is int and not levels:
        raise InvalidValueError(
            f'invalid number of levels 0 of {name}: expected 2 to {MAX_LEVELS}, or none for all '
            'values in between'
        )
    if not isinstance(levels, int | None) or levels is True or type(logarithmic) is not bool:
        raise InvalidValueError(
            f'invalid range {shown(given)} of {name}: expected an integer for levels, and true '
            'or false for logarithmic'
        )
    return Factor(name, low, high, levels or 0, logarithmic, quantity.unit, quantity.label)


def _range(name: str, text: str) -> dict[str, Any]:
    """Return the range in a text as a mapping."""
    words = [word.strip() for word in text.split(':')]
    found: dict[str, Any] = {'logarithmic': words[-1].lower() == 'log'}
    if found['logarithmic']:
        del words[-1]
    if len(words) == 3 and words[2].isdecimal() and len(words[2]) < DIGITS:
        found['levels'] = int(words.pop())
    if len(words) != 2 or '' in words:
        raise InvalidValueError(f'invalid range {shown(text)} of {name}: expected {EXPECTED}')
    return {'low': words[0], 'high': words[1], **found}


def check_factors(factors: Sequence[Factor]) -> None:
    """Raise InvalidValueError if there is none, or if two vary the same."""
    names = [factor.name for factor in factors]
    if not names:
        raise InvalidValueError('missing factor: expected at least one, such as height=20mm:0.2')
    for name in names:
        if names.count(name) > 1:
            raise InvalidValueError(f'invalid factors: expected {name} only once')


def point_values(factors: Sequence[Factor], points: Array) -> list[dict[str, float]]:
    """Return the values of the factors at points (m, d) of the unit cube."""
    columns = [f.values(points[:, k]).tolist() for k, f in enumerate(factors)]
    names = [factor.name for factor in factors]
    return [dict(zip(names, row, strict=True)) for row in zip(*columns, strict=True)]
