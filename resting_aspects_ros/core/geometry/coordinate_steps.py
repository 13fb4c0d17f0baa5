"""Steps in which a file stores coordinates: of float32, or of the last written digit."""

from collections.abc import Iterable, Sequence

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Words = Sequence[Sequence[bytes]]

# Rows of text whose digits are counted.
MAX_ROWS = 5_000
# Writers of text give at least this many digits, if they are needed.
MIN_DIGITS = 6
# Coordinates that are all multiples of this many steps were not rounded to steps: they are design
# values, as are integers with at most this many different values.
DESIGN_STEPS = 10
DESIGN_VALUES = 8
# Coordinates with a point are design values, too, if they have few different values for their
# number of corners, or if their last digits are only 0 and 5.
DESIGN_SHARE = 0.75
# Rounded coordinates of similar size end at the same decimal: nine of ten without zeros at the
# end, and fewer if all have the same number of digits.
ROUNDED_SHARE = 0.6
# More steps along a part do not change its aspects.
FINE_STEPS = 5_000


def coordinate_steps(vertices: Array, words: Words) -> Array:
    """Return the step (3,) of the coordinates of each axis, in their unit.

    Parameters
    ----------
    vertices : (n, 3) float64
        The vertices that are used.
    words : sequence of (3,) sequences
        The words of the coordinates of each vertex, which are numbers; empty for a binary file.
    """
    rows = words[:: max(len(words) // MAX_ROWS, 1)]
    columns = zip(*rows, strict=True) if words else ((),) * 3
    few = min(DESIGN_SHARE * len(set(map(tuple, rows))), DESIGN_VALUES)
    return np.array([_step(x, column, few) for x, column in zip(vertices.T, columns, strict=True)])


def _step(values: Array, column: Iterable[bytes], few: float) -> float:
    largest = float(np.abs(values).max())
    words = {word.lower() for word in column}
    written = _written_step(words, largest)
    rounded = _rounded_step(words, largest) if len(words) > few else 0.0
    if rounded * FINE_STEPS > np.ptp(values):
        written = max(written, rounded)
    exact = float(np.spacing(largest))
    step = max(exact, written)
    with np.errstate(over='ignore', invalid='ignore'):
        single = float(np.spacing(np.float32(largest)))
        rounding = np.abs(values.astype(np.float32) - values).max()
    if single > DESIGN_STEPS * step and rounding <= 0.51 * written:
        step = single
    if step > exact:
        counts = np.rint(values / step)
        whole = np.abs(counts * step - values).max() <= exact
        if whole and np.gcd.reduce(counts.astype(np.int64)) >= DESIGN_STEPS:
            return exact
    return step


def _written_step(words: Iterable[bytes], largest: float) -> float:
    """Return the step of the last written digit of the largest coordinates; 0 if unknown."""
    values = {word: abs(float(word)) for word in words}
    if not largest or not values:
        return 0.0
    decade = int(np.floor(np.log10(largest)))
    large = [word for word, x in values.items() if 10.0**decade <= x <= largest]
    design = len(values) <= DESIGN_VALUES and not any(set(word) & set(b'.e') for word in large)
    if design or not large:
        return 0.0
    last = min(_last_digit(word) for word in large)
    return float(10.0 ** min(last, decade - MIN_DIGITS + 1))


def _rounded_step(words: Iterable[bytes], largest: float) -> float:
    """Return the step of decimals to which most coordinates are rounded; 0 if there is none.

    Integers are design values.
    """
    digits = {word.partition(b'e')[0][-1:] for word in words}
    large = [word for word in words if 0.1 * largest <= abs(float(word)) > 0]
    if digits <= {b'0', b'5'} or not any(set(word) & set(b'.e') for word in large):
        return 0.0
    exponents = [_last_digit(word) for word in large]
    last = int(np.median(exponents))
    return float(10.0**last) if exponents.count(last) >= ROUNDED_SHARE * len(large) else 0.0


def _last_digit(word: bytes) -> int:
    """Return the decimal exponent of the last digit of a number: -2 for 1.25."""
    mantissa, _, exponent = word.partition(b'e')
    return int(exponent or 0) - len(mantissa.partition(b'.')[2])
