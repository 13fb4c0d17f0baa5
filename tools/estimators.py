"""Compare the analytic methods with measurements and with drops.

Writes docs/explanation/estimators.md. Takes some minutes on two cores.
"""

import datetime as dt
from collections.abc import Iterator, Mapping

import numpy as np
from dropper import ROOT, SEED, Dropper
from learned_page import without_section
from measured import Case, cases
from rich.console import Console
from rich.progress import track

from resting_aspects_ros.api.recommended_method import release_numbers
from resting_aspects_ros.core.estimators.estimate import METHODS, Estimate, estimate
from resting_aspects_ros.core.estimators.resting_shape import NotDefinedError, RestingShape
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.statistics.comparison import Comparison, compare_with_exact
from resting_aspects_ros.simulation.conditions import DropConditions
from resting_aspects_ros.simulation.local_workers import LocalWorkers, default_workers
from resting_aspects_ros.simulation.plan import ENGINE, ENGINE_VERSION, make_job
from resting_aspects_ros.simulation.surfaces import Surfaces

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
        for section in (_counted(dropper.surfaces), _dropped(dropper), _by_height(dropper)):
            for line in section:
                console.print(line, highlight=False, soft_wrap=True)
                lines.append(line)
    finally:
        workers.stop()
    # The section on random solids is written by `make learned`.
    lines += without_section(RESULT.read_text(encoding='utf-8'))[1].splitlines()
    lines += ADVICE.splitlines()
    RESULT.write_text('\n'.join(lines) + '\n', encoding='utf-8')
    print(f'Written: {RESULT}')


def _heading() -> Iterator[str]:
    today = dt.datetime.now(tz=dt.timezone.utc).date()
    yield '# Estimators'
    yield ''
    yield (
        f'Written by `make estimators` on {today}. The predictions of each analytic method, '
        'which uses only the shape of a part, and of `learned`, which uses the conditions, too, '
        'are compared with shares that were counted by hand or by a machine, and with drops of '
        f'this suite ({ENGINE} {ENGINE_VERSION}). All figures are in percent. The three improved '
        'estimators of Varkonyi (2014) could not be obtained.'
    )
    yield ''
    yield '| method | weight of an aspect | source |'
    yield '|---|---|---|'
    for name, method in METHODS.items():
        words = (method.weights.__doc__ or '').split('\n')[0]
        words = words.removeprefix('Return ').rstrip('.')
        yield f'| `{name}` | {words} | {method.source} |'
    yield ''


