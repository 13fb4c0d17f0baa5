"""The best action in each aspect, from the results of several actions."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from resting_aspects_ros.api.counted_actions import CountedActions, wanted_mask
from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.reorientation.plan import Plan, best_plan
from resting_aspects_ros.report.document import plain


@dataclasses.dataclass(frozen=True, eq=False)
class PlanResult:
    """The best action in each aspect, for the least expected time to wanted aspects.

    Attributes
    ----------
    names : tuple of str
        Names of the actions, to which the indices of ``plan`` refer.
    wanted : tuple of int
        Ids of the wanted aspects.
    plan : Plan
    """

    names: tuple[str, ...]
    wanted: tuple[int, ...]
    plan: Plan

    def document(self) -> Mapping[str, object]:
        """Return a plan as plain JSON types: an action and a time, s, for each aspect by id.

        The action is null in wanted aspects and where none leads to them with certainty; the time
        is then 0 or null.
        """
        actions = [self.names[k] if k >= 0 else None for k in self.plan.action.tolist()]
        return {
            'wanted': list(self.wanted),
            'action': actions,
            'expected_time': plain(self.plan.time),
        }


def plan_reorientation(results: Sequence[CountedActions], wanted: Sequence[int]) -> PlanResult:
    """Return which action to take in which aspect, for the least expected time to wanted aspects.

    A part that leaves the aspects is replaced by a dropped part, which takes no time. If whole
    symmetry classes are wanted, the plan is that of the transitions by class.

    Parameters
    ----------
    results : sequence of CountedActions
        Results by aspect of different actions on the same part under the same conditions.
    wanted : sequence of int
        Ids of aspects.

    Raises
    ------
    InvalidValueError
        If there is no result, the parts differ, two actions have the same name, or an id is not
        known.
    """
    if not results:
        raise InvalidValueError('invalid results: expected at least one')
    first = results[0].matrix.aspects
    for each in results:
        if each.matrix.aspects.part_sha256 != first.part_sha256:
            raise InvalidValueError(
                f'invalid result of part {each.run.part}: expected {results[0].run.part}'
            )
    names = tuple(each.action.name for each in results)
    if len(set(names)) < len(names):
        raise InvalidValueError(f'invalid actions {", ".join(names)}: expected different names')
    mask = wanted_mask(wanted, len(first))
    times = np.array([each.action.time for each in results])
    classes = [[aspect.id - 1 for aspect in members] for members in first.classes()]
    if all(mask[members].all() or not mask[members].any() for members in classes):
        # The aspects of a class have the same plan, which their common counts determine best.
        chains = np.stack([each.by_class().chain for each in results])
        found = best_plan(chains, times, np.array([mask[members[0]] for members in classes]))
        number = np.empty(len(first), dtype=np.int64)
        for k, members in enumerate(classes):
            number[members] = k
        plan = Plan(found.action[number], found.time[number])
    else:
        plan = best_plan(np.stack([each.chain for each in results]), times, mask)
    return PlanResult(names, tuple(sorted(set(wanted))), plan)
