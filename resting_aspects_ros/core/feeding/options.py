"""The possible actions of a feeder after an image, and what is expected of each.

Each action is valued by the picks that it brings up to the next image, less the long-run rate
times its duration, plus the value of the parts that it leaves on the tray (`PartValues`).
"""

from dataclasses import dataclass
from enum import Enum

import numpy as np

from resting_aspects_ros.core.feeding.controller_model import ControllerModel
from resting_aspects_ros.core.feeding.cycle import picks
from resting_aspects_ros.core.statistics.intervals import Array


class Choice(Enum):
    """What a feeder can do after an image."""

    PICK = 'pick'
    FLIP = 'flip'
    SPREAD = 'spread'
    SUPPLY = 'supply'
    WAIT = 'wait'


@dataclass(frozen=True)
class Option:
    """An action of the feeder, after picks or without; `value` is in picks, see `Expected`."""

    action: Choice | None
    supply: int
    scores: float
    found: float
    seconds: float
    value: float


@dataclass(frozen=True, eq=False)
class View:
    """Expected numbers of the parts on the tray by class, (k,) each, and in total.

    ``blocked`` parts cannot be picked where they are, or are not recognised.
    """

    free: Array
    blocked: Array
    total: int


def possible_options(
    view: View, model: ControllerModel, scores: float, count: int
) -> list[Option]:
    """Return each possible action of the feeder with its best number of supplied parts.

    ``scores`` is the sum of the scores of the ``count`` picks before it.
    """
    actions: list[Choice | None] = [None] if count else []
    if view.total:
        actions += [Choice.FLIP] if model.spread is None else [Choice.FLIP, Choice.SPREAD]
    most = len(model.table.free) if model.max_supply is None else model.max_supply
    room = min(max(model.best_number - view.total, 0), most)
    found = [_option(action, view, model, scores, count, room) for action in actions]
    if view.total and found and not any(option.found > scores + 1e-6 for option in found):
        # The parts on the tray will not become pickable.
        room = min(max(len(model.table.free) - view.total, room), most)
    if room:
        found.append(_option(Choice.SUPPLY, view, model, scores, count, room))
    return found


def _option(
    action: Choice | None,
    view: View,
    model: ControllerModel,
    scores: float,
    count: int,
    room: int,
) -> Option:
    """Return an action of the feeder with the number of supplied parts that has most value."""
    times, values, max_picks = model.times, model.values, model.feeder.max_picks
    first = 1 if action is Choice.SUPPLY else 0
    supply = np.arange(first, (0 if action is None else room) + 1.0)
    parts, taken = _next_image(action, view, model, supply)
    number, share = parts.sum(axis=1), taken.sum(axis=1)
    whole = np.maximum(np.ceil(number - 1e-9), 1)
    found = picks(whole, np.minimum(share / whole, 1.0), max_picks)
    taken = taken * (found.mean / np.maximum(share, 1e-300))[:, None]
    seconds = {
        None: times.image,
        Choice.FLIP: times.feeder,
        Choice.SPREAD: (model.spread or 0.0) + times.settle + times.image,
        Choice.SUPPLY: times.settle + times.image,
    }[action]
    seconds += count * times.robot - (min(times.place, seconds) if count else 0.0)
    elapsed = seconds + times.supply * supply
    value = (
        scores
        - values.rate * (elapsed + times.feeder)
        + found.mean * (1 - values.rate * times.robot + values.place)
        + ((parts - taken) @ values.part)
        + (model.best_number - number) * values.place
        + values.rate * times.overlap * (1 - found.none)
    )
    best = int(value.argmax())
    mean = float(found.mean[best])
    return Option(
        action,
        int(supply[best]),
        scores,
        scores + mean,
        float(elapsed[best]) + mean * times.robot,
        float(value[best]),
    )


def _next_image(
    action: Choice | None, view: View, model: ControllerModel, supply: Array
) -> tuple[Array, Array]:
    """Return the parts in the next image and those of them that can be picked, (s, k) each.

    A flip and a spread give each part a new place. Otherwise, parts stay where they are: those
    that are blocked stay so, as no part that is free itself blocks them, and supplied parts block
    some of the free ones. (The footprint of a gripper can be in the way of a part whose own place
    is free, so that a pick sometimes frees another part; this is neglected.)
    """
    moves, kept = model.moves, view.free + view.blocked
    new = supply[:, None] * moves.drop
    if action is Choice.FLIP:
        parts = kept @ moves.transitions + new
        taken = parts * model.free(parts.sum(axis=1))
    elif action is Choice.SPREAD:
        parts = kept + new
        taken = parts * model.free(parts.sum(axis=1))
    else:
        parts = kept + new
        now = model.free(np.array(float(view.total)))
        later = model.free(parts.sum(axis=1))
        taken = view.free * np.minimum(later / np.maximum(now, 1e-12), 1.0) + new * later
    return parts, np.where(model.feeder.pickable, taken, 0.0)
