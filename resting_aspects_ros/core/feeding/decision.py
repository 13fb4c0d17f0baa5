"""What a feeder does next: pick, flip, spread, supply or wait.

Each possible action is valued by the picks that it brings up to the next image, less the long-run
rate times its duration, plus the value of the parts that it leaves on the tray. The rate and these
values are those of the forecast (`PartValues`), so that the decision is one step of policy
improvement of the cycle that the forecast assumes. A ratio of picks and time would neglect what is
left on the tray.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from resting_aspects_ros.core.errors import InvalidValueError, shown
from resting_aspects_ros.core.feeding.controller_model import ControllerModel
from resting_aspects_ros.core.feeding.options import Choice, Option, View, possible_options

__all__ = [
    'Advice',
    'Choice',
    'ControllerModel',
    'Expected',
    'SeenPart',
    'advise',
    'pickable_parts',
]

_VERBS = {Choice.FLIP: 'flip', Choice.SPREAD: 'spread'}


@dataclass(frozen=True)
class SeenPart:
    """A part in an image.

    symmetry_class : int
        1 or more; 0: not recognised, or parts that touch.
    clearance : float
        Distance to the nearest other part, m; infinite if it is not known. A part for which the
        gripper has no room has a negative clearance.
    score : float
        Probability that the class is right.
    """

    symmetry_class: int
    clearance: float = float('inf')
    score: float = 1.0


@dataclass(frozen=True)
class Expected:
    """What is expected of a choice.

    picks : float
        Parts picked now and after the next image.
    seconds : float
        Time until these picks are done, s.
    rate : float
        Expected picks in the next minute, if this is chosen now and the feeder then runs as in
        the forecast; on average the forecast's parts per minute.
    """

    picks: float
    seconds: float
    rate: float


@dataclass(frozen=True, eq=False)
class Advice:
    """What to do after an image; then the next image is taken.

    choice : Choice
    picks : tuple of int
        Indices of the parts to be picked, best first; empty unless the choice is PICK.
    then : Choice or None
        What the feeder does after the picks, before the next image: FLIP, SPREAD or SUPPLY; None:
        nothing. Who ignores it loses the time of an image.
    supply : int
        Parts to be supplied with the action of the feeder, also with FLIP and SPREAD.
    expected : mapping from Choice to Expected
        For each choice that is possible.
    reason : str
    """

    choice: Choice
    picks: tuple[int, ...]
    then: Choice | None
    supply: int
    expected: Mapping[Choice, Expected]
    reason: str


def advise(seen: Sequence[SeenPart], model: ControllerModel) -> Advice:
    """Return what to do with the parts that an image shows.

    All parts are picked that are free, of a pickable class, and whose score is at least the
    minimum score and worth the time of the robot. Then, or if there is none, the action of the
    feeder and the number of supplied parts with the highest value are chosen. The advice is to
    wait only if there is no part on the tray and none can be supplied.

    Raises InvalidValueError if a part has no valid class, clearance or score.
    """
    _check(seen, model)
    chosen = pickable_parts(seen, model)
    options: dict[Choice, Option] = {}
    view = _view(seen, (), model)
    for option in possible_options(view, model, 0.0, 0):
        assert option.action is not None
        options[option.action] = option
    best = max(options.values(), key=_value, default=None)
    if chosen:
        scores = sum(seen[i].score for i in chosen)
        rest = _view(seen, chosen, model)
        best = max(possible_options(rest, model, scores, len(chosen)), key=_value)
        options = {Choice.PICK: best, **options}
    if best is None:
        reason = 'Wait: there is no part on the tray, and none can be supplied.'
        return Advice(Choice.WAIT, (), None, 0, {}, reason)
    expected = {
        choice: Expected(option.found, option.seconds, 60 * model.values.rate + option.value)
        for choice, option in options.items()
    }
    choice = Choice.PICK if chosen else best.action or Choice.WAIT
    then = best.action if chosen else None
    return Advice(choice, chosen, then, best.supply, expected, _reason(best, chosen, view))


def _value(option: Option) -> float:
    return option.value


def _check(seen: Sequence[SeenPart], model: ControllerModel) -> None:
    classes = len(model.feeder.drop)
    for part in seen:
        if not 0 <= part.symmetry_class <= classes:
            raise InvalidValueError(
                f'invalid symmetry class {shown(part.symmetry_class)}: expected 0 to {classes}'
            )
        if not 0 <= part.score <= 1:
            raise InvalidValueError(f'invalid score {shown(part.score)}: expected 0 to 1')
        if part.clearance != part.clearance:
            raise InvalidValueError('invalid clearance nan: expected a distance')


def _is_free(part: SeenPart, model: ControllerModel) -> bool:
    return part.symmetry_class > 0 and part.clearance >= model.feeder.tray.clearance


def pickable_parts(seen: Sequence[SeenPart], model: ControllerModel) -> tuple[int, ...]:
    """Return the indices of the parts to be picked, those with the highest score first."""
    least = max(model.min_score, model.values.rate * model.times.robot)
    found = [
        i
        for i, part in enumerate(seen)
        if _is_free(part, model)
        and model.feeder.pickable[part.symmetry_class - 1]
        and part.score >= least
    ]
    found.sort(key=lambda i: (-seen[i].score, -seen[i].clearance))
    return tuple(found[: model.feeder.max_picks])


def _view(seen: Sequence[SeenPart], picked: Sequence[int], model: ControllerModel) -> View:
    """Return the parts that are left after the picks."""
    mix = model.values.mix
    free, blocked = np.zeros((2, len(mix)))
    gone = set(picked)
    for i, part in enumerate(seen):
        if i in gone:
            continue
        where = free if _is_free(part, model) else blocked
        score = part.score if part.symmetry_class else 0.0
        where += (1 - score) * mix
        if score:
            where[part.symmetry_class - 1] += score
    return View(free, blocked, len(seen) - len(gone))


def _reason(best: Option, chosen: Sequence[int], view: View) -> str:
    """Return the reason in words."""
    more = f'{max(best.found - best.scores, 0.0):.1f}'
    left = 'the tray is empty'
    if view.total:
        left = f'none of the {_parts(view.total)} on the tray can be picked'
    supplied = f' and supply {_parts(best.supply)}' if best.supply else ''
    if not chosen:
        verb = f'Supply {_parts(best.supply)}'
        if best.action in _VERBS:
            verb = _VERBS[best.action].capitalize() + supplied
        return f'{verb}: {left}, and {more} are expected to be pickable afterwards.'
    picked = f'Pick {_parts(len(chosen))}'
    if best.action is None:
        return f'{picked} and take another image; {more} more are expected to be free then.'
    if best.action is Choice.SUPPLY:
        noun = f'the supply of {_parts(best.supply)}'
        return f'{picked}; {noun} is expected to bring {more} more picks.'
    noun = f'a {best.action.value}'
    if best.supply:
        noun += f' with the supply of {_parts(best.supply)}'
    return f'{picked}; {noun} is expected to bring {more} more picks.'


def _parts(number: int) -> str:
    return '1 part' if number == 1 else f'{number} parts'
