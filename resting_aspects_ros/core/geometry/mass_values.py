"""Mass properties that somebody gives: what is allowed for a mass, a point, an inertia."""

import reprlib
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.errors import InvalidValueError

Array = npt.NDArray[np.float64]

# Given inertias are often rounded to three digits; what rounding can do is not an error.
ROUNDING = 1e-3
# Nothing physical is larger, and no product of such numbers overflows.
LARGEST = 1e30


def number(value: Any, what: str) -> float:
    """Return the value as a number above 0, or raise InvalidValueError."""
    found = _floats(value)
    if found is None or found.shape != () or not 1 / LARGEST <= found <= LARGEST:
        raise InvalidValueError(
            f'{what} is {reprlib.repr(value)}: allowed is a finite number '
            f'above 0 ({1 / LARGEST:.0e} to {LARGEST:.0e})'
        )
    return float(found)


def point(value: Any, what: str) -> Array:
    """Return the value as a (3,) array of finite numbers, or raise InvalidValueError."""
    found = _floats(value)
    if found is None or found.shape != (3,) or not (np.abs(found) <= LARGEST).all():
        raise InvalidValueError(
            f'{what} is {reprlib.repr(value)}: allowed are three finite numbers'
        )
    return found


def inertia_matrix(value: Any, what: str) -> Array:
    """Return the value as an inertia, (3, 3), that some solid can have.

    Parameters
    ----------
    value : (6,) or (3, 3) array_like
        kg m^2; six numbers are ixx ixy ixz iyy iyz izz, with products of inertia as in the matrix
        (negative integrals of x y, as in URDF and ROS).

    Raises
    ------
    InvalidValueError
        Not of that shape, not finite, not symmetric, not positive definite, or with a principal
        moment larger than the sum of the other two.
    """
    found = _floats(value)
    if found is not None and found.shape == (6,):
        found = found[[[0, 1, 2], [1, 3, 4], [2, 4, 5]]]
    if found is None or found.shape != (3, 3) or not (np.abs(found) <= LARGEST).all():
        raise InvalidValueError(
            f'{what} is {reprlib.repr(value)}: allowed are six finite '
            'numbers (ixx ixy ixz iyy iyz izz, kg m^2) or a 3 x 3 matrix'
        )
    if np.abs(found - found.T).max() > ROUNDING * np.abs(found).max():
        raise InvalidValueError(f'{what} is {found.tolist()}: it must be symmetric')
    found = np.asarray((found + found.T) / 2)
    moments = np.linalg.eigvalsh(found / (np.abs(found).max() or 1.0))
    if not moments[0] > 1e-14 * moments[2]:
        raise InvalidValueError(
            f'{what} is {found.tolist()}: all principal moments must be '
            f'above 0, and they are as {_ratios(moments)}'
        )
    if moments[2] > (moments[0] + moments[1]) * (1 + ROUNDING):
        raise InvalidValueError(
            f'{what} is {found.tolist()}: no principal moment of a solid can '
            'be larger than the sum of the other two, and they are as '
            f'{_ratios(moments)}'
        )
    return found


def _ratios(moments: Array) -> str:
    largest = np.abs(moments).max() or 1.0
    return ' : '.join(f'{moment / largest:.4g}' for moment in moments)


def _floats(value: Any) -> Array | None:
    """Return the numbers in a value; None if there is anything else in it (text, bool, None)."""
    if isinstance(value, np.ndarray):
        return value.astype(np.float64) if value.dtype.kind in 'iuf' else None
    if isinstance(value, Sequence) and not isinstance(value, str | bytes):
        parts = [_floats(part) for part in value]
        found = [part for part in parts if part is not None]
        if len(found) < len(parts) or len({part.shape for part in found}) > 1:
            return None
        return np.array(found, dtype=np.float64)
    if isinstance(value, bool) or not isinstance(value, int | float | np.number):
        return None
    try:
        return np.array(float(value))
    except OverflowError:
        return np.array(np.inf)
