"""Outlines as text: a table for the terminal, and which classes look alike."""

from collections.abc import Collection, Mapping, Sequence
from itertools import combinations, pairwise

import numpy as np
from rich.table import Table

from resting_aspects_ros.aspects.aspect_set import Aspect, AspectSet
from resting_aspects_ros.report.outline_document import LookAlikes
from resting_aspects_ros.report.rounding import millimetre_texts, number_text
from resting_aspects_ros.report.rows import ids_text, numbers_text
from resting_aspects_ros.report.table import NOTHING, plain_table
from resting_aspects_ros.vision.outline import LookAlike, Outline, same_groups

# Outlines that differ by less than this share of their length are hard to distinguish.
HARD = 0.02
# Heights that differ by more than this share of the larger one distinguish classes.
HEIGHT_DIFFERENCE = 0.05
MAX_GROUPS = 12
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


def confused_class_texts(outlines: Sequence[Outline], look_alikes: LookAlikes) -> list[str]:
    """Return a sentence for each group of classes that a camera confuses, the worst first."""
    by_number = {each.symmetry_class: each for each in outlines}
    groups = {group[0]: group for group in same_groups(look_alikes)}
    texts = [
        _same_text([by_number[number] for number in group])
        for group in groups.values()
        if len(group) > 1
    ]
    # The first class of each group represents the others, which have the same outline.
    pairs = {
        (one, each.symmetry_class): each
        for one in groups
        for each in _near(by_number[one], look_alikes[one])
        if one < each.symmetry_class and each.symmetry_class in groups
    }
    covered: set[tuple[int, int]] = set()
    for pair in sorted(pairs, key=lambda pair: _order(pairs[pair])):
        if pair not in covered:
            inside = list(combinations(_alike(pair, pairs), 2))
            covered.update(inside)
            texts.append(_group_text(inside, pairs, groups))
    if len(texts) > MAX_GROUPS:
        more = len(texts) - MAX_GROUPS
        texts[MAX_GROUPS:] = [f'{more} more groups look alike; --json lists all pairs.']
    return texts


def _alike(pair: tuple[int, int], pairs: Collection[tuple[int, int]]) -> list[int]:
    """Return classes, ascending, all pairs of which are in ``pairs``; the given pair is one."""
    group = list(pair)
    for number in sorted({number for each in pairs for number in each} - {*pair}):
        if all((min(number, other), max(number, other)) in pairs for other in group):
            group.append(number)
    return sorted(group)


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
    return (
        f'distinct by {_mm(entry.resolution)} mm' if entry.verdict == 'distinct' else entry.verdict
    )


def _same_text(outlines: Sequence[Outline]) -> str:
    """Return what distinguishes classes with the same outline."""
    classes = numbers_text([each.symmetry_class for each in outlines])
    heights = sorted(each.height for each in outlines)
    clear = [high - low > HEIGHT_DIFFERENCE * high for low, high in pairwise(heights)]
    measured = [f'{_mm(each.height)}' for each in outlines]
    values = f'{", ".join(measured[:-1])} and {measured[-1]} mm'
    if all(clear):
        needed = f'a measured height does: {values}'
    elif any(clear):
        needed = f'a measured height does for some ({values}), grey values for the others'
    else:
        needed = 'grey values of the upper side are needed'
    return f'Classes {classes} have the same outline. No resolution distinguishes them; {needed}.'


def _group_text(
    inside: Sequence[tuple[int, int]],
    pairs: Mapping[tuple[int, int], LookAlike],
    groups: Mapping[int, tuple[int, ...]],
) -> str:
    """Return what distinguishes classes whose outlines are mirror images, or almost the same."""
    entries = [pairs[pair] for pair in inside]
    sizes = [_mm(each(entry.resolution for entry in entries)) for each in (min, max)]
    mirrors = any(entry.verdict == 'mirrored' for entry in entries)
    if mirrors and len(entries) == 1:
        one, other = (numbers_text(groups[number]) for number in inside[0])
        return (
            f'Classes {one} and {other} show mirror images of each other. Only a match that does '
            f'not accept mirrored outlines distinguishes them; it needs a resolution of '
            f'{sizes[0]} mm.'
        )
    numbers = sorted({k for pair in inside for number in pair for k in groups[number]})
    text = f'Classes {numbers_text(numbers)} differ by '
    text += f'at most {sizes[0]}' if sizes[0] == sizes[1] else ' to '.join(sizes)
    text += ' mm: the camera must resolve details of this size.'
    if mirrors:
        text += (
            ' Some show mirror images of each other: a match must not accept mirrored outlines.'
        )
    return text


def _mm(length: float) -> str:
    return number_text(1000 * length)
