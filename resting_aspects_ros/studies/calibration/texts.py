"""A calibration in words and tables."""

import math
import textwrap
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from resting_aspects_ros.studies.calibration.summary import Estimate, correlation, discrepancy

if TYPE_CHECKING:
    from resting_aspects_ros.studies.calibration.checks import Prediction
    from resting_aspects_ros.studies.calibration.comparison import SurfaceComparison
    from resting_aspects_ros.studies.calibration.fitted_surface import FittedSurface

# Factors are said to trade off if their correlation is at least this.
TRADE_OFF = 0.5
# An interval is cut off if it ends within this share of its range.
NEAR_END = 0.02
WIDTH = 80


def result_text(result: 'FittedSurface') -> str:
    """Return the result for a terminal."""
    given = result.fit.given
    head = (
        f'{result.surface}: {len(given.parts)} part{"s" * (len(given.parts) > 1)}, '
        f'{given.drops} counted drops, {result.fit.simulated_drops} simulated drops at '
        f'{len(result.fit.points)} points'
    )
    lines = [head, '', *_estimate_table(result.estimates), '', *_share_table(result), '']
    for sentence in statements(result):
        lines += textwrap.wrap(sentence, WIDTH)
    return '\n'.join(lines)


def statements(result: 'FittedSurface') -> list[str]:
    """Return what the counts say, and what they do not determine, one sentence each."""
    return [
        *_on_agreement(result),
        *(_on_estimate(each) for each in result.estimates),
        *_on_ends(result.estimates),
        *_on_trade_offs(result),
        *_on_left_out(result),
        *_on_error(result),
    ]


def source_text(result: 'FittedSurface') -> str:
    """Return the source of the surface: counts, uncertainty, and what was not determined."""
    given = result.fit.given
    names = ', '.join(part.name for part in given.parts[:5])
    if len(given.parts) > 5:
        names += f' and {len(given.parts) - 5} more'
    found = [f'Calibrated to {given.drops} counted drops of {names}.']
    if given.source:
        found.append(f'{given.source.rstrip(".")}.')
    return ' '.join([*found, *statements(result)])


def wrapped(text: str, width: int) -> list[str]:
    """Return the lines of a text that YAML can fold again."""
    return textwrap.wrap(' '.join(text.split()), width, break_long_words=False)


def comparison_text(found: 'SurfaceComparison') -> str:
    """Describe the comparison of two surfaces."""
    names = f'{found.one} and {found.other}'
    sentences = []
    if found.same_parts_p is not None:
        differ = 'differ' if found.same_parts_p < 0.01 else 'do not differ significantly'
        p = f'{found.same_parts_p:.2g}'
        sentences.append(f'{names}: the counts of the same parts {differ} (G test, p = {p})')
    ratio = math.exp(min(abs(found.log_ratio), 300))
    two = found.log_ratio > 0
    sentences.append(
        f'{names}: all counts are {ratio:.3g} times more probable with '
        f'{"two surfaces than with one" if two else "one surface than with two"}; the fitted '
        f'conditions overlap by {100 * found.overlap:.0f} %'
    )
    if found.same_parts:
        sentences.append(
            'Both have the same parts, so that the simulation deviates from both in the same way: '
            'only sampling is taken into account'
        )
    return '.\n'.join(sentences) + '.'


def _on_agreement(result: 'FittedSurface') -> Iterator[str]:
    fitted = _listed([each.factor.label for each in result.estimates])
    p = result.g_test.p
    if math.isnan(p):
        yield 'Whether the simulation can explain these counts could not be tested.'
    elif not result.contradicted:
        yield f'The simulation can explain these counts within sampling (G test, p = {p:.2g}).'
    else:
        yield (
            f'No {fitted.replace(" and ", " or ")} within the ranges explain these counts within '
            f'sampling (G test, p = {p:.2g}).'
        )
    if not result.fit.discrepancy:
        return
    mean, low, high = discrepancy(result.fit)
    if len(result.fit.given.parts) == 1:
        yield (
            f'A deviation of the simulation by {50 * mean:.1f} points at a share of 50 % '
            '(standard deviation) is assumed: the counts of one part cannot tell it.'
        )
        return
    yield (
        f'Beyond sampling, a share of 50 % deviates from the simulation by {50 * mean:.1f} points '
        f'(standard deviation; 90 % interval {50 * low:.1f} to {50 * high:.1f}).'
    )
    if not result.usable:
        yield (
            'This is too much for a surface: check the counts, the release and the ranges before '
            'using these values.'
        )


