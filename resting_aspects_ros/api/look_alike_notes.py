"""Remarks on pickable or counted classes of aspects that a robot or a camera confuses."""

from collections.abc import Collection, Iterator
from itertools import combinations
from typing import TYPE_CHECKING

from resting_aspects_ros.core.aspects.aspect_set import AspectSet
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.report.rows import ids_text

if TYPE_CHECKING:
    from resting_aspects_ros.core.vision.outline import Outline


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
    """Return a sentence for each pickable class that looks like one that is not pickable.

    These are the classes with the same outline or its mirror image; see `look_alikes`.
    """
    texts = []
    for one, other, verdict in _pairs(part, aspects):
        picked = [each for each in (one, other) if set(each.aspects) <= set(pickable)]
        if len(picked) != 1:
            continue
        left = other if picked[0] is one else one
        names = f'class {picked[0].symmetry_class}, which is pickable, and class '
        names += f'{left.symmetry_class}, which is not'
        texts.append(
            f'A camera sees the same outline of {names}: the forecast assumes that vision '
            'distinguishes them in another way.'
            if verdict == 'same'
            else f'The outlines of {names}, are mirror images: vision must not match mirrored '
            'outlines.'
        )
    return texts


def counted_apart_texts(
    part: Part, aspects: AspectSet, groups: Collection[Collection[int]]
) -> list[str]:
    """Return a sentence for each two classes with the same outline that are counted apart.

    groups : the symmetry classes that were counted together
    """
    return [
        f'If a camera counts, classes {one.symmetry_class} and {other.symmetry_class} have the '
        f'same outline, and can be counted together as {one.symmetry_class}+'
        f'{other.symmetry_class}.'
        for one, other, verdict in _pairs(part, aspects)
        if verdict == 'same'
        and not any({one.symmetry_class, other.symmetry_class} <= set(each) for each in groups)
    ]


def _pairs(part: Part, aspects: AspectSet) -> 'Iterator[tuple[Outline, Outline, str]]':
    """Yield the pairs of classes with the same outline or its mirror image, and the verdict."""
    # The import of shapely is only needed here.
    from resting_aspects_ros.core.vision.look_alikes import look_alikes
    from resting_aspects_ros.core.vision.outline import find_outlines

    outlines = find_outlines(part, aspects)
    found = look_alikes(outlines)
    for one, other in combinations(outlines, 2):
        for entry in found[one.symmetry_class]:
            if entry.symmetry_class == other.symmetry_class and entry.verdict != 'distinct':
                yield one, other, entry.verdict
