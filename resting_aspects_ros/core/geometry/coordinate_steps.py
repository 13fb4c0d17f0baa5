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
    return np.array([_step(x, column) for x, column in zip(vertices.T, columns, strict=True)])


def _step(values: Array, words: Iterable[bytes]) -> float:
    largest = float(np.abs(values).max())
    written = _written_step(words, largest)
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
    large = [word.lower() for word, x in values.items() if 10.0**decade <= x <= largest]
    design = len(values) <= DESIGN_VALUES and not any(set(word) & set(b'.e') for word in large)
    if design or not large:
        return 0.0
    last = min(_last_digit(word) for word in large)
    return float(10.0 ** min(last, decade - MIN_DIGITS + 1))


def _last_digit(word: bytes) -> int:
    """Return the decimal exponent of the last digit of a number: -2 for 1.25."""
    mantissa, _, exponent = word.partition(b'e')
    return int(exponent or 0) - len(mantissa.partition(b'.')[2])
