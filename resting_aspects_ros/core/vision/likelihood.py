"""How probable the residuals of a fit are, with a known outline and with an unknown one.

The residuals are the distances between the boundaries after a fit, in both directions; q is their
mean square. Errors of a camera are correlated along the boundary, so that only n = perimeter /
correlation of them count as independent. With the standard deviation s

    log likelihood = -n q / (2 s^2) - n log(s / s0),    s0: that of `OutlineNoise`.

Known outline: s is s0, uncertain by the factor UNCERTAIN, and at most MAX_NOISE s0. x and y are
integrated out in equal ways for all; the yaw gives the factor (number of equal solutions) x (width
of the maximum over yaw) / 2 pi.

Unknown outline: the boundary deviates from the most similar known outline by any amount, so s is
uniform on a logarithmic scale from MIN_UNKNOWN s0 to half the size of the polygon. An outline is
therefore refused at a root mean square of about 1.7 s0.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.errors import InvalidValueError, shown
from resting_aspects_ros.core.rotations import Array
from resting_aspects_ros.core.vision.fitting import Fit, Shape

# Standard deviations of the noise that are possible for a known outline: log-normal around the
# given one with this factor, within these multiples of it.
UNCERTAIN, MIN_NOISE, MAX_NOISE = 2.0, 0.25, 1.5
# The least deviation of an unknown outline, as a multiple of the noise.
MIN_UNKNOWN = 2.0


@dataclass(frozen=True)
class OutlineNoise:
    """Errors of the boundary of an observed polygon.

    sd : float
        Standard deviation normal to the boundary, m: noise, resolution, calibration, lighting.
    correlation : float
        Distance along the boundary after which errors are independent, m: the integral of their
        autocorrelation from minus to plus infinity.
    """

    sd: float = 1e-4
    correlation: float = 1e-3

    def __post_init__(self) -> None:
        values = {'standard deviation': self.sd, 'correlation length': self.correlation}
        for name, value in values.items():
            if not 1e-7 <= value <= 0.1:
                raise InvalidValueError(
                    f'invalid {name} of the noise {shown(value)} m: expected 1e-7 to 0.1 m'
                )


def known_likelihood(
    one: Fit, model: Shape, order: int, noise: OutlineNoise, count: float
) -> float:
    """Return the log likelihood of a known outline, the noise and the yaw integrated out."""
    factors = np.geomspace(MIN_NOISE, MAX_NOISE, 10)
    weights = -0.5 * (np.log(factors) / np.log(UNCERTAIN)) ** 2
    return _integrated(one, model, order, noise.sd * factors, weights, noise, count)


def unknown_likelihood(
    one: Fit, model: Shape, noise: OutlineNoise, count: float, size: float
) -> float:
    """Return the log likelihood of an unknown outline, whose most similar known one is given."""
    largest = max(size / 2, 2 * MIN_UNKNOWN * noise.sd)
    levels = np.geomspace(MIN_UNKNOWN * noise.sd, largest, 40)
    return _integrated(one, model, 1, levels, np.zeros(40), noise, count)


def _integrated(
    one: Fit,
    model: Shape,
    order: int,
    levels: Array,
    weights: Array,
    noise: OutlineNoise,
    count: float,
) -> float:
    """Return the log of the mean likelihood over standard deviations, m, with log weights."""
    likelihood = -count * one.square / (2 * levels**2) - count * np.log(levels / noise.sd)
    least = (model.boundary.radius * 1e-3) ** 2
    width = levels * np.sqrt(2 * np.pi / (count * max(one.stiffness, least)))
    yaw = np.log(np.minimum(max(order, 1) * width / (2 * np.pi), 1.0)) if order else 0.0
    return log_sum(likelihood + yaw + weights) - log_sum(weights)


def log_sum(logs: npt.ArrayLike) -> float:
    """Return the logarithm of a sum, from the logarithms of its terms."""
    given = np.asarray(logs)
    return float(given.max() + np.log(np.exp(given - given.max()).sum()))
