"""Validation of the actions: time step, loss of memory, and symmetry of the transitions."""

import dataclasses
from collections.abc import Iterator

import numpy as np
from dropper import SEED, Dropper

from resting_aspects_ros.api.condition_text import shipped_actions
from resting_aspects_ros.api.plan_actions import plan_actions
from resting_aspects_ros.api.reorient import drop_for_start
from resting_aspects_ros.api.transition_counter import TransitionCounter, compare_matrices
from resting_aspects_ros.core.aspects.aspect import find_aspects
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.reorientation.transition_matrix import OUTCOMES, TransitionMatrix
from resting_aspects_ros.simulation.actions import NamedAction
from resting_aspects_ros.simulation.impulses import Kick
from resting_aspects_ros.simulation.vibration import Vibration

PARTS = ('box_10x20x30', 'l_bracket', 't_prism')
# Actions from each symmetry class, with each time step; an action that moves the surface takes 20
# to 50 times as long as others.
PER_CLASS, VIBRATED_PER_CLASS = 20_000, 2_000
DROPS = 20_000
STRONGEST = 'toss'


def reorientation(dropper: Dropper) -> Iterator[str]:
    """Show how the named actions depend on the time step, and what the strongest forgets."""
    parts = [part for part in dropper.parts if part.name in PARTS]
    yield '## Actions and the time step'
    yield ''
    yield (
        f'The named actions on {", ".join(PARTS)}, rubber_mat, with at least {PER_CLASS} actions '
        f'({VIBRATED_PER_CLASS} of a vibration) from each symmetry class and time step. Shown is '
        'the entry of the matrix by symmetry class that changes most when the time step is '
        'halved; the intervals of all entries of a matrix hold together. The aim is at most 0.01.'
    )
    yield ''
    yield '| part | action | actions | from class | to | shift | 95 % interval |'
    yield '|---|---|---|---|---|---|---|'
    strongest = {}
    for part in parts:
        for name in shipped_actions().names():
            action = shipped_actions().get(name)
            coarse, fine, step = _both_steps(dropper, part, action)
            found = compare_matrices(coarse, fine, step)
            classes = len(coarse.aspects.classes())
            to = [*(str(k + 1) for k in range(classes)), *OUTCOMES][found.column]
            yield (
                f'| {part.name} | {name} | {found.actions} | {found.row + 1} | {to} | '
                f'{found.shift:+.4f} | {found.lower:+.4f} to {found.upper:+.4f} |'
            )
            if name == STRONGEST:
                strongest[part.name] = coarse
    yield ''
    yield from _memory(dropper, parts, strongest)


def _both_steps(
    dropper: Dropper, part: Part, action: NamedAction
) -> tuple[TransitionMatrix, TransitionMatrix, float]:
    """Return the matrix with the time step of the run and with half of it, and the latter, s."""
    conditions = dropper.surfaces.get()
    per_class = VIBRATED_PER_CLASS if isinstance(action.action, Vibration) else PER_CLASS
    classes = find_aspects(part).classes()
    per_aspect = -(-per_class // min(len(members) for members in classes))
    planned = plan_actions(part, action, conditions, per_aspect=per_aspect, seed=SEED)
    empty = planned.counter.matrix
    planned.counter.make(planned.job, dropper.workers)
    fine = dataclasses.replace(planned.job, refinement=2)
    again = TransitionCounter(empty, planned.run, 0.0)
    again.make(fine, dropper.workers)
    return planned.counter.matrix, again.matrix, fine.time_step


def _memory(
    dropper: Dropper, parts: list[Part], strongest: dict[str, TransitionMatrix]
) -> Iterator[str]:
    """Compare the rows of the strongest action with each other and with a drop."""
    yield '## A strong action forgets the aspect before it'
    yield ''
    action = shipped_actions().get(STRONGEST).action
    assert isinstance(action, Kick)
    conditions = dropper.surfaces.get().changed(
        height=action.speed**2 / (2 * dropper.surfaces.get().gravity),
        speed_vertical=action.speed_spread,
        speed_horizontal=action.horizontal_spread,
        spin=action.spin,
    )
    yield (
        f'Total variation between the rows of `{STRONGEST}` by symmetry class, and between each '
        f'row and {DROPS} drops from the height {1000 * conditions.height:.0f} mm (speed^2 / 2 g) '
        'with the same spreads. The aims are 0.03 and 0.05.'
    )
    yield ''
    yield '| part | between two rows, at most | between a row and the drops, at most |'
    yield '|---|---|---|'
    for part in parts:
        drop = drop_for_start(part, conditions, DROPS, SEED, dropper.workers, shown=False)[
            0
        ].by_class()
        rows = strongest[part.name].by_class().probability
        outside = [drop.unclassified, drop.unsettled, drop.failed, 0]
        dropped = np.array([*drop.counts.tolist(), *outside]) / drop.drops
        between = np.abs(rows[:, None] - rows).sum(axis=2).max() / 2
        apart = np.abs(rows - dropped).sum(axis=1).max() / 2
        yield f'| {part.name} | {between:.4f} | {apart:.4f} |'
    yield ''
