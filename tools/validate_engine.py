"""Validation of the time step and of the decision by energy."""

from collections.abc import Iterator

import numpy as np
from dropper import SEED, Dropper
from rich.progress import track

from resting_aspects_ros.core.aspects.aspect import find_aspects
from resting_aspects_ros.core.poses import DecidedBy, RestingPoses, RestStatus
from resting_aspects_ros.core.statistics.comparison import Comparison, compare
from resting_aspects_ros.simulation.plan import make_job

# Standard error of the difference of two shares of 0.3: 0.003.
STEP_DROPS = 50_000
DECISION_DROPS = 3000


def time_step(dropper: Dropper) -> Iterator[str]:
    """Compare the distributions of the example parts with those of half the time step."""
    yield '## Time step'
    yield ''
    yield (
        f'{STEP_DROPS} drops of each part on `rubber_mat`, simulated with the time step of the '
        'suite and again with half the step, from the same initial states. *Shift*: largest '
        'change of the probability of an aspect, with a simultaneous 95 % interval over all '
        'aspects of the part. *p*: probability that chance alone causes a shift at least as '
        'large. *Energy growth*: the largest growth of the energy of any drop between two '
        'checks, m g R. Aim: no shift above 0.01.'
    )
    yield ''
    yield '| part | steps per T | shift | interval | p | energy growth | with half steps |'
    yield '|---|---|---|---|---|---|---|'
    for part in track(dropper.parts, 'time step'):
        job = make_job(part, dropper.surfaces.get(), SEED)
        half = make_job(part, dropper.surfaces.get(), SEED, refinement=2)
        coarse, fine = (dropper.distribution(part, j, STEP_DROPS) for j in (job, half))
        found = compare(fine, coarse, np.random.default_rng(SEED))
        yield (
            f'| {part.name} | {job.steps_per_t} | {_shift_text(found)} '
            f'| {found.p_value:.2f} '
            f'| {coarse.energy_growth:.3f} | {fine.energy_growth:.3f} |'
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
        'decide. Aim: at least 999 of 1000 agree, and at most 1 of 1000 is unsettled.'
    )
    yield ''
    yield (
        '| part | decided | agree | by stillness | unsettled | failed | unsettled, until still '
        '| failed, until still | time decided (T) | time still (T) |'
    )
    yield '|---|---|---|---|---|---|---|---|---|---|'
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
            f'| {times[0]:.1f} | {times[1]:.1f} |'
        )
    yield ''


def _shift_text(found: Comparison) -> str:
    lower, upper = found.largest_bounds
    return f'{found.largest_deviation:+.4f} | {lower:+.4f} to {upper:+.4f}'
