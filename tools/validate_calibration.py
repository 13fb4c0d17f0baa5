"""Validation of the calibration: cuboids, glass plates, and the coverage of its regions."""

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt
from dropper import ROOT, SEED, Dropper
from rich.progress import track
from scipy.optimize import minimize
from scipy.special import expit

from resting_aspects_ros.studies.calibration.calibrate import calibrate
from resting_aspects_ros.studies.calibration.counts_file import SurfaceCounts
from resting_aspects_ros.studies.calibration.dependence import find_dependence
from resting_aspects_ros.studies.calibration.fit import Fit, fit_counts, fit_shares
from resting_aspects_ros.studies.calibration.posterior import level_at, with_counts
from resting_aspects_ros.studies.calibration.result import CalibrationResult
from resting_aspects_ros.studies.calibration.texts import comparison_text, statements

COUNTS = ROOT / 'config' / 'counts'
# Drops are kept here, so that only the first run makes them.
FOLDER = ROOT / 'out' / 'calibration'
# Points of the cuboids; drops of each part at each point of all calibrations; and how often points
# are added, which would take a quarter of an hour each time.
POINTS, DROPS, ROUNDS = 192, 125, 0
REPETITIONS = 100
# Number of conditions nearest to the counts of all cuboids but one.
NEAREST = 200
# Share of the points that the surrogates are fitted to; the drops at the others are counts.
FITTED = 2 / 3
CONFIDENCE = 0.9


def calibration(dropper: Dropper) -> Iterator[str]:
    """Validate the calibration."""
    yield '## Calibration'
    yield ''
    cuboids = _calibrate(dropper, 'steel_cuboids', POINTS)
    yield from _cuboids(cuboids)
    yield from _plates(dropper)
    yield from _coverage(cuboids.fit)


def _calibrate(dropper: Dropper, name: str, points: int | None = None) -> CalibrationResult:
    return calibrate(
        COUNTS / f'{name}.yaml',
        points=points,
        drops=DROPS,
        rounds=ROUNDS,
        seed=SEED,
        workers=dropper.workers,
        folder=FOLDER,
        progress=True,
    )


def _cuboids(result: CalibrationResult) -> Iterator[str]:
    given = result.fit.given
    yield '### Eight cuboids'
    yield ''
    yield (
        f'`config/counts/steel_cuboids.yaml`: {given.drops} rolls. Fitted: '
        f'{", ".join(f.label for f in given.factors)}; {result.fit.simulated_drops} simulated '
        f'drops at {len(result.fit.points)} points. *Left out*: predicted from the seven others, '
        'with the 90 % interval of as many rolls. Aim: a mean absolute deviation of at most 0.02; '
        'sampling and the scatter of the rolls explain 0.014.'
    )
    yield ''
    yield '| cuboid | rolls | counted | fitted | left out | interval | deviation |'
    yield '|---|---|---|---|---|---|---|'
    for part, fitted, left in zip(given.parts, result.predictions, result.left_out, strict=True):
        yield (
            f'| {part.name} | {part.drops} | {part.shares[0]:.3f} | {fitted.model[0]:.3f} '
            f'| {left.model[0]:.3f} | {left.low[0]:.3f} to {left.high[0]:.3f} '
            f'| {left.model[0] - part.shares[0]:+.3f} |'
        )
    yield f'| mean of absolute values | | | | | | {result.left_out_deviation:.3f} |'
    yield ''
    yield from _laws(result)


def _laws(result: CalibrationResult) -> Iterator[str]:
    """Compare with curves that need no physics: what neighbouring cuboids tell of each other."""
    given = result.fit.given
    curves = {'a straight line': 1, 'a parabola': 2}
    free = [_law_deviations(given, degree, through_cube=False) for degree in curves.values()]
    fixed = [_law_deviations(given, degree, through_cube=True) for degree in curves.values()]
    texts = [
        f'{name} {np.abs(one).mean():.3f}, or {np.abs(two).mean():.3f} if it gives a cube its 1/3'
        for name, one, two in zip(curves, free, fixed, strict=True)
    ]
    worst = int(np.argmax([each.deviation for each in result.left_out]))
    own = ', '.join(f'{each[worst]:+.3f}' for each in (*free, *fixed))
    yield (
        'For comparison, curves of the log odds over the logarithm of the thickness, which are '
        f'fitted to the seven others, deviate from the cuboid that is left out by: '
        f'{"; ".join(texts)}. The counts of neighbouring cuboids differ by more than a smooth '
        f'law and sampling allow. For {given.parts[worst].name}, these curves deviate by {own}.'
    )
    yield ''
    shares = np.stack([each[:, 0] for each in result.fit.posterior.shares], axis=1)
    yield _nearest(given, shares, worst)
    yield ''
    yield from _said(result)


def _nearest(given: SurfaceCounts, shares: npt.NDArray[np.float64], worst: int) -> str:
    """Describe the shares (n, parts) of a cuboid under conditions that fit all others."""
    counted = np.array([part.shares[0] for part in given.parts])
    others = np.abs(np.delete(shares - counted, worst, axis=1)).mean(axis=1)
    chosen = np.argsort(others)[:NEAREST]
    found = shares[chosen, worst]
    return (
        f'Of {len(shares)} conditions, the {NEAREST} whose fitted shares are nearest to those of '
        f'the others deviate from them by {others[chosen].mean():.3f} on average, and give '
        f'{given.parts[worst].name} a share of {found.mean():.3f} (standard deviation '
        f'{found.std():.3f}), where {counted[worst]:.3f} was counted. So this cuboid alone adds '
        f'{abs(found.mean() - counted[worst]) / len(counted):.3f} to the mean deviation.'
    )


