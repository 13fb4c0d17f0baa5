"""Validation against measured shares: the surface `thrown`, its fit, and the model range.

The recipe of the fit: `POINTS` points fill `BOX` (Sobol); each body is dropped at each point,
with the same random numbers; the points are weighted by their likelihood. The nominal conditions
are the point near the middle of the probable region whose deviance, with more drops, is the least.
"""

from collections.abc import Iterator, Sequence

import numpy as np
from rich.progress import track
from scipy.special import ndtri
from scipy.stats import qmc

from resting_aspects_ros.arrays import Array
from resting_aspects_ros.report.figure import FAINT, new_figure, plain_axes, png_bytes
from resting_aspects_ros.simulation.conditions import BULLET, DropConditions
from resting_aspects_ros.statistics.model_range import DISCREPANCY
from validation.document import paragraphs
from validation.dropper import ROOT, Dropper
from validation.fit import Posterior, polynomial_deviance
from validation.measured import Case, cases, deviance, log_odds, simulated

PICTURE = ROOT / 'docs' / 'explanation' / 'measured_shares.png'
DROPS, BULLET_DROPS, OTHER_DROPS = 20_000, 2000, 5000
POINTS, POINT_DROPS, DRAWS = 128, 1000, 16
# Ranges that are searched; the height by its logarithm.
BOX = {
    'restitution': (0.15, 0.55),
    'friction': (0.08, 0.40),
    'spin': (30.0, 80.0),
    'speed_horizontal': (0.0, 1.2),
    'height': (0.03, 0.2),
}
RARE = 0.1
QUANTILE = float(ndtri(0.95))  # of a range that contains 90 %
# Deviations of more than a factor of 2 of shares below RARE, with what is known of the reason.
REASONS = {
    'cuboid 1.60, square faces': 'no smooth law explains the drop from 0.052 to 0.017 between it '
    'and its neighbour',
    'cuboid 1.87, square faces': '6 rolls',
    'cuboid 2.65, square faces': '3 rolls',
}


def thrown(dropper: Dropper) -> Iterator[str]:
    """Compare `thrown` with the measurements, fit it, and test the model range."""
    known, conditions = cases(), dropper.surfaces.get('thrown')
    shares = simulated(known, conditions, DROPS, dropper.workers)
    in_bullet = simulated(known, conditions, BULLET_DROPS, dropper.workers, engine=BULLET)
    yield from paragraphs('## Measured shares')
    yield from _comparison(known, conditions, shares, in_bullet)
    points = _points(conditions)
    found = np.array(
        [simulated(known, c, POINT_DROPS, dropper.workers) for c in track(points, 'points')]
    )
    counts, rolls = (np.array([getattr(c, name) for c in known]) for name in ('count', 'rolls'))
    posterior = Posterior(counts, rolls, found, POINT_DROPS)
    yield from _fit(points, posterior)
    others = [
        simulated(known, dropper.surfaces.get(name), OTHER_DROPS, dropper.workers)
        for name in ('rubber_mat', 'steel')
    ]
    yield from _coverage(known, posterior, np.array([shares, *others]))
    _draw(known, shares, posterior)


