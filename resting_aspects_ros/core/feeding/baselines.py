"""Rules of today that decide what a feeder does next, for comparison with `decision.advise`.

All of them pick what can be picked, and then flip: at once, or only if the next image shows that
no part can be picked. They differ in the number of parts that are supplied with a flip.
"""

from collections.abc import Callable, Sequence

from resting_aspects_ros.core.feeding.controller_model import ControllerModel
from resting_aspects_ros.core.feeding.decision import Advice, Choice, SeenPart, pickable_parts

Controller = Callable[[Sequence[SeenPart]], Advice]
# Parts to be supplied, from the parts on the tray.
SupplyRule = Callable[[int], int]


def flip_and_refill(model: ControllerModel, *, look: bool = False) -> Controller:
    """Return the rule that refills the tray to the best number of parts with each flip.

    It is the cycle of the forecast. With ``look``, a flip follows only if an image shows that no
    part can be picked.
    """
    return _flip_with(lambda number: model.best_number - number, model, look)


def supply_below(model: ControllerModel, number: int, *, look: bool = False) -> Controller:
    """Return the rule that refills to the best number if fewer than ``number`` parts are left."""
    return _flip_with(lambda left: (model.best_number - left) * (left < number), model, look)


def hopper_rule(model: ControllerModel, most: int, *, look: bool = False) -> Controller:
    """Return Asyril's rule for the hopper: its time is t = t_max max(0, 1 - N / N_best).

    The number of supplied parts is assumed to be proportional to the time, with ``most`` parts in
    t_max; at least one part is supplied to an empty tray.
    """

    def supplied(number: int) -> int:
        return max(round(most * max(0.0, 1 - number / model.best_number)), number == 0)

    return _flip_with(supplied, model, look)


def _flip_with(rule: SupplyRule, model: ControllerModel, look: bool) -> Controller:
    def decide(seen: Sequence[SeenPart]) -> Advice:
        chosen = pickable_parts(seen, model)
        left = len(seen) - len(chosen)
        supply = max(rule(left), 0)
        if model.max_supply is not None:
            supply = min(supply, model.max_supply)
        action = Choice.FLIP if left else Choice.SUPPLY
        if chosen and (look and left):
            return Advice(Choice.PICK, chosen, None, 0, {}, 'Parts can be picked.')
        if chosen:
            action_or_none = action if left or supply else None
            return Advice(Choice.PICK, chosen, action_or_none, supply, {}, 'Parts can be picked.')
        if not left and not supply:
            return Advice(Choice.WAIT, (), None, 0, {}, 'There is no part.')
        return Advice(action, (), None, supply, {}, 'No part can be picked.')

    return decide
