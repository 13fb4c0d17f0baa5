"""Compare the analytic methods with measurements and with drops.

Writes docs/explanation/estimators.md. Takes some minutes on two cores.
"""

import datetime as dt
from collections.abc import Iterator, Mapping

import numpy as np
from dropper import ROOT, SEED, Dropper
from measured import Case, cases
from rich.console import Console
from rich.progress import track

from resting_aspects_ros.core.estimators.estimate import METHODS, Estimate, estimate
from resting_aspects_ros.core.estimators.resting_shape import NotDefinedError, RestingShape
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.statistics.comparison import Comparison, compare_with_exact
from resting_aspects_ros.simulation.local_workers import LocalWorkers, default_workers
from resting_aspects_ros.simulation.plan import engine_version, make_job
from resting_aspects_ros.simulation.run_description import KERNEL

RESULT = ROOT / 'docs' / 'explanation' / 'estimators.md'
# Drops of each part on each surface: the standard error of a share of 0.25 is 0.006.
DROPS = 5_000
# Parts with flat sides, and release heights in units of their hull radii.
OF_HEIGHTS = ('box_10x20x30', 'hex_nut', 'l_bracket')
HEIGHTS = (0.1, 0.5, 1.0, 3.0, 10.0, 30.0, 100.0)


def main() -> None:
    """Simulate the drops, compare, print and write."""
    console = Console()
    lines = list(_heading())
    workers = LocalWorkers(default_workers())
    try:
        dropper = Dropper(workers)
        for section in (_counted(), _dropped(dropper), _by_height(dropper)):
            for line in section:
                console.print(line, highlight=False, soft_wrap=True)
                lines.append(line)
    finally:
        workers.stop()
    lines += LIMITS.splitlines()
    RESULT.write_text('\n'.join(lines) + '\n', encoding='utf-8')
    print(f'Written: {RESULT}')


def _heading() -> Iterator[str]:
    today = dt.datetime.now(tz=dt.timezone.utc).date()
    yield '# Estimators'
    yield ''
    yield (
        f'Written by `make estimators` on {today}. The predictions of each analytic method, '
        'which uses only the shape of a part, are compared with shares that were counted by hand '
        f'or by a machine, and with drops of this suite ({KERNEL} {engine_version(KERNEL)}). All '
        'figures are in percent. The three improved estimators of Varkonyi (2014) could not be '
        'obtained.'
    )
    yield ''
    yield '| method | weight of an aspect | source |'
    yield '|---|---|---|'
    for name, method in METHODS.items():
        words = (method.weights.__doc__ or '').split('\n')[0]
        words = words.removeprefix('Return ').rstrip('.')
        yield f'| `{name}` | {words} | {method.source} |'
    yield ''


def _counted() -> Iterator[str]:
    """Compare all methods with the measured cases."""
    yield '## Comparison with measurements'
    yield ''
    yield (
        'Share of rolls that end on the counted faces. Rolls have a high energy, which no method '
        'takes into account. For intervals see validation.md; for sizes and sources see '
        'tools/measured.py. *-*: the method is not defined for the part. Mean and largest '
        'deviation are over the bodies for which all methods are defined, which excludes the '
        'coin.'
    )
    yield ''
    yield '| body | counted | ' + ' | '.join(METHODS) + ' |'
    yield '|---|---|' + '---|' * len(METHODS)
    off: dict[str, list[float]] = {name: [] for name in METHODS}
    for case in cases():
        cells = []
        estimates = _estimates(case.part)
        for name, found in estimates.items():
            if found is None:
                cells.append('-')
                continue
            share = _share(case, found)
            cells.append(f'{100 * share:.1f}')
            if None not in estimates.values():
                off[name].append(abs(share - case.share))
        yield f'| {case.name} | {100 * case.share:.1f} | ' + ' | '.join(cells) + ' |'
    for label, function in (('mean deviation', np.mean), ('largest deviation', np.max)):
        figures = (f'{100 * float(function(each)):.1f}' for each in off.values())
        yield f'| {label} | | ' + ' | '.join(figures) + ' |'
    yield ''