def _on_estimate(each: Estimate) -> str:
    factor = each.factor
    low, high = _number(each.low), _number(each.high)
    unit = f' {factor.unit}' if factor.unit else ''
    if each.determined:
        return f'The {factor.label} is {_number(each.mean)}{unit} (90 %: {low} to {high}).'
    return (
        f'These counts do not determine the {factor.label}: {low} to {high}{unit} fit about '
        'equally.'
    )


def _on_ends(found: Sequence[Estimate]) -> Iterator[str]:
    """Name determined conditions whose interval ends where their range does."""
    for each in found:
        factor = each.factor
        low, high = factor.shares(np.array([each.low, each.high])).tolist()
        if each.determined and (low < NEAR_END or high > 1 - NEAR_END):
            yield (
                f'The interval of the {factor.label} ends where its range does: if a wider range '
                f'of {factor.name} is possible, state it below conditions.'
            )


def _on_trade_offs(result: 'FittedSurface') -> Iterator[str]:
    found = result.estimates
    for k, one in enumerate(found):
        for j in range(k + 1, len(found)):
            value = correlation(result.fit, k, j)
            if abs(value) >= TRADE_OFF:
                sign = 'more' if value > 0 else 'less'
                yield (
                    f'More {one.factor.label} with {sign} {found[j].factor.label} fits as well '
                    f'(correlation {value:+.2f}): use the pairs of the picture, not the intervals.'
                )


def _on_left_out(result: 'FittedSurface') -> Iterator[str]:
    if not result.left_out:
        return
    inside = sum(each.inside for each in result.left_out)
    yield (
        f'Parts that were left out are predicted with a mean absolute deviation of '
        f'{100 * result.left_out_deviation:.1f} points; {inside} of {len(result.left_out)} are '
        'within their 90 % intervals.'
    )


def _on_error(result: 'FittedSurface') -> Iterator[str]:
    from resting_aspects_ros.studies.calibration.fit import MAX_ERROR

    worst = float(result.fit.errors.max())
    if worst > MAX_ERROR:
        yield (
            f'The model of the shares has an error of {worst:.2f} of that of the counts, which '
            'widens the intervals and weakens the G test: more drops (--drops) would help.'
        )


def _estimate_table(found: Sequence[Estimate]) -> Iterator[str]:
    yield f'{"condition":<26}{"best":>9}{"mean":>9}{"sd":>8}  {"90 % interval":<20}{"range"}'
    for each in found:
        factor = each.factor
        best, mean, deviation, low, high, least, most = (
            _number(factor.scale * value)
            for value in (
                *(each.best, each.mean, each.deviation, each.low, each.high),
                *(factor.low, factor.high),
            )
        )
        yield (
            f'{factor.title[:25]:<26}{best:>9}{mean:>9}{deviation:>8}  '
            f'{f"{low} to {high}":<20}{least} to {most}'
        )


def _share_table(result: 'FittedSurface') -> Iterator[str]:
    yield f'{"part":<20}{"group":<12}{"counted":>8}{"fitted":>8}{"left out":>9}  90 % interval'
    for k, part in enumerate(result.fit.given.parts):
        left: Prediction | None = result.left_out[k] if result.left_out else None
        fitted = result.predictions[k]
        shown = range(len(part.names)) if len(part.names) > 2 else range(1)
        for j in shown:
            interval = left or fitted
            yield (
                f'{part.name[:19] if j == 0 else "":<20}{part.names[j][:11]:<12}'
                f'{100 * fitted.counted[j]:>6.1f} %{100 * fitted.model[j]:>6.1f} %'
                + (f'{100 * left.model[j]:>7.1f} %' if left else f'{"":>9}')
                + f'  {100 * interval.low[j]:.1f} to {100 * interval.high[j]:.1f} %'
                + ('' if interval.low[j] <= fitted.counted[j] <= interval.high[j] else '  outside')
            )


def _number(value: float) -> str:
    return f'{value:.2g}' if abs(value) < 10 else f'{value:.0f}'


def _listed(words: Sequence[str]) -> str:
    *most, last = words
    return f'{", ".join(most)} and {last}' if most else last
