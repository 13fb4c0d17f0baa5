"""Sensitivity of simulated shares to conditions, and a fit of the conditions to measurements."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Fit:
    """A least-squares fit of the values of conditions, linear about the simulated values.

    step : (v,) float
        Difference from the simulated values to the best values, in the units of the slopes.
    left_out : (m,) float
        Deviation, simulated minus measured, of each case with the values fitted to all others.
    spread : (v,) float
        Standard errors of the best values.
    """

    step: Array
    left_out: Array
    spread: Array


def fit(residuals: Array, slopes: Array, deviations: Array) -> Fit:
    """Return the fit of all cases, and the deviations with each case left out.

    If case i is left out, its residual is r_i / (1 - h_ii), with the residual r_i and the hat
    matrix h of the weighted fit of all cases (Cook and Weisberg 1982).

    Parameters
    ----------
    residuals : (m,) float
        Simulated minus measured.
    slopes : (m, v) float
        Derivatives of the simulated shares with respect to the values.
    deviations : (m,) float
        Standard deviations of the measurements, whose inverses are the weights.
    """
    design, given = slopes / deviations[:, None], residuals / deviations
    inverse = np.linalg.pinv(design)
    step = -inverse @ given
    after = residuals + slopes @ step
    leverage = np.einsum('mv,vm->m', design, inverse)
    spread = np.sqrt(np.diag(inverse @ inverse.T))
    return Fit(step, after / (1 - leverage), spread)
