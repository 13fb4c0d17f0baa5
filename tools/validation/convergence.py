"""Validation of the numerical parameters and of the decision by energy."""

from collections.abc import Iterator

import numpy as np
from rich.progress import track

import resting_aspects_ros as ra
from resting_aspects_ros.api.conditions import aspects_in, shipped_actions, with_surroundings
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.simulation.conditions import KERNEL
from resting_aspects_ros.simulation.job import make_job
from resting_aspects_ros.statistics.poses import DecidedBy, RestingPoses, RestStatus
from validation.document import paragraphs, table
from validation.dropper import SEED, Dropper
from validation.paired import (
    REFINEMENT,
    TWO_SIDED,
    Shifts,
    action_job,
    class_indices,
    paired_counts,
    shifts,
)

# The standard error of a shift is then 0.0005 if 1.5 % of the drops leave or reach an aspect.
DROPS = 50_000
# Of each surface: the aims for the share of drops that end differently and for a shift.
AIMS = {'rubber_mat': (0.03, 0.002), 'steel': (0.03, 0.002), 'thrown': (0.10, 0.005)}
DECISION_DROPS = 20_000
# Drops in each of the surroundings, and the aim for a shift in them or by an action.
SURROUNDINGS_DROPS, AIM = 20_000, 0.01
PARTS = ('l_bracket', 'box_10x20x30', 't_prism')
SURROUNDINGS = ('slope', 'v_groove', 'l_chute')
# Actions from each symmetry class in each simulation.
ACTIONS = {
    ('box_10x20x30', 'toss'): 20_000,
    ('l_bracket', 'toss'): 20_000,
    ('t_prism', 'toss'): 20_000,
    ('box_10x20x30', 'air_blast'): 20_000,
    ('l_bracket', 'air_blast'): 20_000,
    ('box_10x20x30', 'bowl'): 20_000,
    ('l_bracket', 'flip'): 20_000,
}


def convergence(dropper: Dropper) -> Iterator[str]:
    """Compare the distributions of the example parts with those of refined parameters."""
    yield from paragraphs(
        '## Convergence',
        f'{DROPS} drops of each part on each surface, and the same drops with all numerical '
        f'parameters refined by a factor of {REFINEMENT[KERNEL]}: time steps of lasting contact, '
        'distances at which corners touch, rotations in a step. *Differ*: share of drops that end '
        'in another aspect. *Shift*: largest change of the share of an aspect, with the 95 % '
        'interval of this paired difference, which follows from the drops that end differently '
        '(McNemar).',
    )
    rows = []
    cases = [(part, surface) for part in dropper.parts for surface in AIMS]
    for part, surface in track(cases, 'convergence'):
        aspects = find_aspects(part)
        job = make_job(part, dropper.surfaces.get(surface), SEED)
        found = shifts(paired_counts(dropper, job, aspects, np.arange(len(aspects)), DROPS))
        column = found.largest[1]
        shift, error = found.shift[0, column], TWO_SIDED * found.error[0, column]
        differ, most = AIMS[surface]
        rows.append(
            [
                part.name,
                surface,
                f'{found.different:.4f}',
                f'{differ:g}',
                f'{column + 1}',
                f'{shift:+.4f}',
                f'{shift - error:+.4f} to {shift + error:+.4f}',
                f'{most:g}',
            ]
        )
    columns = ('part', 'surface', 'differ', 'aim', 'aspect', 'shift', 'interval', 'aim')
    yield from table(columns, rows)


