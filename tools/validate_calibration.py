"""Validation of the calibration: cuboids, glass plates, and the coverage of its regions."""

import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import numpy.typing as npt
from dropper import ROOT, SEED, Dropper
from rich.progress import track

from resting_aspects_ros.studies.calibration.calibrate import calibrate, summarise
from resting_aspects_ros.studies.calibration.counts_file import (
    SurfaceCounts,
    make_surface_counts,
)
from resting_aspects_ros.studies.calibration.fit import (
    Fit,
    conditions_at,
    fit_counts,
    fit_shares,
)
from resting_aspects_ros.studies.calibration.posterior import with_counts
from resting_aspects_ros.studies.calibration.result import CalibrationResult
from resting_aspects_ros.studies.calibration.simulated_drops import SimulatedDrops
from resting_aspects_ros.studies.calibration.summary import region_level
from resting_aspects_ros.studies.calibration.texts import comparison_text, statements
from resting_aspects_ros.studies.designs import sobol

Array = npt.NDArray[np.float64]
Counts = npt.NDArray[np.int64]

COUNTS = ROOT / 'config' / 'counts'
# Of the coverage: parts, drops of each by hand, and repetitions.
SOLIDS = {'box': [20, 20, 15], 'cylinder': [20, 16]}
BY_HAND = 200
REPETITIONS = 100
POINTS, PER_POINT = 64, 500


def calibration(dropper: Dropper) -> Iterator[str]:
    """Validate the calibration."""
    yield '## Calibration'
    yield ''
    yield from _cuboids(dropper)
    yield from _plates(dropper)
    yield from _coverage(dropper)


def _calibrate(dropper: Dropper, name: str) -> CalibrationResult:
    with tempfile.TemporaryDirectory() as folder:
        return calibrate(
            COUNTS / f'{name}.yaml', seed=SEED, workers=dropper.workers, folder=folder,
            progress=True,
        )  # fmt: skip


def _cuboids(dropper: Dropper) -> Iterator[str]:
    result = _calibrate(dropper, 'steel_cuboids')
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
    yield from _said(result)


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


def _coverage(dropper: Dropper) -> Iterator[str]:
    """Count how often the 90 % region contains the conditions that the counts were made with."""
    given = make_surface_counts(_document([[1, 1]] * len(SOLIDS)), Path())
    drops = SimulatedDrops(dropper.workers, SEED)
    design = sobol(len(given.factors), POINTS, SEED)
    simulated = [
        part.grouped(
            drops.counts(part.part, conditions_at(given.base, given.factors, design), PER_POINT)
        )
        for part in given.parts
    ]
    surrogates = fit_shares(design, simulated, SEED)
    fit = fit_counts(given, design, simulated, surrogates, discrepancy=False)
    rng = np.random.default_rng(SEED)
    truths = rng.random((REPETITIONS, len(given.factors)))
    shares = [surrogate.shares(truths) for surrogate in surrogates]
    invented = [[rng.multinomial(BY_HAND, row) for row in each] for each in shares]
    real = _real_counts(given, drops, truths)
    yield '### Coverage'
    yield ''
    yield (
        f'A box of 20 x 20 x 15 mm and a cylinder of 20 x 16 mm, {BY_HAND} drops of each at '
        f'{REPETITIONS} random pairs of restitution and friction, height 100 mm, without '
        'discrepancy in counts and fit. *Inside*: the 90 % region contains the pair. Aim: 85 to '
        '95 of 100.'
    )
    yield ''
    yield '| counts | repetitions | inside | G test p < 0.05 |'
    yield '|---|---|---|---|'
    for name, counts in (('drawn from the surrogate', invented), ('simulated drops', real)):
        inside, rejected = _inside(fit, truths, counts)
        yield f'| {name} | {REPETITIONS} | {inside} | {rejected} of {REPETITIONS // 5} |'
    yield ''


def _document(counts: list[list[int]]) -> dict[str, object]:
    names = {'box': ('z', 'rest'), 'cylinder': ('end', 'side')}
    return {
        'conditions': {'height': 0.1},
        'parts': [
            {kind: size, 'counts': dict(zip(names[kind], map(int, row), strict=True))}
            for (kind, size), row in zip(SOLIDS.items(), counts, strict=True)
        ],
    }


def _real_counts(given: SurfaceCounts, drops: SimulatedDrops, truths: Array) -> list[list[Counts]]:
    """Return counts of simulated drops of each part at each pair of conditions."""
    conditions = conditions_at(given.base, given.factors, truths)
    return [
        list(part.grouped(drops.counts(part.part, conditions, BY_HAND)))
        for part in track(given.parts, 'coverage')
    ]


def _inside(fit: Fit, truths: Array, counts: list[list[Counts]]) -> tuple[int, int]:
    """Return how often the truth is in the region, and how often a fifth is rejected."""
    inside = rejected = 0
    for k, truth in enumerate(truths):
        own = [each[k] for each in counts]
        posterior = with_counts(fit.posterior, own)
        nearest = int(((posterior.points - truth) ** 2).sum(axis=1).argmin())
        inside += int(posterior.weights().sum(axis=0)[nearest] >= region_level(posterior))
        if k % 5 == 0:
            rows = [list(map(int, row)) for row in own]
            again = make_surface_counts(_document(rows), Path())
            refit = fit_counts(again, fit.points, fit.simulated, fit.surrogates, discrepancy=False)
            rejected += summarise(refit, SEED).g_test.p < 0.05
    return inside, rejected