def _counted(surfaces: Surfaces) -> Iterator[str]:
    """Compare all methods with the measured cases."""
    yield '## Comparison with measurements'
    yield ''
    yield (
        'Share of rolls that end on the counted faces. Rolls have a high energy, which no '
        'analytic method takes into account; `learned` has the conditions of `thrown`. For '
        'intervals see validation.md; for sizes and sources see '
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
        estimates = _estimates(case.part, surfaces.get('thrown'))
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
            estimates = _estimates(part, dropper.surfaces.get(surface))
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
            for name, found in _estimates(part, conditions).items():
                assert found is not None
                c = compare_with_exact(counted, found.probabilities, np.random.default_rng(SEED))
                mean[name].append(c.mean_deviation)
                largest[name].append(_largest(c))
        cells = (
            f'{100 * np.mean(mean[name]):.1f}, {100 * max(largest[name]):.1f}' for name in METHODS
        )
        yield f'| {radii:g} R | ' + ' | '.join(cells) + ' |'
    yield ''


def _estimates(part: Part, conditions: DropConditions) -> Mapping[str, Estimate | None]:
    shape = RestingShape(part)
    release = release_numbers(shape, conditions)
    found: dict[str, Estimate | None] = {}
    for name in METHODS:
        try:
            found[name] = estimate(shape, name, release)
        except NotDefinedError:
            found[name] = None
    return found


def _share(case: Case, found: Estimate) -> float:
    on = [case.hits(aspect.down_in_part[None]) for aspect in found.aspects.aspects]
    return float(found.probabilities @ on)


def _largest(comparison: Comparison) -> float:
    return float(np.abs(comparison.deviation).max())


ADVICE = """## Which method to use

This section refers to the tables above as they were on 2026-11-21. The relevant quantity is the
release height in proportion to the part, so 60 mm are low for a large part and high for a small
one. Deviations are in percentage points.

* **Known conditions within those of the fit** (releases from 0.05 to 30 R, restitution up to
  0.85, friction up to 0.8, and throws; see *Comparison with drops of random solids*): use
  `learned`. On random solids of kinds that were left out of its fit, its root mean square
  deviation is about half of that of the best analytic method for parts with flat sides, and
  lower for every kind and in every band of conditions. In 30 cases with about 20,000 drops each,
  its mean deviation is 2.1 (1.4 with flat sides, 3.8 with a curved side), that of the best
  analytic method 5.0; the aim of 1.0 is not reached. It states how certain it is. The advice
  below is for other conditions, and for conditions that are not known.
* **How sensitive a part is to its surface or height**: use no method, but `study` or
  `drop --propagate`. `learned` is smoother than the drops, whose shares rise and fall with
  restitution and height, probably because parts turn by similar angles between their first
  impacts. For restitutions of 0.10, 0.29, 0.57 and 0.85 on `rubber_mat`, the share of class 1 of
  t_prism is 0.51, 0.69, 0.57 and 0.68 (2000 drops each), by `learned` 0.57, 0.60, 0.64 and 0.69;
  that of the side of the cylinder is 0.73, 0.55, 0.56 and 0.66, by `learned` 0.63 to 0.64. With
  standard deviations of 0.1 for the restitution and 35 % for the friction, the largest standard
  deviation of a share of t_prism is 5.1 by drops and 1.6 by `learned`, and 6.4 and 1.8 for the
  cylinder (32 samples of 1000 drops).
* **Flat sides, from 0.5 to 10 R** (`rubber_mat` and `steel` for parts of a few centimetres):
  use `csa`. Its mean deviation is 0.6 to 1.2 in the table by height, and its largest deviation
  is 4.0. For the example parts on the two surfaces, the mean deviation is 0.9 and 1.2 (2.4 for
  t_prism on steel).
* **Flat sides, from 30 R, thrown or rolled** (small parts; `thrown`; the measured bodies): use
  `crsa`. It increases the differences between aspects, as a higher energy does. Its mean
  deviation is 1.3 from 30 R, 1.5 for the example parts on `thrown`, and 4.1 for the blocks and
  dice. For low releases, its differences are too large.
* **Flat sides, put down or released just above the surface** (0.1 R): use `quasi_static` or
  `rolling`, with mean deviations of 0.6 to 0.7. In higher drops, parts have enough energy to
  leave high and narrow aspects, whose probabilities these methods overestimate: the mean
  deviation is 4 to 6 from 0.5 R, and up to 30 for a rolled block. A slender bar leaves such
  aspects at any height, because rocking is enough.
* **A part that rests on a curved side**: use no analytic method, but simulate drops. The
  root mean square deviation of `learned` for such parts is about 7. Those of the others are
  5 to 55 in both directions: for the side of the cylinder, the methods with solid angles are 10
  to 18 too high and `energy_barrier` is 21 to 56 too low; for the rim of the coin, the
  deviations are 9 too high or 4 too low; for a dome, the signs can be reversed. If the curved
  side has a low probability, such as the rim of a washer, `csa` is within 1.
* `energy_barrier` ranks the aspects by the energy needed to leave them. It is not a
  probability.
* **Rare aspects**: use no analytic method. For the block of 1.60, 1.7 % of the rolls end on a
  square face, but the methods predict 7 to 26 %. Only drops, with their intervals, predict rare
  aspects.

Drops of this suite have a mean deviation of 3.3 for the same measured bodies
([validation.md](validation.md)), with conditions of which four values were fitted to these
bodies (3.0 for a body that was left out of the fit). In the literature, `csa`, `crsa` and
`stability` have mean deviations of 8.5 to 11.1 from manual drops of parts shaped like sectors
of a cylinder. Such parts rest on a curved side, which has no polygon that `crsa` and
`stability` need, so these two methods are not defined for them here.
"""


if __name__ == '__main__':
    main()