def _law_deviations(given: SurfaceCounts, degree: int, *, through_cube: bool) -> list[float]:
    """Return the deviations of the predicted shares of cuboids that are left out."""
    sizes = np.array([np.ptp(part.part.hull_vertices, axis=0) for part in given.parts])
    x = np.log(sizes[:, 2] / sizes[:, 0])
    counts = np.array([part.counts for part in given.parts], dtype=np.float64)
    features = np.stack([x**k for k in range(through_cube, degree + 1)], axis=1)
    # The logits of one of two classes against the other.
    level = -np.log(2) if through_cube else 0.0
    deviations = []
    for k in range(len(x)):
        rest = np.arange(len(x)) != k
        found = minimize(_loss, np.zeros(features.shape[1]), (features[rest], counts[rest], level))
        share = expit(level + features[k] @ found.x)
        deviations.append(float(share - counts[k, 0] / counts[k].sum()))
    return deviations


def _loss(
    weights: npt.NDArray[np.float64],
    features: npt.NDArray[np.float64],
    counts: npt.NDArray[np.float64],
    level: float,
) -> float:
    """Return the negative log likelihood of counts (m, 2) with a logistic curve."""
    logit = level + features @ weights
    return float((counts.sum(axis=1) * np.logaddexp(0, logit) - counts[:, 0] * logit).sum())


def _plates(dropper: Dropper) -> Iterator[str]:
    yield '### Two glass plates'
    yield ''
    yield (
        'A cylinder whose height is its diameter: an end is down in 38 % on glass 15.5 mm thick, '
        'and in 24 % on glass 2.4 mm thick (Murray; 1000 throws assumed).'
    )
    yield ''
    results = [_calibrate(dropper, name) for name in ('glass_thick', 'glass_thin')]
    for result in results:
        yield f'`{result.surface}`:'
        yield ''
        yield from _said(result)
    yield comparison_text(results[0].compare(results[1])).replace('\n', ' ')
    yield ''


def _said(result: CalibrationResult) -> Iterator[str]:
    for sentence in statements(result):
        yield f'* {sentence}'
    yield ''


def _coverage(fit: Fit) -> Iterator[str]:
    """Count how often the 90 % region contains the conditions that the counts were made with."""
    drawn = {
        'drawn': _drawn(fit, fit.posterior.dependence),
        'drawn, independent': _drawn(fit, 1.0),
    }
    yield '### Coverage'
    yield ''
    yield (
        f'How often the 90 % region of {", ".join(f.label for f in fit.given.factors)} contains '
        'the conditions that the counts were made with, without discrepancy in counts and fit. '
        '*Drawn*: as many rolls of each cuboid as were counted, from the shares of the surrogate '
        'within its uncertainty, at random conditions. *Simulated*: the drops at the last third '
        'of the points of the design are taken for counts, with surrogates that were fitted to '
        'the drops at the others. *Independent*: with the errors of the surrogates taken to be '
        'independent, as those of drawn counts are by construction: with the dependence of real '
        'drops, their region is larger than they need. Aim: 85 to 95 of 100.'
    )
    yield ''
    yield '| counts | repetitions | inside | share | standard error |'
    yield '|---|---|---|---|---|'
    for name, levels in (*drawn.items(), *_new_points(fit)):
        inside, n = int((np.array(levels) <= CONFIDENCE).sum()), len(levels)
        error = np.sqrt(CONFIDENCE * (1 - CONFIDENCE) / n)
        yield f'| {name} | {n} | {inside} | {inside / n:.2f} | {error:.2f} |'
    yield ''


def _drawn(fit: Fit, dependence: float) -> list[float]:
    """Return the levels of random conditions in the posteriors of counts drawn for them."""
    exact = fit_counts(
        fit.given,
        fit.points,
        fit.simulated,
        fit.surrogates,
        discrepancy=False,
        dependence=dependence,
    )
    rng = np.random.default_rng(SEED)
    rolls = [part.drops for part in fit.given.parts]
    found = []
    for truth in track(rng.random((REPETITIONS, len(fit.given.factors))), 'drawn'):
        shares = [surrogate.draws(truth[None], rng, 1)[0, 0] for surrogate in fit.surrogates]
        counts = [rng.multinomial(n, row) for n, row in zip(rolls, shares, strict=True)]
        posterior = with_counts(exact.posterior, counts)
        found.append(level_at(posterior, fit.surrogates, counts, truth))
    return found


def _new_points(fit: Fit) -> Iterator[tuple[str, list[float]]]:
    """Yield the levels of new points in the posteriors of their own drops, by their name."""
    total = min(POINTS, len(fit.points))  # those of the design, not of later rounds
    count = round(FITTED * total)
    points, known = fit.points[:count], [each[:count] for each in fit.simulated]
    surrogates = fit_shares(points, known, SEED)
    dependence = find_dependence(surrogates, points, known, SEED)
    for name, value in (('simulated', dependence), ('simulated, independent', 1.0)):
        posterior = fit_counts(
            fit.given, points, known, surrogates, discrepancy=False, dependence=value
        ).posterior
        levels = []
        for k in track(range(count, total), name):
            counts = [each[k] for each in fit.simulated]
            levels.append(
                level_at(with_counts(posterior, counts), surrogates, counts, fit.points[k])
            )
        yield name, levels
