"""Outlines as text: a table for the terminal, and which classes look alike."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from rich.table import Table

from resting_aspects_ros.core.aspects.aspect_set import Aspect, AspectSet
from resting_aspects_ros.core.vision.look_alikes import LookAlike
from resting_aspects_ros.core.vision.outline import Outline
from resting_aspects_ros.report.outline_document import LookAlikes
from resting_aspects_ros.report.rounding import millimetre_texts, number_text
from resting_aspects_ros.report.rows import ids_text
from resting_aspects_ros.report.table import NOTHING, plain_table

# Outlines that differ by less than this share of their length are hard to distinguish.
HARD = 0.02
# Heights that differ by more than this share of the larger one distinguish classes.
HEIGHT_DIFFERENCE = 0.05
MAX_PAIRS = 12
# Maximum number of classes in the list of those that look like a class.
MAX_LISTED = 3
_VERDICTS = ('same', 'mirrored', 'distinct')


def members(outline: Outline, aspects: AspectSet) -> tuple[Aspect, ...]:
    """Return the aspects of the symmetry class of an outline."""
    return tuple(aspect for aspect in aspects.aspects if aspect.id in outline.aspects)


def outline_table(
    outlines: Sequence[Outline], look_alikes: LookAlikes, aspects: AspectSet, title: str
) -> Table:
    """Return a table with a row for each symmetry class; it fits 80 columns and is ASCII."""
    table = plain_table(
        title,
        'class',
        'aspects',
        'length x width\nx height (mm)',
        'area\n(mm2)',
        'yaw\nsymmetry',
    )
    table.add_column('looks like', max_width=22)
    sizes = [[each.length, each.width, each.height] for each in outlines]
    texts = iter(millimetre_texts(np.ravel(sizes)))
    for each in outlines:
        table.add_row(
            str(each.symmetry_class),
            ids_text(members(each, aspects)),
            ' x '.join(next(texts) for _ in range(3)),
            number_text(1e6 * each.area),
            yaw_symmetry_text(each.yaw_symmetry),
            _list_text(each, look_alikes[each.symmetry_class]) or NOTHING,
        )
    return table


def yaw_symmetry_text(order: int) -> str:
    """Return by which turns an outline looks the same: 'none', '120 deg' or 'any turn'."""
    if order == 1:
        return 'none'
    return f'{360 / order:.4g} deg' if order else 'any turn'


def confused_pair_texts(outlines: Sequence[Outline], look_alikes: LookAlikes) -> list[str]:
    """Return a sentence for each pair of classes that a camera confuses, the worst first."""
    pairs = []
    for one, other in combinations(outlines, 2):
        near = {each.symmetry_class: each for each in _near(one, look_alikes[one.symmetry_class])}
        if entry := near.get(other.symmetry_class):
            pairs.append((_order(entry), _pair_text(one, other, entry)))
    pairs.sort(key=lambda pair: pair[0])
    texts = [text for _, text in pairs[:MAX_PAIRS]]
    if len(pairs) > MAX_PAIRS:
        texts.append(f'{len(pairs) - MAX_PAIRS} more pairs look alike; --json lists all pairs.')
    return texts


def family_texts(outlines: Sequence[Outline]) -> list[str]:
    """Return a sentence for each class whose outline changes as the part rolls or rocks."""
    return [
        f'The outline of class {each.symmetry_class} changes while the part rolls or rocks: '
        f'--json contains {len(each.family)} more.'
        for each in outlines
        if each.family
    ]


def short_look_alike_text(outline: Outline, others: Sequence[LookAlike]) -> str:
    """Return the classes with which a camera confuses a class, with the reasons; can be empty."""
    text = _list_text(outline, others)
    return f'class {text}' if text else ''


def _list_text(outline: Outline, others: Sequence[LookAlike]) -> str:
    near = _near(outline, others)
    texts = [f'{each.symmetry_class} ({_reason(each)})' for each in near[:MAX_LISTED]]
    if len(near) > MAX_LISTED:
        texts.append(f'{len(near) - MAX_LISTED} more')
    return ', '.join(texts)


def _near(outline: Outline, others: Sequence[LookAlike]) -> list[LookAlike]:
    """Return the entries of classes that a camera can hardly distinguish, the worst first."""
    hard = HARD * outline.length
    near = [each for each in others if each.verdict != 'distinct' or each.resolution < hard]
    return sorted(near, key=_order)


def _order(entry: LookAlike) -> tuple[int, float]:
    return _VERDICTS.index(entry.verdict), entry.resolution


def _reason(entry: LookAlike) -> str:
    return f'within {_mm(entry.resolution)} mm' if entry.verdict == 'distinct' else entry.verdict


def _pair_text(one: Outline, other: Outline, entry: LookAlike) -> str:
    classes = f'Classes {one.symmetry_class} and {other.symmetry_class}'
    size = f'{_mm(entry.resolution)} mm'
    if entry.verdict == 'mirrored':
        return (
            f'{classes} show mirror images of each other. Only a match that does not accept '
            f'mirrored outlines distinguishes them; it needs a resolution of {size}.'
        )
    if entry.verdict == 'distinct':
        return f'{classes} differ by at most {size}: the camera must resolve details of this size.'
    low, high = sorted((one.height, other.height))
    if high - low > HEIGHT_DIFFERENCE * high:
        needed = f'a measured height does: {_mm(one.height)} and {_mm(other.height)} mm'
    else:
        needed = 'grey values of the upper side are needed'
    return f'{classes} have the same outline. No resolution distinguishes them; {needed}.'


def _mm(length: float) -> str:
    return number_text(1000 * length)
