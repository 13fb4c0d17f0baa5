"""The findings of a study in words: whether it is worth while to measure a factor."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from resting_aspects_ros.studies.design import Factor
from resting_aspects_ros.studies.effects import Change, Effects
from resting_aspects_ros.studies.study_cases import StudyCase

# Smaller irregular changes are not mentioned.
IRREGULAR = 0.005
# Largest number of times that is stated; more are not practical.
MAX_TIMES = 100
WORTH, NOT_WORTH, OPEN = 'worth while', 'not worth while', 'not decided'


@dataclass(frozen=True)
class Finding:
    """What one factor does to one case.

    verdict : str
        Whether it is worth while to measure or to control the factor: WORTH, NOT_WORTH or OPEN.
    sentence : str
        The largest change and the verdict.
    details : str
        Where that change is, and how large the changes are on average.
    """

    case: str
    factor: str
    verdict: str
    sentence: str
    details: str = ''

    @property
    def text(self) -> str:
        """The sentence and the details."""
        return f'{self.sentence} {self.details}'.rstrip()


def findings_of(
    case: StudyCase,
    effects: Effects | None,
    factors: Sequence[Factor],
    tolerance: float,
    confidence: float,
) -> Iterator[Finding]:
    """Yield a finding for each factor, that with the largest change first."""
    if effects is None:
        for factor in factors:
            verdict = NOT_WORTH if len(case.columns) < 2 else OPEN
            yield Finding(case.name, factor.name, verdict, _nothing(case, factor))
        return
    for k in np.argsort([-change.change for change in effects.changes]).tolist():
        change, factor = effects.changes[k], factors[k]
        yield Finding(
            case.name,
            factor.name,
            _verdict(change, effects, tolerance),
            _sentence(effects, change, factor, tolerance, confidence),
            _where(effects, change, factors, k),
        )


def _verdict(change: Change, effects: Effects, tolerance: float) -> str:
    if not effects.reliable(tolerance):
        return OPEN
    if change.lower > tolerance:
        return WORTH
    return NOT_WORTH if change.upper <= tolerance else OPEN


def _sentence(
    effects: Effects,
    change: Change,
    factor: Factor,
    tolerance: float,
    confidence: float,
) -> str:
    name = factor.label or factor.name
    verdict = _verdict(change, effects, tolerance)
    limit = points_text(tolerance)
    moved = (
        f'{name[0].upper()}{name[1:]} moves the shares by at most {points_text(change.change)} '
        f'points ({100 * confidence:g} % interval {points_text(change.lower)} to '
        f'{points_text(change.upper)})'
    )
    if verdict == WORTH:
        end = f'more than the tolerance of {limit} points: measuring it is worth while.'
    elif verdict == NOT_WORTH:
        end = f'not more than the tolerance of {limit} points: measuring it is not worth while.'
    elif effects.reliable(tolerance):
        end = (
            f'which contains the tolerance of {limit} points: {_times(change, tolerance)} '
            'times as many points would decide whether measuring it is worth while.'
        )
    else:
        end = (
            f'but the surrogate explains only {100 * effects.explained:.0f} % of the differences '
            'between the points: more points are needed to tell whether measuring it is worth '
            'while.'
        )
    joint = ', ' if verdict != OPEN or effects.reliable(tolerance) else '; '
    return f'{moved}{joint}{end}'


def _where(effects: Effects, change: Change, factors: Sequence[Factor], k: int) -> str:
    """Say where the largest change is, and how large it is on average."""
    factor = factors[k]
    ends = [factor.text(float(factor.values(each[k]))) for each in (change.start, change.end)]
    rest = [
        f'{each.label or each.name} {each.text(float(each.values(change.start[j])))}'
        for j, each in enumerate(factors)
        if j != k
    ]
    at = f', at {" and ".join(rest)}' if rest else ''
    text = (
        f'The share of {effects.columns[change.column]} is {100 * change.low:.1f} % at '
        f'{ends[0]} and {100 * change.high:.1f} % at {ends[1]}{at}.'
    )
    if rest:
        text += (
            f' On average over the other factors, shares move by at most '
            f'{points_text(change.average)} points.'
        )
    return text


def _times(change: Change, tolerance: float) -> str:
    """Return how many times as many points an interval needs that excludes the tolerance.

    Its width falls with the square root of their number.
    """
    half = (change.upper - change.lower) / 2
    gap = max(abs(change.change - tolerance), 1e-9)
    times = max(2, math.ceil((half / gap) ** 2))
    return f'about {times}' if times <= MAX_TIMES else f'more than {MAX_TIMES}'


def irregular_text(effects: Effects) -> str:
    """Return a sentence on changes that the findings do not contain; empty if they are small."""
    error = effects.cross_validated_error
    if error <= IRREGULAR:
        return ''
    return (
        f'Irregular changes of {points_text(error)} points (root mean square), which no smooth '
        'curve describes, come on top of these changes.'
    )


def _nothing(case: StudyCase, factor: Factor) -> str:
    name = factor.label or factor.name
    if len(case.columns) < 2:
        return (
            f'{name[0].upper()}{name[1:]} cannot move the shares: all drops are in '
            f'{case.columns[0]}.'
        )
    return f'{name[0].upper()}{name[1:]}: too few points with drops to tell what it does.'


def points_text(share: float) -> str:
    """Return a difference of shares in points, such as '3.1' or '12'."""
    value = 100 * share
    return f'{value:.2g}' if abs(value) < 10 else f'{value:.0f}'
