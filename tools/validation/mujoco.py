"""Validation of the kernel against MuJoCo, an engine with another law of contact."""

import dataclasses
from collections.abc import Iterator

import numpy as np
from rich.progress import track

from resting_aspects_ros.arrays import Array
from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.simulation.conditions import BULLET, KERNEL
from resting_aspects_ros.simulation.job import make_job
from resting_aspects_ros.system import available_cores
from validation.document import paragraphs
from validation.dropper import SEED, Dropper
from validation.engines import counted, difference
from validation.mujoco_drops import ball_after_impact, mujoco_loop
from validation.paired import OUTSIDE, Counts, class_indices

DROPS = 2000
# MuJoCo's contacts last PENETRATION_TIME / FINER, with as many more time steps.
FINER = 8
# Friction and restitution of a ball, and the slips with which it strikes the plane.
BALL, SLIPS = (0.3, 0.25), (0.3, 3.0)
# Parts with flat sides only, which need no rolling friction.
CASES = (
    ('t_prism', 'steel'),
    ('t_prism', 'rubber_mat'),
    ('u_bracket', 'rubber_mat'),
    ('l_bracket', 'rubber_mat'),
    ('box_10x20x30', 'rubber_mat'),
)


def mujoco(dropper: Dropper) -> Iterator[str]:
    """Compare the kernel with MuJoCo."""
    yield from paragraphs(
        '## An independent simulation: MuJoCo',
        f'{DROPS} drops of each part in MuJoCo, and ten times as many in the kernel; no code is '
        'shared. In MuJoCo, corners touch the plane with damped springs that have the restitution '
        'of the surface. *p*: probability of at least this chi-square of the counts by symmetry '
        'class if both engines have the same probabilities. *Difference*: the largest one of a '
        'share of a class, MuJoCo minus kernel, with its 95 % interval.',
    )
    friction, restitution = BALL
    sticks, slips = (ball_after_impact(slip, friction, restitution, FINER) for slip in SLIPS)
    yield from paragraphs(
        'The engines do not have the same law. MuJoCo solves a convex problem in place of '
        "Coulomb's friction, so that a contact that slips also bounces more. With restitution "
        f'{restitution:g} and friction {friction:g}, a ball that strikes the plane at speed '
        f'1 leaves with {sticks:.2f} if its slip of {SLIPS[0]:g} ends in the impact, and with '
        f'{slips:.2f} if it slips at {SLIPS[1]:g}; in the kernel, as by the closed form, with '
        f'{restitution:g} in both cases. The differences below therefore show what another law of '
        'contact changes.'
    )
    yield '| part | surface | chi-square | p | difference | interval | not at rest |'
    yield '|---|---|---|---|---|---|---|'
    parts = {part.name: part for part in dropper.parts}
    for name, surface in track(CASES, 'MuJoCo'):
        part = parts[name]
        aspects = find_aspects(part)
        job = make_job(part, dropper.surfaces.get(surface), SEED, engine=KERNEL)
        kernel = counted(dropper, job, part, 10 * DROPS)[:, : -len(OUTSIDE)]
        finer = dataclasses.replace(job, seed=SEED + 1, engine=BULLET, refinement=FINER)
        down = mujoco_loop(available_cores(), finer, 0, DROPS)
        cells = difference(kernel, _by_class(aspects, down))
        yield f'| {name} | {surface} | {cells} | {DROPS - len(down)} |'
    yield ''


def _by_class(aspects: AspectSet, down: Array) -> Counts:
    """Return counts (1, c) of the symmetry classes."""
    ids, _ = aspects.locate(down)
    found, labels = np.bincount(ids, minlength=len(aspects) + 1)[1:], class_indices(aspects)
    return np.bincount(labels, found, labels.max() + 1).astype(np.int64)[np.newaxis]
