"""Linear equations of Markov chains, solved by state reduction.

States are eliminated one after the other, without subtraction (Grassmann, Taksar and Heyman 1985,
Operations Research 33:1107). So the results are as accurate for transitions that occur once in a
million actions as for frequent ones, for which I - T would lose most of its digits.
"""

import numpy as np

from resting_aspects_ros.core.statistics.intervals import Array


def stationary_shares(chain: Array) -> Array:
    """Return the stationary shares (..., n), x = x T, of irreducible chains T (..., n, n)."""
    p = chain.copy()
    n = p.shape[-1]
    for m in reversed(range(1, n)):
        p[..., :m, m] /= p[..., m, :m].sum(axis=-1)[..., None]
        p[..., :m, :m] += p[..., :m, m, None] * p[..., m, None, :m]
    shares = np.zeros(p.shape[:-1])
    shares[..., 0] = 1.0
    for m in range(1, n):
        shares[..., m] = (shares[..., :m] * p[..., :m, m]).sum(axis=-1)
        # Normalised at each step, because the ratio of two shares can exceed the range of floats.
        shares /= shares.sum(axis=-1, keepdims=True)
    return np.asarray(shares)


def expected_total(inside: Array, exits: Array, gain: Array) -> Array:
    """Return the expected sum (n,) of the gains until a part exits, from each of n states.

    State reduction solves these equations too (Dayar and Akar 2005, SIAM Journal on Matrix
    Analysis and Applications 27:396).

    Parameters
    ----------
    inside : (n, n) float
        Probabilities from row to column. The diagonal is not used: it is the rest of each row.
    exits : (n,) float
        Probability to exit from each state. Every state must have a way to an exit.
    gain : (n,) float
        Gain of each step from a state; 0 or more.
    """
    p, out, total = inside.copy(), exits.copy(), gain.copy()
    for m in reversed(range(len(p))):
        moves = p[m, :m].sum() + out[m]
        p[m, :m] /= moves
        out[m] /= moves
        total[m] /= moves
        to_m = p[:m, m]
        p[:m, :m] += np.outer(to_m, p[m, :m])
        out[:m] += to_m * out[m]
        total[:m] += to_m * total[m]
    for m in range(len(p)):
        total[m] += p[m, :m] @ total[:m]
    return np.asarray(total)