def _comparison(
    known: Sequence[Case], conditions: DropConditions, shares: Array, in_bullet: Array
) -> Iterator[str]:
    yield from paragraphs(
        'Shares that were counted by hand or by a machine, compared with the simulation of all '
        f'bodies under one set of conditions, `thrown`: {DROPS} drops of each in the kernel and '
        f'{BULLET_DROPS} in Bullet. Five of its values are fitted to these cases: restitution '
        f'{conditions.restitution:g}, friction {conditions.friction:g}, spin '
        f'{conditions.spin:g} rad/s, horizontal speed {conditions.speed_horizontal:g} m/s and '
        f'height {1000 * conditions.height:g} mm. The counts and their sources are the files of '
        '`config/counts`; * the number of rolls is not published, 1000 are assumed. *Deviance*: '
        '2 sum O log(O / E) over both outcomes.'
    )
    yield (
        '| body, sides | rolls | measured | interval | kernel | deviation | ratio | deviance '
        '| Bullet |'
    )
    yield '|---|---|---|---|---|---|---|---|---|'
    measured = np.array([case.share for case in known])
    found = deviance([c.count for c in known], [c.rolls for c in known], shares)
    for k, case in enumerate(known):
        star, each = '*' if case.assumed else '', case.interval
        yield (
            f'| {case.name} | {case.rolls}{star} | {case.share:.3f} '
            f'| {each.lower:.3f} to {each.upper:.3f} | {shares[k]:.3f} '
            f'| {shares[k] - case.share:+.3f} | {shares[k] / case.share:.2f} | {found[k]:.1f} '
            f'| {in_bullet[k]:.3f} |'
        )
    off = np.abs(shares - measured)
    yield f'| all | | | | | {off.mean():.4f} | | {found.sum():.1f} | |'
    yield ''
    rare = measured < RARE
    ratios = np.exp(np.abs(log_odds(shares[rare]) - log_odds(measured[rare])))
    cuboids = [k for k, case in enumerate(known) if case.name.startswith('cuboid')]
    thickness = np.log([float(known[k].name.split()[1].rstrip(',')) for k in cuboids])
    counts, rolls = (
        np.array([getattr(known[k], name) for k in cuboids]) for name in ('count', 'rolls')
    )
    floor, free = polynomial_deviance(thickness, counts, rolls, 3), len(cuboids) - 4
    yield (
        f'* By points: a mean absolute deviation of {100 * off.mean():.1f} points (aim: at most '
        f'2.8); the largest is {100 * off.max():.1f}, of {known[int(off.argmax())].name}. Bullet: '
        f'{100 * np.abs(in_bullet - measured).mean():.1f} points.'
    )
    yield (
        f'* By log odds, of the {rare.sum()} shares below {100 * RARE:g} %: a typical ratio of '
        f'{np.exp(np.abs(np.log(ratios)).mean()):.2f} (geometric mean).'
    )
    for k in np.flatnonzero(rare).tolist():
        ratio = shares[k] / measured[k]
        if not 0.5 <= ratio <= 2:
            yield f'* {known[k].name}: off by a ratio of {ratio:.2f}; {REASONS[known[k].name]}.'
    yield from paragraphs(
        f'* Against the floor: the deviance is {found.sum():.0f} (aim: at most 80; it scatters by '
        f'about 4 with the seed), of which {found[cuboids].sum():.0f} are from the '
        f'{len(cuboids)} cuboids. A cubic polynomial of their log odds over the logarithm of the '
        f'thickness, which needs no physics, leaves {floor:.0f} with {free} degrees of freedom: '
        'neighbours differ by more than a smooth law and sampling allow.',
        '![Simulated against measured shares](measured_shares.png)',
    )


def _points(conditions: DropConditions) -> list[DropConditions]:
    """Return conditions that fill the box evenly, in ascending order of the restitution."""
    low, high = np.array([(*each,) for each in BOX.values()]).T
    unit = qmc.Sobol(len(BOX), seed=3).random(POINTS)
    values = low + unit * (high - low)
    values[:, -1] = low[-1] * (high[-1] / low[-1]) ** unit[:, -1]
    rows = values[np.argsort(values[:, 0])].tolist()
    return [conditions.changed(**dict(zip(BOX, row, strict=True))) for row in rows]


def _fit(points: Sequence[DropConditions], posterior: Posterior) -> Iterator[str]:
    weights = posterior.weights().sum(axis=0)
    values = np.array([[getattr(point, name) for name in BOX] for point in points])
    mean = weights @ values
    spread = np.sqrt(weights @ (values - mean) ** 2)
    yield from paragraphs(
        '### The fit',
        f'{POINTS} points fill the ranges of five conditions, and each body is dropped '
        f'{POINT_DROPS} times at each point. The log odds of the measured shares are taken as '
        'normal about the simulated ones, with the variances of both samples and of a '
        'discrepancy, whose standard deviation grows with (4 p (1 - p))^-1/4. The points are '
        f'weighted by their likelihood; {1 / (weights**2).sum():.0f} of them are effective.',
    )
    yield '| condition | range | mean | standard deviation |'
    yield '|---|---|---|---|'
    for k, (name, (low, high)) in enumerate(BOX.items()):
        yield f'| {name} | {low:g} to {high:g} | {mean[k]:.3g} | {spread[k]:.2g} |'
    yield ''
    yield from paragraphs(
        f'The standard deviation of the discrepancy at a share of 1/2 is {posterior.scale():.2f} '
        f'(in use: {DISCREPANCY:g}). {DRAWS} equally probable points, which are the `uncertainty` '
        'of `thrown` in `config/surfaces.yaml`:'
    )
    chosen = posterior.draws(DRAWS)
    for k, name in enumerate(BOX):
        yield f'* {name}: {", ".join(f"{x:.3g}" for x in values[chosen, k])}'
    yield ''


