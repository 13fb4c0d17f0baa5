"""Validation of the numerical parameters and of the decision by energy."""

from collections.abc import Iterator

import numpy as np
from rich.progress import track

from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.simulation.job import KERNEL, make_job
from resting_aspects_ros.statistics.poses import DecidedBy, RestingPoses, RestStatus
from validation.dropper import SEED, Dropper
from validation.paired import REFINEMENT, TWO_SIDED, paired_counts, shifts

# The standard error of a shift is then 0.0005 if 1.5 % of the drops leave or reach an aspect.
DROPS = 50_000
# Of each surface: the aims for the share of drops that end differently and for a shift.
AIMS = {'rubber_mat': (0.03, 0.002), 'steel': (0.03, 0.002), 'thrown': (0.10, 0.005)}
DECISION_DROPS = 20_000


def convergence(dropper: Dropper) -> Iterator[str]:
    """Compare the distributions of the example parts with those of refined parameters."""
    yield '## Convergence'
    yield ''
    yield (
        f'{DROPS} drops of each part on each surface, and the same drops with all numerical '
        f'parameters refined by a factor of {REFINEMENT[KERNEL]}: time steps of lasting contact, '
        'distances at which corners touch, rotations in a step. *Differ*: share of drops that end '
        'in another aspect. *Shift*: largest change of the share of an aspect, with the 95 % '
        'interval of this paired difference, which follows from the drops that end differently '
        '(McNemar).'
    )
    yield ''
    yield '| part | surface | differ | aim | aspect | shift | interval | aim |'
    yield '|---|---|---|---|---|---|---|---|'
    cases = [(part, surface) for part in dropper.parts for surface in AIMS]
    for part, surface in track(cases, 'convergence'):
        aspects = find_aspects(part)
        job = make_job(part, dropper.surfaces.get(surface), SEED)
        found = shifts(paired_counts(dropper, job, aspects, np.arange(len(aspects)), DROPS))
        column = found.largest[1]
        shift, error = found.shift[0, column], TWO_SIDED * found.error[0, column]
        differ, most = AIMS[surface]
        yield (
            f'| {part.name} | {surface} | {found.different:.4f} | {differ:g} | {column + 1} '
            f'| {shift:+.4f} | {shift - error:+.4f} to {shift + error:+.4f} | {most:g} |'
        )
    yield ''


def decision(dropper: Dropper) -> Iterator[str]:
    """Compare the aspects that the energy decides with those of continued simulation."""
    yield '## Decision by energy'
    yield ''
    yield (
        f'{DECISION_DROPS} drops of each part on `rubber_mat`. Each drop was simulated until its '
        'energy decided the aspect, and again until the part was still. *Agree*: drops that '
        'came to rest in the decided aspect. *By stillness*: drops that the energy did not '
        'decide. *Energy growth*: the largest growth of the energy of any drop, m g R, which is '
        'only possible at an impact. Aim: at least 999 of 1000 agree, and at most 1 of 1000 is '
        'unsettled.'
    )
    yield ''
    yield (
        '| part | decided | agree | by stillness | unsettled | failed | unsettled, until still '
        '| failed, until still | time decided (T) | time still (T) | energy growth |'
    )
    yield '|---|---|---|---|---|---|---|---|---|---|---|'
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
        times = [p.time_to_rest[settled].mean() / jobs[0].time_unit for p in (first, still)]
        yield (
            f'| {part.name} | {energy.sum()} | {(alike & energy).sum()} '
            f'| {(~energy & (first.status == RestStatus.SETTLED)).sum()} '
            f'| {(first.status == RestStatus.UNSETTLED).sum()} '
            f'| {(first.status == RestStatus.FAILED).sum()} '
            f'| {(still.status == RestStatus.UNSETTLED).sum()} '
            f'| {(still.status == RestStatus.FAILED).sum()} '
            f'| {times[0]:.1f} | {times[1]:.1f} | {first.energy_growth.max():.3f} |'
        )
    yield ''
