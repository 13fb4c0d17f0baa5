"""Remarks on pickable or counted classes of aspects that a robot or a camera confuses."""

from collections.abc import Collection, Sequence
from itertools import combinations

from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.format import ids_text, numbers_text


def divided_class_texts(aspects: AspectSet, pickable: Collection[int]) -> list[str]:
    """Return a sentence for each symmetry class of which only some aspects are pickable.

    Its aspects look the same and lie in the same way, so a robot cannot pick only some of them.
    """
    texts = []
    for members in aspects.classes():
        inside = tuple(aspect for aspect in members if aspect.id in pickable)
        outside = tuple(aspect for aspect in members if aspect.id not in pickable)
        if inside and outside:
            many, other = ('s' if len(each) > 1 else '' for each in (inside, outside))
            texts.append(
                f'the aspects {ids_text(members)} of class {members[0].symmetry_class} look the '
                f'same: a robot that picks aspect{many} {ids_text(inside)} also picks '
                f'aspect{other} {ids_text(outside)}, which {"are" if other else "is"} not '
                'requested as pickable'
            )
    return texts


def look_alike_texts(part: Part, aspects: AspectSet, pickable: Collection[int]) -> list[str]:
    """Return a sentence for each group of classes that look alike and are not all pickable.

    These are the classes with the same outline or its mirror image; see `look_alikes`.
    """
    picked = {
        members[0].symmetry_class
        for members in aspects.classes()
        if all(aspect.id in pickable for aspect in members)
    }
    same, mirrored = _groups(part, aspects)
    texts = [
        f'A camera sees the same outline of {names}: the forecast assumes that vision '
        'distinguishes them in another way.'
        for group in same
        if (names := _picked_text(group, group, picked))
    ]
    texts += [
        f'The outlines of {names}, are mirror images: vision must not match mirrored outlines.'
        for one, other in mirrored
        for pair in ((one, other), (other, one))
        if (names := _picked_text(*pair, picked))
    ]
    return texts


def counted_apart_texts(
    part: Part, aspects: AspectSet, groups: Collection[Collection[int]]
) -> list[str]:
    """Return a sentence for each group of classes with the same outline that are counted apart.

    groups : the symmetry classes that were counted together
    """
    return [
        f'If a camera counts, classes {numbers_text(group)} have the same outline, and can be '
        f'counted together as {"+".join(map(str, group))}.'
        for group in _groups(part, aspects)[0]
        if len(group) > 1 and not any(set(group) <= set(each) for each in groups)
    ]


def _picked_text(one: Sequence[int], other: Sequence[int], picked: Collection[int]) -> str:
    """Return the pickable classes of a group, and those of another that are not; can be empty."""
    inside = [number for number in one if number in picked]
    outside = [number for number in other if number not in picked]
    if not (inside and outside):
        return ''
    first, second = (
        f'class{"es" if len(each) > 1 else ""} {numbers_text(each)}, which '
        f'{"are" if len(each) > 1 else "is"}'
        for each in (inside, outside)
    )
    return f'{first} pickable, and {second} not'


def _groups(
    part: Part, aspects: AspectSet
) -> tuple[list[tuple[int, ...]], list[tuple[tuple[int, ...], tuple[int, ...]]]]:
    """Return the groups of classes with one outline, and the pairs of groups that are mirrored."""
    # The import of shapely is only needed here.
    from resting_aspects_ros.vision.outline import find_outlines, look_alikes, same_groups

    found = look_alikes(find_outlines(part, aspects))
    groups = same_groups(found)
    mirrored = [
        (one, other)
        for one, other in combinations(groups, 2)
        for entry in found[one[0]]
        if entry.symmetry_class == other[0] and entry.verdict == 'mirrored'
    ]
    return groups, mirrored
