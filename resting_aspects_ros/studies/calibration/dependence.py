"""The dependence of the surrogates' errors: parts of similar shape deviate together.

The posterior multiplies the probabilities of the counts of all parts, as if the errors of their
surrogates were independent. But a surrogate is too simple in the same way for similar parts, so
that the product counts some information several times. Each point of the design shows how often:
its drops are taken for counts, and the conditions that they were made with must be as probable as
the posterior says. The dependence is the factor of the surrogates' variance with which they are
most probable. It is also more than 1 if errors are larger in some places than their mean.
"""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from scipy.special import logsumexp

from resting_aspects_ros.studies.calibration.likelihood import (
    likelihood_powers,
    log_density,
    surrogate_rho,
)
from resting_aspects_ros.studies.design import sobol
from resting_aspects_ros.studies.share_surrogate import ShareSurrogate

Array = npt.NDArray[np.float64]
Counts = npt.NDArray[np.int64]

VALUES = (1.0, 1.5, 2.0, 3.0, 4.5, 7.0, 10.0, 15.0, 22.0, 33.0, 50.0)
FOLDS = 8
# Conditions that those of a point are compared with, and the number of points that are tested.
PLACES = 2048
MAX_TESTED = 128


def find_dependence(
    surrogates: Sequence[ShareSurrogate], points: Array, simulated: Sequence[Counts], seed: int
) -> float:
    """Return the dependence, from the drops (m, g) of each part at points (m, d)."""
    rng = np.random.default_rng((seed, 3))
    folds = rng.permutation(len(points)) % min(FOLDS, len(points))
    tested = np.zeros(len(points), dtype=bool)
    tested[rng.permutation(len(points))[:MAX_TESTED]] = True
    places = sobol(points.shape[1], PLACES, seed)
    scores = np.zeros(len(VALUES))
    for fold in range(int(folds.max()) + 1):
        out = folds == fold
        own = [
            surrogate.without(points, table, out)
            for surrogate, table in zip(surrogates, simulated, strict=True)
        ]
        chosen = np.flatnonzero(out & tested)
        everywhere = np.concatenate([points[chosen], places])
        moments = [each.moments(everywhere) for each in own]
        shares = [mean for mean, _ in moments]
        rho = [surrogate_rho(*each) for each in moments]
        for k, number in enumerate(chosen):
            kept = np.r_[k, len(chosen) : len(everywhere)]
            counts = [table[number] for table in simulated]
            logs = np.stack(
                [
                    log_density(c, p[kept], r[kept])
                    for c, p, r in zip(counts, shares, rho, strict=True)
                ]
            )
            scores += _scores(logs, np.array([r[k] for r in rho]), counts)
    return VALUES[int(scores.argmax())]


def _scores(logs: Array, rho: Array, counts: Sequence[Counts]) -> Array:
    """Return the log posterior density of the first place for each of VALUES.

    ``logs`` (p, n) are log likelihoods of each part, and ``rho`` (p,) those of the first place.
    """
    drops = np.array([each.sum() for each in counts])
    found = []
    for value in VALUES:
        total = likelihood_powers(rho, drops, value) @ logs
        found.append(total[0] - logsumexp(total[1:]) + np.log(len(total) - 1))
    return np.array(found)