def _dropped(dropper: Dropper) -> Iterator[str]:
    """Compare all methods with drops of the example parts."""
    yield '## Comparison with drops of the example parts'
    yield ''
    yield (
        f'{DROPS} drops of each part on each surface, seed {SEED}. Each cell has the mean and the '
        "largest absolute deviation over the part's aspects. The last line is over the parts for "
        'which all methods are defined, which are the parts with only flat sides.'
    )
    for surface in dropper.surfaces.names():
        yield ''
        yield f'### {surface}'
        yield ''
        yield '| part | aspects | ' + ' | '.join(METHODS) + ' |'
        yield '|---|---|' + '---|' * len(METHODS)
        mean: dict[str, list[float]] = {name: [] for name in METHODS}
        largest: dict[str, list[float]] = {name: [] for name in METHODS}
        for part in track(dropper.parts, surface):
            job = make_job(part, dropper.surfaces.get(surface), SEED)
            counted = dropper.distribution(part, job, DROPS)
            cells = []
            estimates = _estimates(part)
            for name, found in estimates.items():
                if found is None:
                    cells.append('-')
                    continue
                c = compare_with_exact(counted, found.probabilities, np.random.default_rng(SEED))
                if None not in estimates.values():
                    mean[name].append(c.mean_deviation)
                    largest[name].append(_largest(c))
                cells.append(f'{100 * c.mean_deviation:.1f}, {100 * _largest(c):.1f}')
            yield f'| {part.name} | {len(counted.aspects)} | ' + ' | '.join(cells) + ' |'
        figures = (
            f'{100 * np.mean(mean[name]):.1f}, {100 * max(largest[name]):.1f}' for name in METHODS
        )
        yield '| mean of the means, largest of all parts | | ' + ' | '.join(figures) + ' |'
    yield ''


def _by_height(dropper: Dropper) -> Iterator[str]:
    """Compare all methods with drops from heights in proportion to the part."""
    yield '## Comparison by release height'
    yield ''
    yield (
        f'{DROPS} drops of each of {", ".join(OF_HEIGHTS)} on `rubber_mat`, released from '
        'different heights in units of the hull radius R of the part, which is about half its '
        'length. A height of 60 mm is 3 R for a part of 40 mm, and 30 R for a part of 4 mm. Each '
        'cell has the mean over the parts of the mean deviation, and the largest deviation of '
        'all parts.'
    )
    yield ''
    yield '| height | ' + ' | '.join(METHODS) + ' |'
    yield '|---|' + '---|' * len(METHODS)
    parts = [part for part in dropper.parts if part.name in OF_HEIGHTS]
    for radii in track(HEIGHTS, 'heights'):
        mean: dict[str, list[float]] = {name: [] for name in METHODS}
        largest: dict[str, list[float]] = {name: [] for name in METHODS}
        for part in parts:
            conditions = dropper.surfaces.get().changed(height=radii * part.hull_radius)
            counted = dropper.distribution(part, make_job(part, conditions, SEED), DROPS)
            for name, found in _estimates(part).items():
                assert found is not None
                c = compare_with_exact(counted, found.probabilities, np.random.default_rng(SEED))
                mean[name].append(c.mean_deviation)
                largest[name].append(_largest(c))
        cells = (
            f'{100 * np.mean(mean[name]):.1f}, {100 * max(largest[name]):.1f}' for name in METHODS
        )
        yield f'| {radii:g} R | ' + ' | '.join(cells) + ' |'
    yield ''


def _estimates(part: Part) -> Mapping[str, Estimate | None]:
    shape = RestingShape(part)
    found: dict[str, Estimate | None] = {}
    for name in METHODS:
        try:
            found[name] = estimate(shape, name)
        except NotDefinedError:
            found[name] = None
    return found


def _share(case: Case, found: Estimate) -> float:
    on = [case.hits(aspect.down_in_part[None]) for aspect in found.aspects.aspects]
    return float(found.probabilities @ on)


def _largest(comparison: Comparison) -> float:
    return float(np.abs(comparison.deviation).max())


LIMITS = """## What the deviations depend on

The relevant quantity is the release height in proportion to the part, so 60 mm are low for a
large part and high for a small one.

* The methods know no energy. From a high release or a throw, parts leave high and narrow aspects,
  whose probabilities `quasi_static` and `rolling` overestimate; put down gently, they agree with
  these methods. `crsa` increases the differences between aspects, as a higher energy does.
* For a part that rests on a curved side, the deviations of all methods are large, in both
  directions.
* `energy_barrier` ranks the aspects by the energy needed to leave them. It is not a probability.
* Rare aspects are overestimated, as the square faces of the block of 1.60 show.
* No method depends on restitution, friction or height, whereas the shares of drops do.

Drops are compared with the same measured bodies in [Validation](validation.md). 1000 drops of
`l_bracket` on `rubber_mat` take about 0.1 s.
"""


if __name__ == '__main__':
    main()