def _coverage(known: Sequence[Case], posterior: Posterior, surfaces: Array) -> Iterator[str]:
    """Predict each body from the others, and compare with a range over all named surfaces."""
    yield from paragraphs(
        '### The model range of a body that was not measured',
        'Each body is left out in turn: conditions and discrepancy follow from the others, and '
        'give the 90 % range of its share, as the [model range](trust.md) of a part does. '
        '*Surfaces*: the range of the simulated shares over all named surfaces.',
    )
    yield '| body, sides | measured | predicted | 90 % range | within | surfaces | within |'
    yield '|---|---|---|---|---|---|---|'
    inside = [0, 0]
    widths = np.zeros((2, 2))
    limits = np.clip(surfaces, 0.5 / OTHER_DROPS, 1 - 0.5 / OTHER_DROPS)
    for k, case in enumerate(known):
        low, middle, high = posterior.range_of(k, QUANTILE, without=k)
        ranges = [(low, high), (limits[:, k].min(), limits[:, k].max())]
        marks = []
        for j, (a, b) in enumerate(ranges):
            holds = a <= case.share <= b
            inside[j] += holds
            marks.append('yes' if holds else 'no')
            widths[j] += (b - a, float(log_odds(b) - log_odds(a)))
        yield (
            f'| {case.name} | {case.share:.3f} | {middle:.3f} | {low:.3f} to {high:.3f} '
            f'| {marks[0]} | {ranges[1][0]:.3f} to {ranges[1][1]:.3f} | {marks[1]} |'
        )
    n, mean = len(known), widths / len(known)
    yield from paragraphs(
        f'| mean width: points, log odds | | | {100 * mean[0, 0]:.1f}, {mean[0, 1]:.2f} '
        f'| {inside[0]} of {n} | {100 * mean[1, 0]:.1f}, {mean[1, 1]:.2f} | {inside[1]} of {n} |',
        f'{inside[0]} of {n} measured shares ({100 * inside[0] / n:.0f} %) are within their 90 % '
        'range (aim: 80 to 97 %).',
    )


def _draw(known: Sequence[Case], shares: Array, posterior: Posterior) -> None:
    """Draw simulated against measured shares with both intervals, on the log odds."""
    figure = new_figure(4.6, 4.4)
    axes = figure.add_subplot()
    plain_axes(axes, 'y')
    limits = (0.001, 0.97)
    axes.plot(limits, limits, color=FAINT, linewidth=0.8)
    for k, case in enumerate(known):
        low, _, high = posterior.range_of(k, QUANTILE)
        axes.plot([low, high], [case.share] * 2, color='#9DB7DE', linewidth=1)
        each = case.interval
        axes.plot([shares[k]] * 2, [each.lower, each.upper], color='#1F5FBF', linewidth=1)
    axes.plot(shares, [case.share for case in known], 'o', color='#1F5FBF', markersize=4)
    ticks = [0.002, 0.01, 0.05, 0.2, 0.5, 0.8, 0.95]
    for axis, set_scale in ((axes.xaxis, axes.set_xscale), (axes.yaxis, axes.set_yscale)):
        set_scale('logit')
        axis.set_ticks(ticks, [f'{100 * t:g} %' for t in ticks])
        axis.set_ticks([], minor=True)
    axes.set_xlim(*limits)
    axes.set_ylim(*limits)
    axes.set_xlabel('simulated share, with its 90 % model range', size=8)
    axes.set_ylabel('measured share, with its 95 % interval', size=8)
    figure.tight_layout()
    PICTURE.write_bytes(png_bytes(figure))
