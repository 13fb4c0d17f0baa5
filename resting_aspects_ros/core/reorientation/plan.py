"""The best plan: the action in each aspect that brings a part to wanted aspects soonest.

This is a stochastic shortest path problem (Bertsekas and Tsitsiklis 1991, Mathematics of
Operations Research 16:580). It is solved exactly, by policy iteration.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.errors import InvalidValueError, shown
from resting_aspects_ros.core.reorientation.markov import Mask, check_rows
from resting_aspects_ros.core.reorientation.state_reduction import expected_total
from resting_aspects_ros.core.statistics.intervals import Array

Indices = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Plan:
    """The best action in each of k aspects.

    action : (k,) int
        Index of the action; -1 if the aspect is wanted, and if no choice of actions leads to a
        wanted aspect with certainty.
    time : (k,) float
        Minimum expected time until the part is in a wanted aspect, s; 0 for wanted aspects,
        infinite if no choice of actions leads there with certainty.
    """

    action: Indices
    time: Array


def best_plan(transitions: Array, times: Array, wanted: Mask) -> Plan:
    """Return the plan with the minimum expected time until a part is in a wanted aspect.

    An action that may bring the part where no wanted aspect can be reached with certainty is never
    chosen. If several actions are equally good, the plan has any of them.

    Parameters
    ----------
    transitions : (a, k, k) float
        Probabilities of each action from row to column; see markov.with_replacement. The rows of
        wanted aspects are not used.
    times : (a,) float
        Time that each action takes, s. The time to replace a part that left the aspects is not
        included.
    wanted : (k,) bool

    Raises
    ------
    InvalidValueError
        If a time is not positive and finite, or if the sum of a row is not 1.
    """
    if not ((times > 0) & (times < np.inf)).all():
        raise InvalidValueError(
            f'invalid times {shown(times.tolist())}: expected more than 0 s each, and finite'
        )
    rows = np.where(wanted[:, None], np.eye(len(wanted)), transitions)
    for each in rows:
        check_rows(each)
    action, allowed = _certain(rows > 0, wanted)
    free = np.flatnonzero(action >= 0)
    rows, allowed, policy = rows[:, free], allowed[:, free], action[free]

    def expected_time(policy: Indices) -> Array:
        chosen = rows[policy, np.arange(len(free))]
        return expected_total(chosen[:, free], chosen[:, wanted].sum(axis=1), times[policy])

    best = expected_time(policy)
    while True:
        by_action = np.where(allowed, times[:, None] + rows[..., free] @ best, np.inf)
        better = by_action.min(axis=0) < best
        changed = np.where(better, by_action.argmin(axis=0), policy)
        time = expected_time(changed)
        # Each policy is better than the one before it, so the iteration ends in spite of rounding.
        if not time.sum() < best.sum():
            break
        policy, best = changed, time
    action[free] = policy
    time = np.where(wanted, 0.0, np.inf)
    time[free] = best
    return Plan(action, time)


def _certain(steps: Mask, wanted: Mask) -> tuple[Indices, Mask]:
    """Return actions (k,) that lead to a wanted aspect with certainty, and all allowed ones.

    The actions are -1 where there are none, and for wanted aspects. An action is allowed (a, k) if
    it leaves the part in aspects from which a wanted one can be reached with certainty. The
    algorithm is that of de Alfaro (1999, CONCUR, LNCS 1664:66): aspects without an allowed way to
    a wanted one are removed until none is left to remove.

    Parameters
    ----------
    steps : (a, k, k) bool
        Whether each action can lead from row to column.
    wanted : (k,) bool
    """
    within = np.ones_like(wanted)
    while True:
        allowed: Mask = np.logical_not(steps[..., ~within].any(axis=2))
        action = np.full(len(wanted), -1)
        reached = wanted
        while True:
            leads = allowed & steps[..., reached].any(axis=2)
            new = leads.any(axis=0) & ~reached
            if not new.any():
                break
            # A step to aspects reached before it, so that the actions together reach a wanted one.
            action[new] = leads[:, new].argmax(axis=0)
            reached = reached | new
        if (reached == within).all():
            return action, allowed
        within = reached


def wanted_mask(
    wanted: Sequence[int], aspects: int, what: str = 'aspect'
) -> npt.NDArray[np.bool_]:
    """Return a mask (k,) of wanted aspects; raises InvalidValueError if an id is not known."""
    if not wanted:
        raise InvalidValueError(f'invalid wanted {what}: expected at least one')
    for k in wanted:
        if not isinstance(k, int) or not 1 <= k <= aspects:
            raise InvalidValueError(f'invalid wanted {what} {k!r}: expected 1 to {aspects}')
    return np.isin(np.arange(1, aspects + 1), list(wanted))
