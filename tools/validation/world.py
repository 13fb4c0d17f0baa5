"""Validation of the simulation against measurements."""

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt
from rich.progress import track

from resting_aspects_ros.rotations import down_in_part
from resting_aspects_ros.simulation.conditions import DropConditions
from resting_aspects_ros.simulation.job import BULLET, KERNEL, make_job
from resting_aspects_ros.statistics.intervals import intervals
from resting_aspects_ros.statistics.poses import RestStatus
from validation.dropper import SEED, Dropper
from validation.measured import Case, cases
from validation.sensitivity import fit

# Number of drops of each case, and of each case at each end of a slope.
CASE_DROPS = {KERNEL: 20_000, BULLET: 6000}
SLOPE_DROPS = 10_000
# Result of a search of conditions, which the slopes at one point do not show.
SEARCHED = (
    'They are not: of about 100 sets of conditions in Bullet (restitution 0.3 to 0.95, friction '
    '0.03 to 0.6, spin up to 85 rad/s, speed up to 1.4 m/s, heights of 2 to 30 cm), none had a '
    'mean deviation below 0.03 with at least 1000 drops of each body. The aim is 0.02. Two '
    'deviations '
    'remain: no single set of conditions explains how often the tall blocks, the block of 0.75 '
    'and the die fall on their less stable faces, and the log odds of neighbouring blocks differ '
    'by a factor of two over the same step of height, which no smooth law can describe.'
)
# The values of `thrown` that are fitted, with the factor by which each is varied for its slope.
# The factors are large enough for a significant change with this number of drops.
FITTED = {'restitution': 1.1, 'friction': 1.5, 'spin': 1.3, 'speed_horizontal': 1.5}


def world(dropper: Dropper) -> Iterator[str]:
    """Compare the simulation with the measurements."""
    thrown = dropper.surfaces.get('thrown')
    known = cases()
    measured = np.array([case.share for case in known])
    simulated, in_bullet = (
        np.array([_share(dropper, c, thrown, n, engine) for c in track(known, engine)])
        for engine, n in CASE_DROPS.items()
    )
    slopes = np.stack(
        [
            _slopes(dropper, known, thrown, name, factor)
            for name, factor in track(list(FITTED.items()), 'slopes')
        ],
        axis=1,
    )
    residuals, of_bullet = simulated - measured, in_bullet - measured
    found = fit(residuals, slopes, np.array([case.deviation for case in known]))
    yield '## Comparison with measurements'
    yield ''
    yield from _introduction(thrown)
    yield (
        '| body | measured | interval | kernel | deviation | Bullet | deviation | left out | '
        + ' | '.join(FITTED)
        + ' |'
    )
    yield '|---|---|---|---|---|---|---|---|' + '---|' * len(FITTED)
    for k, case in enumerate(known):
        per = ' | '.join(f'{slope * 0.1:+.3f}' for slope in slopes[k])
        yield (
            f'| {case.name} | {case.share:.3f} | {_interval_text(case)} '
            f'| {simulated[k]:.3f} | {residuals[k]:+.3f} | {in_bullet[k]:.3f} '
            f'| {of_bullet[k]:+.3f} | {found.left_out[k]:+.3f} | {per} |'
        )
    yield (
        f'| mean of absolute values | | | | {np.abs(residuals).mean():.3f} | '
        f'| {np.abs(of_bullet).mean():.3f} | {np.abs(found.left_out).mean():.3f} |'
        + ' |'
        * len(FITTED)
    )
    yield ''
    moves = ', '.join(
        f'{name} by {100 * step:+.0f} % (standard error {100 * spread:.0f} %)'
        for name, step, spread in zip(FITTED, found.step, found.spread, strict=True)
    )
    yield (
        f'A linear fit about these values would change {moves}. The mean deviation '
        f'would then be {np.abs(residuals + slopes @ found.step).mean():.3f} if the shares were '
        f'linear over this range. {SEARCHED}'
    )
    yield ''


def _slopes(
    dropper: Dropper, known: list[Case], thrown: DropConditions, name: str, factor: float
) -> npt.NDArray[np.float64]:
    """Return the derivatives of the shares with respect to the logarithm of a value."""
    value = getattr(thrown, name)
    ends = [
        np.array([_share(dropper, c, thrown.changed(**{name: v}), SLOPE_DROPS) for c in known])
        for v in (value / factor, value * factor)
    ]
    return np.asarray((ends[1] - ends[0]) / (2 * np.log(factor)))


def _share(
    dropper: Dropper, case: Case, conditions: DropConditions, drops: int, engine: str = KERNEL
) -> float:
    job = make_job(case.part, conditions, SEED, engine=engine)
    return (
        sum(
            case.hits(down_in_part(poses.orientation[poses.status == RestStatus.SETTLED]))
            for poses in dropper.poses(job, drops)
        )
        / drops
    )


def _introduction(thrown: DropConditions) -> Iterator[str]:
    yield (
        'Shares that were counted by hand or by a machine, compared with the simulation of all '
        f'bodies under one set of conditions: `thrown`, {CASE_DROPS[KERNEL]} drops of each in the '
        f'kernel and {CASE_DROPS[BULLET]} in Bullet. Four of its values were fitted to these '
        f'cases with drops in Bullet: restitution {thrown.restitution:g}, friction '
        f'{thrown.friction:g}, spin {thrown.spin:g} rad/s and speed '
        f'{thrown.speed_horizontal:g} m/s. *Left out*: the deviation when the four values are '
        'fitted to all other cases. The last columns are sensitivities: the change of the share '
        f'when a value grows by a tenth (central differences, {SLOPE_DROPS} drops each). Both '
        'are of the kernel. Sizes and sources are in tools/validation/measured.py.'
    )
    yield ''


def _interval_text(case: Case) -> str:
    if not case.rolls:
        return 'not published'
    (found,) = intervals([round(case.share * case.rolls)], case.rolls)
    return f'{found.lower:.3f} to {found.upper:.3f}'
