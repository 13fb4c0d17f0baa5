"""Validation of given mass properties: a mass or density, a point, an inertia."""

import reprlib
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.errors import InvalidValueError

Array = npt.NDArray[np.float64]

# Given inertias are often rounded to three digits; deviations that rounding explains are accepted.
ROUNDING = 1e-3
# No physical value is larger, and products of such numbers do not overflow.
LARGEST = 1e30


def positive_number(value: Any, name: str, unit: str, label: str) -> float:
    """Return the value as a number above 0, or raise InvalidValueError."""
    found = _floats(value)
    if found is None or found.shape != () or not 1 / LARGEST <= found <= LARGEST:
        raise InvalidValueError(
            f'invalid {name} {reprlib.repr(value)} of {label}: expected a finite number above 0 '
            f'({1 / LARGEST:.0e} to {LARGEST:.0e} {unit})'
        )
    return float(found)


def point(value: Any, name: str, label: str) -> Array:
    """Return the value as a (3,) array of finite numbers, or raise InvalidValueError."""
    found = _floats(value)
    if found is None or found.shape != (3,) or not (np.abs(found) <= LARGEST).all():
        raise InvalidValueError(
            f'invalid {name} {reprlib.repr(value)} of {label}: expected three finite numbers, m'
        )
    return found


def inertia_matrix(value: Any, label: str) -> Array:
    """Return the value as an inertia matrix, (3, 3), after checking that a solid can have it.

    Parameters
    ----------
    value : (6,) or (3, 3) array_like
        kg m^2; six numbers are ixx ixy ixz iyy iyz izz, with products of inertia as in the matrix
        (negative integrals of x y, as in URDF and ROS).

    Raises
    ------
    InvalidValueError
        If the value has another shape or is not finite, not symmetric or not positive definite,
        or if one principal moment is larger than the sum of the other two.
    """
    found = _floats(value)
    if found is not None and found.shape == (6,):
        found = found[[[0, 1, 2], [1, 3, 4], [2, 4, 5]]]
    if found is None or found.shape != (3, 3) or not (np.abs(found) <= LARGEST).all():
        raise InvalidValueError(
            f'invalid inertia {reprlib.repr(value)} of {label}: expected six finite numbers '
            '(ixx ixy ixz iyy iyz izz, kg m^2) or a 3 x 3 matrix'
        )
    if np.abs(found - found.T).max() > ROUNDING * np.abs(found).max():
        raise InvalidValueError(
            f'invalid inertia {found.tolist()} of {label}: expected a symmetric matrix'
        )
    found = np.asarray((found + found.T) / 2)
    moments = np.linalg.eigvalsh(found / (np.abs(found).max() or 1.0))
    if not moments[0] > 1e-14 * moments[2]:
        raise InvalidValueError(
            f'invalid inertia {found.tolist()} of {label}: expected principal moments above 0, '
            f'their ratios are {_ratios(moments)}'
        )
    if moments[2] > (moments[0] + moments[1]) * (1 + ROUNDING):
        raise InvalidValueError(
            f'invalid inertia {found.tolist()} of {label}: expected no principal moment above the '
            f'sum of the other two, their ratios are {_ratios(moments)}'
        )
    return found


def _ratios(moments: Array) -> str:
    largest = np.abs(moments).max() or 1.0
    return ' : '.join(f'{moment / largest:.4g}' for moment in moments)


def _floats(value: Any) -> Array | None:
    """Return the numbers in a value; None if it contains anything else (text, bool, None)."""
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
