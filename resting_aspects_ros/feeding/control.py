"""What a feeder does next: pick, flip, spread, supply or wait."""

import dataclasses
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import cached_property
from operator import attrgetter

import numpy as np

from resting_aspects_ros.arrays import Array
from resting_aspects_ros.feeding.footprint import FreeShares, free_shares
from resting_aspects_ros.feeding.forecast import FeederModel, forecast
from resting_aspects_ros.feeding.steady_state import (
    CycleTimes,
    picks,
    place_values,
)

# -- What the controller knows --------------------------------------------------------------------


DEFAULT_MIN_SCORE = 0.5


@dataclass(frozen=True, eq=False)
class PartValues:
    """What a part is worth in the long run, in picks, if the feeder runs as in the forecast.

    The values solve Poisson's equation of a place on the tray, in which a pick counts 1 and each
    second costs the long-run rate. They are those at the next image, relative to the mean.

    rate : float
        Long-run rate, picks per second.
    mix : (k,) float
        Shares of the classes in an image.
    part : (k,) float
        Value of a part of each class that is not picked.
    place : float
        Value of a place without a part, which a dropped part will take.
    """

    rate: float
    mix: Array
    part: Array
    place: float


@dataclass(frozen=True, eq=False)
class ControllerModel:
    """Everything that a decision depends on, over k symmetry classes; class c has index c - 1.

    feeder : FeederModel
        Drops, flips, pickable classes, tray with the clearance, times, and maximum of picks. A
        flip is the action of its transitions.
    table : FreeShares
        The share of free parts for each number of parts on the tray.
    best_number : int
        Number of parts up to which the tray is refilled.
    spread : float or None
        Time of a vibration that moves the parts to new places but does not turn them over, s;
        None: the feeder has none.
    max_supply : int or None
        Maximum number of parts that can be supplied at once; 0: none is left; None: no limit.
    min_score : float
        Minimum score of a part that is picked.
    """

    feeder: FeederModel
    table: FreeShares
    best_number: int
    spread: float | None = None
    max_supply: int | None = None
    min_score: float = DEFAULT_MIN_SCORE

    @property
    def times(self) -> CycleTimes:
        """Times of a cycle."""
        return self.feeder.times

    @cached_property
    def values(self) -> PartValues:
        """Values of the parts with the best number of parts on the tray.

        Parts in trapped classes have the value of an empty place: it is assumed that a person
        removes them. Otherwise the long-run rate would be 0, and nothing would have a value.
        """
        feeder = self._without_traps()
        number, times = self.best_number, self.times
        state = feeder.state(self.table, number)
        rate = float(feeder.rates(self.table)[number - 1]) / 60
        if not rate > 0:
            return PartValues(0.0, state.mix, np.zeros_like(state.mix), 0.0)
        moves = feeder.moves
        supply = rate * times.supply
        h = place_values(moves, state, 1 - rate * times.robot - supply, -supply)
        place = float(moves.drop @ h) - supply
        return PartValues(rate, state.mix, moves.transitions @ h + moves.left * place, place)

    def _without_traps(self) -> FeederModel:
        trapped = self.feeder.trapped
        if not trapped.any():
            return self.feeder
        counts = np.column_stack([self.feeder.transitions, np.zeros_like(self.feeder.drop)])
        counts[trapped] = 0
        counts[trapped, -1] = 1
        return dataclasses.replace(self.feeder, transitions=counts)


def controller_model(
    feeder: FeederModel,
    *,
    spread: float | None = None,
    max_supply: int | None = None,
    min_score: float = DEFAULT_MIN_SCORE,
    number: int | None = None,
    seed: int = 1,
) -> ControllerModel:
    """Return the model of a controller, with the best number of parts of the forecast.

    It takes about a second. ``number`` replaces the best number. Raises InvalidValueError as
    `forecast`.
    """
    found = forecast(feeder, number, seed=seed)
    table = free_shares(feeder.tray, feeder.footprints, found.state.mix, seed, found.number)
    best = min(found.number, len(table.free))
    return ControllerModel(feeder, table, best, spread, max_supply, min_score)


# -- Possible actions -----------------------------------------------------------------------------


class Choice(Enum):
    """What a feeder can do after an image."""

    PICK = 'pick'
    FLIP = 'flip'
    SPREAD = 'spread'
    SUPPLY = 'supply'
    WAIT = 'wait'


