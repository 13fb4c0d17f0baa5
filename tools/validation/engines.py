"""Validation of the kernel against Bullet: drops, actions and surroundings."""

import dataclasses
from collections.abc import Iterator
from functools import partial

import numpy as np
from rich.progress import track
from scipy.stats import chi2, chi2_contingency

import resting_aspects_ros as ra
from resting_aspects_ros.api.conditions import aspects_in, shipped_actions, with_surroundings
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.simulation.conditions import BULLET
from resting_aspects_ros.simulation.job import DropJob, make_job
from resting_aspects_ros.simulation.surroundings import surroundings_names
from validation.document import paragraphs
from validation.dropper import SEED, Dropper
from validation.paired import OUTSIDE, TWO_SIDED, Counts, action_job, class_indices, ends

# Drops of each part on each surface; drops in each of the surroundings, and of each action.
DROPS, FEW = 10_000, 2000
SURFACES = ('rubber_mat', 'steel')
# Factor by which Bullet's time step is refined in a second comparison.
FINER = 4
PARTS = ('l_bracket', 'box_10x20x30')
ACTIONS = ('tap', 'toss', 'bowl', 'flip')
# Ends that fewer parts than this have in both engines are counted together.
MIN_COUNT = 10


def engines(dropper: Dropper) -> Iterator[str]:
    """Compare the kernel with Bullet."""
    yield from paragraphs(
        '## Two engines',
        'Drops in the kernel and as many other drops in Bullet. *Chi-square*: of the counts by '
        'symmetry class, with its degrees of freedom; *p*: probability of at least this value if '
        'both engines have the same probabilities. *Difference*: the largest one of a share of a '
        'class, Bullet minus kernel, with its 95 % interval. *Finer*: the same with Bullet '
        f'refined by a factor of {FINER}.',
        'The two engines do not have the same law of friction. Bullet solves friction for each '
        'axis of the plane and scales the result to the disk, so that its friction impulse is off '
        'the slip, in some impacts by more than 10 degrees. With that rule in the kernel, '
        't_prism on `rubber_mat` agrees with a finer Bullet (p = .61); with the law of Coulomb, '
        'in which friction is opposite to the slip, it does not (p = .014). See [The law of '
        'contact](law_of_contact.md#differences-from-bullet).',
        f'Each part on two surfaces, {DROPS} drops:',
    )
    columns = '| chi-square | p | difference | interval |'
    yield f'| part | surface {columns} finer: chi-square | p | difference | interval |'
    yield '|---|---|' + '---|' * 8
    cases = [(part, surface) for part in dropper.parts for surface in SURFACES]
    for part, surface in track(cases, 'two engines'):
        job = make_job(part, dropper.surfaces.get(surface), SEED)
        in_bullet = make_job(part, job.conditions, SEED + 1, engine=BULLET)
        finer = dataclasses.replace(in_bullet, refinement=FINER)
        one, *others = (counted(dropper, each, part, DROPS) for each in (job, in_bullet, finer))
        cells = ' | '.join(difference(one, other) for other in others)
        yield f'| {part.name} | {surface} | {cells} |'
    yield ''
    yield from paragraphs(f'Surroundings and actions on `rubber_mat`, {FEW} of each:')
    yield f'| part | surroundings or action {columns}'
    yield '|---|---|' + '---|' * 4
    parts = [part for part in dropper.parts if part.name in PARTS]
    yield from _surroundings(dropper, parts)
    yield from _actions(dropper, parts)
    yield ''


def _surroundings(dropper: Dropper, parts: list[Part]) -> Iterator[str]:
    for name in surroundings_names():
        conditions = with_surroundings(dropper.surfaces.get(), ra.surroundings(name))
        for part in track(parts, name):
            job = make_job(part, conditions, SEED)
            if job.engine == BULLET or job.scene.level:
                continue
            in_bullet = dataclasses.replace(job, seed=SEED + 1, engine=BULLET)
            counts = [counted(dropper, each, part, FEW) for each in (job, in_bullet)]
            yield f'| {part.name} | {name} | {difference(*counts)} |'


def _actions(dropper: Dropper, parts: list[Part]) -> Iterator[str]:
    for name in ACTIONS:
        action = shipped_actions().get(name).action
        for part in track(parts, name):
            per_class = FEW // len(find_aspects(part).classes())
            job, before = action_job(dropper, part, action, per_class)
            in_bullet = dataclasses.replace(job, seed=SEED + 1, engine=BULLET)
            count = partial(counted, part=part, n=len(before), rows=before)
            cells = difference(*(count(dropper, each) for each in (job, in_bullet)))
            yield f'| {part.name} | {name} | {cells} |'


def counted(
    dropper: Dropper, job: DropJob, part: Part, n: int, rows: Counts | None = None
) -> Counts:
    """Return counts (r, m) of n drops by row and by class or OUTSIDE; without rows, r is 1."""
    aspects = aspects_in(job.scene, find_aspects(part))
    labels = class_indices(aspects)
    rows = np.zeros(n, dtype=np.int64) if rows is None else rows
    counts = np.zeros((rows.max() + 1, labels.max() + 1 + len(OUTSIDE)), dtype=np.int64)
    np.add.at(counts, (rows, ends(dropper, job, aspects, labels, n)), 1)
    return counts


def difference(one: Counts, other: Counts) -> str:
    """Return the cells of a comparison of counts (r, m)."""
    statistic, degrees = 0.0, 0
    for a, b in zip(one, other, strict=True):
        rare = a + b < MIN_COUNT
        table = np.array([[*x[~rare], x[rare].sum()] for x in (a, b)])
        table = table[:, table.sum(axis=0) > 0]
        if table.shape[1] > 1:
            found = chi2_contingency(table, correction=False)
            statistic, degrees = statistic + found.statistic, degrees + found.dof
    p = f'{chi2.sf(statistic, degrees):.2g}' if degrees else ''
    sizes = [counts.sum(axis=1, keepdims=True) for counts in (one, other)]
    shares = [counts / size for counts, size in zip((one, other), sizes, strict=True)]
    difference = shares[1] - shares[0]
    variance = sum(x * (1 - x) / size for x, size in zip(shares, sizes, strict=True))
    place = np.unravel_index(int(np.abs(difference).argmax()), difference.shape)
    middle, error = difference[place], TWO_SIDED * np.sqrt(variance[place])
    return (
        f'{statistic:.1f} ({degrees}) | {p} | {middle:+.4f} '
        f'| {middle - error:+.4f} to {middle + error:+.4f}'
    )