def convergence_elsewhere(dropper: Dropper) -> Iterator[str]:
    """Compare drops in surroundings, and actions, with those of refined parameters."""
    yield from paragraphs(
        '## Convergence in surroundings and of actions',
        f'{SURROUNDINGS_DROPS} drops in surroundings, and actions from each symmetry class, on '
        '`rubber_mat`, and again from the same states with all numerical parameters refined by a '
        f'factor of {REFINEMENT[KERNEL]}. *Differ*: share of the parts that end in another '
        'aspect, or class. *Shift*: of the share that changes most, of an aspect, or of an entry '
        'of the matrix by symmetry class, with its standard error. *Bound*: no share changes by '
        f'more than this, with a confidence of 95 %. The aim is a bound of {AIM:g}; where it is '
        'larger, the number of parts does not suffice to show the aim, or the shift exceeds it. '
        'Steps, which Bullet simulates, are among the finished comparisons.',
    )
    yield from table(
        ('part', 'in or after', 'parts', 'differ', 'shift', 'error', 'bound'),
        (
            [
                part,
                name,
                f'{n}',
                f'{found.different:.3f}',
                f'{found.shift[found.largest]:+.4f}',
                f'{found.error[found.largest]:.4f}',
                f'{found.bound:.4f}',
            ]
            for part, name, n, found in _elsewhere(dropper)
        ),
    )


def _elsewhere(dropper: Dropper) -> Iterator[tuple[str, str, int, Shifts]]:
    """Yield part, name, number of parts (from each class) and shifts of each case."""
    parts = {part.name: part for part in dropper.parts}
    cases = [(parts[p], name) for name in SURROUNDINGS for p in PARTS if p in parts]
    for k, (part, name) in enumerate(track(cases, 'surroundings')):
        conditions = with_surroundings(dropper.surfaces.get(), ra.surroundings(name))
        job = make_job(part, conditions, SEED + k)
        aspects, n = aspects_in(job.scene, find_aspects(part)), SURROUNDINGS_DROPS
        counts = paired_counts(dropper, job, aspects, np.arange(len(aspects)), n)
        yield part.name, name, n, shifts(counts)
    for (name, action), per_class in ACTIONS.items():
        if name in parts:
            part = parts[name]
            applied = shipped_actions().get(action).action
            job, before = action_job(dropper, part, applied, per_class)
            aspects = find_aspects(part)
            labels = class_indices(aspects)
            counts = paired_counts(dropper, job, aspects, labels, len(before), before)
            yield name, action, int(counts.sum(axis=(1, 2)).min()), shifts(counts)


def decision(dropper: Dropper) -> Iterator[str]:
    """Compare the aspects that the energy decides with those of continued simulation."""
    yield from paragraphs(
        '## Decision by energy',
        f'{DECISION_DROPS} drops of each part on `rubber_mat`. Each drop was simulated until its '
        'energy decided the aspect, and again until the part was still. *Agree*: drops that '
        'came to rest in the decided aspect. *By stillness*: drops that the energy did not '
        'decide. *Energy growth*: the largest growth of the energy of any drop, m g R, which is '
        'only possible at an impact. Aim: at least 999 of 1000 agree, and at most 1 of 1000 is '
        'unsettled.',
    )
    rows = []
    for part in track(dropper.parts, 'decision'):
        aspects = find_aspects(part)
        jobs = [
            make_job(part, dropper.surfaces.get(), SEED, until_still=until_still)
            for until_still in (False, True)
        ]
        first, still = (RestingPoses.join(list(dropper.poses(j, DECISION_DROPS))) for j in jobs)
        energy = first.decided_by == DecidedBy.ENERGY
        alike = aspects.classify(first.orientation) == aspects.classify(still.orientation)
        settled = still.status == RestStatus.SETTLED
        counts = [energy, alike & energy, ~energy & (first.status == RestStatus.SETTLED)]
        for poses in (first, still):
            counts += [poses.status == s for s in (RestStatus.UNSETTLED, RestStatus.FAILED)]
        times = [p.time_to_rest[settled].mean() / jobs[0].time_unit for p in (first, still)]
        rows.append(
            [
                part.name,
                *(str(each.sum()) for each in counts),
                *(f'{each:.1f}' for each in times),
                f'{first.energy_growth.max():.3f}',
            ]
        )
    columns = [
        *('part', 'decided', 'agree', 'by stillness', 'unsettled', 'failed'),
        *('unsettled, until still', 'failed, until still', 'time decided (T)', 'time still (T)'),
        'energy growth',
    ]
    yield from table(columns, rows)
