"""Validation of the actions: numerical parameters, and what the strongest kick forgets."""

from collections.abc import Iterator

import numpy as np

import resting_aspects_ros as ra
from resting_aspects_ros.api.conditions import shipped_actions
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.simulation.actions import Kick
from resting_aspects_ros.simulation.job import BULLET, KERNEL
from validation.dropper import SEED, Dropper
from validation.paired import (
    ONE_SIDED,
    OUTSIDE,
    REFINEMENT,
    Array,
    Counts,
    action_job,
    class_indices,
    paired_counts,
    shifts,
)

STRONGEST = 'toss'
# Actions from each symmetry class in each simulation. A step, which Bullet simulates, takes most
# of the time: about 40 minutes of one process.
RUNS = {
    ('box_10x20x30', STRONGEST): 20_000,
    ('l_bracket', STRONGEST): 20_000,
    ('t_prism', STRONGEST): 20_000,
    ('box_10x20x30', 'air_blast'): 20_000,
    ('l_bracket', 'air_blast'): 20_000,
    ('box_10x20x30', 'step_down'): 6_000,
    ('l_bracket', 'step_down'): 6_000,
    ('t_prism', 'step_down'): 6_000,
    ('box_10x20x30', 'bowl'): 6_000,
    ('l_bracket', 'flip'): 6_000,
}
DROPS = 20_000
# Samples of rows of equal probabilities.
SAMPLES = 1000


def reorientation(dropper: Dropper) -> Iterator[str]:
    """Show how much refined actions differ, and what the strongest forgets."""
    parts = {part.name: part for part in dropper.parts}
    yield '## Convergence of actions'
    yield ''
    yield (
        'Named actions on `rubber_mat`, each with the numerical parameters of the suite and again '
        f'with all of them refined by a factor of {REFINEMENT[KERNEL]}, or of '
        f'{REFINEMENT[BULLET]} for a step, which Bullet simulates, from the same states. '
        '*Actions*: from each symmetry class, in each simulation. '
        '*Differ*: share of the parts that end in another class. *Shift*: of the entry of the '
        'matrix by symmetry class that changes most, with its standard error. *Bound*: no entry '
        'of the matrix changes by more than this, with a confidence of 95 %. The aim is a bound '
        'of 0.01; where it is larger, the number of actions does not suffice to show the aim, or '
        'the shift exceeds it.'
    )
    yield ''
    yield '| part | action | actions | differ | from class | to | shift | error | bound |'
    yield '|---|---|---|---|---|---|---|---|---|'
    strongest = {}
    for (name, action), per_class in RUNS.items():
        part = parts[name]
        job, before = action_job(dropper, part, shipped_actions().get(action).action, per_class)
        aspects = find_aspects(part)
        labels = class_indices(aspects)
        counts = paired_counts(dropper, job, aspects, labels, len(before), before)
        found = shifts(counts)
        row, column = found.largest
        to = [*(str(k + 1) for k in range(len(counts))), *OUTSIDE][column]
        yield (
            f'| {name} | {action} | {counts.sum(axis=(1, 2)).min()} | {found.different:.3f} '
            f'| {row + 1} | {to} | {found.shift[row, column]:+.4f} '
            f'| {found.error[row, column]:.4f} | {found.bound:.4f} |'
        )
        if action == STRONGEST:
            strongest[name] = counts.sum(axis=2)  # with the parameters of the suite
    yield ''
    yield from _memory(dropper, [parts[name] for name in strongest], strongest)


def _memory(dropper: Dropper, parts: list[Part], strongest: dict[str, Counts]) -> Iterator[str]:
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
        'with the same spreads; the largest of all pairs. *Chance*: what is exceeded in 5 % of '
        'samples of this size in which all rows have the same probabilities. *Bound*: upper bound '
        'of the true value, with a confidence of 95 %. The aims are 0.03 and 0.05.'
    )
    yield ''
    yield '| part | actions | two rows | chance | bound | row and drop | chance | bound |'
    yield '|---|---|---|---|---|---|---|---|'
    generator = np.random.default_rng(SEED)
    for part in parts:
        result = ra.drop(
            part,
            DROPS,
            surface=conditions,
            seed=SEED,
            workers=dropper.workers,
            keep_poses=False,
            force=True,
        )
        drop = result.distribution.by_class()
        outside = [drop.unclassified, drop.unsettled, drop.failed, drop.lost, drop.sliding]
        dropped = np.array([[*drop.counts.tolist(), *outside]])
        rows = strongest[part.name]
        values = [
            *farthest(rows, rows, generator),
            *farthest(rows, dropped, generator),
        ]
        cells = [f'{value:.4f}' for value in values]
        yield f'| {part.name} | {rows.sum(axis=1).min()} | {" | ".join(cells)} |'
    yield ''


def farthest(
    rows: Counts, others: Counts, generator: np.random.Generator
) -> tuple[float, float, float]:
    """Return the maximum total variation between rows and others, chance, and an upper bound.

    The total variation of two samples exceeds that of their distributions on average, as that of
    the largest pair does. So the bound needs only the standard error of the share of the columns
    that the first row of this pair has more often.
    """
    distances = _distances(rows, others)
    i, j = np.unravel_index(int(distances.argmax()), distances.shape)
    n, m = int(rows[i].sum()), int(others[j].sum())
    more = rows[i] / n > others[j] / m
    p, q = rows[i][more].sum() / n, others[j][more].sum() / m
    error = np.sqrt(p * (1 - p) / n + q * (1 - q) / m)
    everyone = rows.sum(axis=0) if rows is others else rows.sum(axis=0) + others.sum(axis=0)
    pooled = everyone / everyone.sum()
    by_chance = np.empty(SAMPLES)
    for k in range(SAMPLES):
        one = generator.multinomial(rows.sum(axis=1), pooled)
        other = one if rows is others else generator.multinomial(others.sum(axis=1), pooled)
        by_chance[k] = _distances(one, other).max()
    return (
        float(distances[i, j]),
        float(np.quantile(by_chance, 0.95)),
        float(distances[i, j] + ONE_SIDED * error),
    )


def _distances(rows: Counts, others: Counts) -> Array:
    """Return the total variation (r, o) between the shares of each row and each other row."""
    a, b = (counts / counts.sum(axis=1, keepdims=True) for counts in (rows, others))
    return np.asarray(np.abs(a[:, None] - b).sum(axis=2) / 2)