@dataclass(frozen=True)
class Option:
    """What the feeder can do after the picks of an image, and what is expected of it.

    action : Choice or None
        None: only the next image is taken.
    supply : int
        Parts supplied with it.
    later : float
        Parts picked after the next image.
    picks : float
        Parts picked now and after the next image.
    seconds : float
        Time until these picks are done, s.
    rate : float
        Expected picks in the next minute, if this is chosen now and the feeder then runs as in
        the forecast; on average the forecast's parts per minute.
    """

    action: Choice | None
    supply: int
    later: float
    picks: float
    seconds: float
    rate: float


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
    if view.total and found and not any(option.later > 1e-6 for option in found):
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
    later = float(found.mean[best])
    return Option(
        action,
        int(supply[best]),
        later,
        scores + later,
        float(elapsed[best]) + later * times.robot,
        60 * values.rate + float(value[best]),
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
    moves, kept = model.feeder.moves, view.free + view.blocked
    new = supply[:, None] * moves.drop
    parts = (kept @ moves.transitions if action is Choice.FLIP else kept) + new
    later = model.table.between(parts.sum(axis=1))
    taken = parts * later
    if action not in (Choice.FLIP, Choice.SPREAD):
        now = model.table.between(np.array(float(view.total)))
        taken = view.free * np.minimum(later / np.maximum(now, 1e-12), 1.0) + new * later
    return parts, np.where(model.feeder.pickable, taken, 0.0)


# -- Decision -------------------------------------------------------------------------------------


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
    expected : mapping from Choice to Option
        For each choice that is possible.
    reason : str
    """

    choice: Choice
    picks: tuple[int, ...]
    then: Choice | None
    supply: int
    expected: Mapping[Choice, Option]
    reason: str


def advise(seen: Sequence[SeenPart], model: ControllerModel) -> Advice:
    """Return what to do with the parts that an image shows.

    All parts are picked that are free, of a pickable class, and whose score is at least the
    minimum score and worth the time of the robot. Then, or if there is none, the action of the
    feeder and the number of supplied parts with the highest value are chosen. The advice is to
    wait only if there is no part on the tray and none can be supplied.
    """
    chosen = pickable_parts(seen, model)
    view = _view(seen, (), model)
    options = {
        option.action or Choice.WAIT: option for option in possible_options(view, model, 0.0, 0)
    }
    best = max(options.values(), key=attrgetter('rate'), default=None)
    if chosen:
        scores = sum(seen[i].score for i in chosen)
        rest = _view(seen, chosen, model)
        best = max(possible_options(rest, model, scores, len(chosen)), key=attrgetter('rate'))
        options = {Choice.PICK: best, **options}
    if best is None:
        reason = 'Wait: there is no part on the tray, and none can be supplied.'
        return Advice(Choice.WAIT, (), None, 0, {}, reason)
    choice = Choice.PICK if chosen else best.action or Choice.WAIT
    then = best.action if chosen else None
    left = 'the tray is empty'
    if view.total and not chosen:
        left = f'none of the {_parts(view.total)} on the tray can be picked'
        left += f' ({_why_none(seen, model)})'
    return Advice(choice, chosen, then, best.supply, options, _reason(best, chosen, left))


def _is_free(part: SeenPart, model: ControllerModel) -> bool:
    return part.symmetry_class > 0 and part.clearance >= model.feeder.tray.clearance


def pickable_parts(seen: Sequence[SeenPart], model: ControllerModel) -> tuple[int, ...]:
    """Return the indices of the parts to be picked, those with the highest score first."""
    least = _least_score(model)
    found = [
        i
        for i, part in enumerate(seen)
        if _is_free(part, model)
        and model.feeder.pickable[part.symmetry_class - 1]
        and part.score >= least
    ]
    found.sort(key=lambda i: (-seen[i].score, -seen[i].clearance))
    return tuple(found[: model.feeder.max_picks])


def _least_score(model: ControllerModel) -> float:
    return max(model.min_score, model.values.rate * model.times.robot)


def _why_none(seen: Sequence[SeenPart], model: ControllerModel) -> str:
    """Return why none of the parts can be picked: the first reason for each of them."""
    found: Counter[str] = Counter()
    for part in seen:
        if part.symmetry_class == 0:
            found['not recognised'] += 1
        elif not model.feeder.pickable[part.symmetry_class - 1]:
            found['in another class'] += 1
        elif part.score < _least_score(model):
            found[f'with a score below {_least_score(model):.2g}'] += 1
        else:
            found['without room for the gripper'] += 1
    return ', '.join(f'{count} {text}' for text, count in found.items())


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


def _reason(best: Option, chosen: Sequence[int], left: str) -> str:
    """Return the reason in words; ``left`` states why no part is picked."""
    more = f'{best.later:.1f}'
    supplied = f' and supply {_parts(best.supply)}' if best.supply else ''
    if not chosen:
        verb = f'Supply {_parts(best.supply)}'
        if best.action in (Choice.FLIP, Choice.SPREAD):
            verb = best.action.value.capitalize() + supplied
        return f'{verb}: {left}, and {more} are expected to be pickable afterwards.'
    picked = f'Pick {_parts(len(chosen))}'
    if best.action is None:
        return f'{picked} and take another image; {more} more are expected to be free then.'
    noun = f'the supply of {_parts(best.supply)}' if best.supply else ''
    if best.action is not Choice.SUPPLY:
        noun = f'a {best.action.value}' + (f' with {noun}' if noun else '')
    return f'{picked}; {noun} is expected to bring {more} more picks.'


def _parts(number: int) -> str:
    return '1 part' if number == 1 else f'{number} parts'
