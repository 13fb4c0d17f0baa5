"""How simulated shares answer to conditions, and what a fit to measurements makes of that."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Fit:
    """A least-squares fit of the values of conditions, linear about those that were simulated.

    step : (v,) float
        From the simulated values to the best ones, in the units of the slopes.
    left_out : (m,) float
        Deviation, simulated less measured, of each case with the values that fit all others best.
    spread : (v,) float
        Standard errors of the best values.
    """

    step: Array
    left_out: Array
    spread: Array


def fit(residuals: Array, slopes: Array, deviations: Array) -> Fit:
    """Fit, with all cases and with each left out.

    Without a case i the residual there is r_i / (1 - h_ii), with the hat matrix h of the weighted
    fit of all (Cook and Weisberg 1982), after the step that the fit of all makes.

    Parameters
    ----------
    residuals : (m,) float
        Simulated less measured.
    slopes : (m, v) float
        Derivatives of the simulated shares by the values.
    deviations : (m,) float
        Standard deviations of the measurements: the weights.
    """
    design, given = slopes / deviations[:, None], residuals / deviations
    inverse = np.linalg.pinv(design)
    step = -inverse @ given
    after = residuals + slopes @ step
    leverage = np.einsum('mv,vm->m', design, inverse)
    spread = np.sqrt(np.diag(inverse @ inverse.T))
    return Fit(step, after / (1 - leverage), spread)
