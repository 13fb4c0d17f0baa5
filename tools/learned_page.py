"""The section on random solids in docs/explanation/estimators.md."""

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from learned_drops import BANDS, ROOT
from learned_judge import (
    CONFIDENCE,
    Judgement,
    Judgements,
    coverage,
    mean_deviation,
    true_deviation,
)
from learned_solids import KINDS

from resting_aspects_ros.core.estimators.estimate import LEARNED, METHODS

PAGE = ROOT / 'docs' / 'explanation' / 'estimators.md'
HEADING = '## Comparison with drops of random solids'
ANALYTIC = tuple(name for name in METHODS if name != LEARNED)


def write_section(found: Judgements) -> None:
    """Replace the section of the page, or add it before the advice."""
    page = PAGE.read_text(encoding='utf-8')
    before, old, after = without_section(page)
    del old
    PAGE.write_text(before + '\n'.join([*section(found), '']) + after, encoding='utf-8')
    print(f'Written: {PAGE}')


def without_section(page: str) -> tuple[str, str, str]:
    """Return the page before the section, the section, and the page after it."""
    start = page.find(HEADING + '\n')
    if start < 0:
        start = end = page.find('## Which method to use\n')
    else:
        end = page.find('\n## ', start) + 1
    return page[:start], page[start:end], page[end:]


def section(found: Judgements) -> Iterator[str]:
    """Yield the lines of the section."""
    training, test = found.training, found.test
    yield HEADING
    yield ''
    yield (
        'Written by `make learned`. This repeats, with friction, the study of Varkonyi (2014), '
        'who ranked the estimators on random polyhedra. The three improved estimators of that '
        'study could not be obtained, so they are not compared. The solids are of the kinds '
        f'{", ".join(f"`{kind}`" for kind in KINDS)} (see `tools/learned_solids.py`). Each is '
        'dropped under the conditions of a Sobol design (`design`) and under those of a band: the '
        'named surfaces for parts with hull radii of 5 to 60 mm, and a hard surface without '
        'friction. All predictions of `learned` are by a fit without the kind of the solid.'
    )
    yield ''
    drops = sum(each.drops for each in training)
    yield (
        f'*Training set*: {drops} drops in {len(training)} cases of '
        f'{len({each.case.solid for each in training})} solids. So few drops of each case deviate '
        'by chance. The table has the root of the mean squared deviation, from which that of '
        'sampling is subtracted, in percentage points.'
    )
    yield ''
    yield from _table(training, true_deviation)
    if test:
        few, many = (f([each.drops for each in test]) for f in (min, max))
        size = str(many) if few == many else f'{few} to {many}'
        yield (
            f'*Test set*: {len(test)} cases of other solids with {size} drops each in an aspect. '
            'The table has the mean over the cases of the mean absolute deviation over the '
            'aspects, in percentage points.'
        )
        yield ''
        yield from _table(test, mean_deviation)
    yield from _certainty(training, test)


def _table(
    judgements: Sequence[Judgement], figure: Callable[[Sequence[Judgement], str], float]
) -> Iterator[str]:
    yield '| cases | n | ' + ' | '.join(METHODS) + ' | learned - best |'
    yield '|---|---|' + '---|' * (len(METHODS) + 1)
    for name, chosen in _groups(judgements):
        if not chosen:
            continue
        figures = {method: figure(chosen, method) for method in METHODS}
        # A method that is not defined for all cases is compared on other cases.
        complete = [m for m in ANALYTIC if all(m in each.deviations for each in chosen)]
        difference = figures[LEARNED] - min(figures[m] for m in complete)
        cells = [
            '-'
            if np.isnan(value)
            else f'{100 * value:.1f}' + '*' * (m not in (*complete, LEARNED))
            for m, value in figures.items()
        ]
        yield f'| {name} | {len(chosen)} | ' + ' | '.join(cells) + f' | {100 * difference:+.1f} |'
    yield ''
    yield '*: not defined for all of the cases.'
    yield ''


def _groups(judgements: Sequence[Judgement]) -> Iterator[tuple[str, list[Judgement]]]:
    yield 'all', list(judgements)
    yield 'only flat sides', [each for each in judgements if not each.curved]
    yield 'with a curved side', [each for each in judgements if each.curved]
    for kind in KINDS:
        yield f'`{kind}`', [each for each in judgements if each.case.kind == kind]
    for band in (*BANDS, 'design'):
        yield f'`{band}`', [each for each in judgements if each.case.band == band]
        flat = [each for each in judgements if each.case.band == band and not each.curved]
        yield f'`{band}`, only flat sides', flat


def _certainty(training: Sequence[Judgement], test: Sequence[Judgement]) -> Iterator[str]:
    weights = np.array([each.weight for each in training])
    low, middle, high = np.quantile(weights, [0.05, 0.5, 0.95])
    text = (
        f'`learned` states its uncertainty as a weight: it is as certain as {middle:.0f} drops '
        f'(median; 5 % and 95 % quantiles {low:.0f} and {high:.0f}). Its {CONFIDENCE:.0%} '
        f'intervals contain {coverage(training):.1%} of the counts of the training set'
    )
    yield text + (f' and {coverage(test):.1%} of those of the test set.' if test else '.')
    yield ''
