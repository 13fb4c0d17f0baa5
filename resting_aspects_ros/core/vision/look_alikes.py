"""Which outlines of a part look alike, so that a camera may confuse them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, product
from typing import Literal

import numpy as np
import shapely

from resting_aspects_ros.core.vision.matching import best_overlap, mirrored, same_outline
from resting_aspects_ros.core.vision.outline import Outline


@dataclass(frozen=True)
class LookAlike:
    """How well the outline of another symmetry class resembles an outline.

    symmetry_class : int
        The other class.
    overlap : float
        Maximum intersection over union over yaw and position.
    verdict : 'same', 'mirrored' or 'distinct'
        same: equal within SAME. mirrored: the mirror image is equal, but the outline is not.
    resolution : float
        Symmetric Hausdorff distance after the best alignment, m: a camera that does not resolve
        it cannot distinguish the outlines.
    """

    symmetry_class: int
    overlap: float
    verdict: Literal['same', 'mirrored', 'distinct']
    resolution: float


def look_alikes(outlines: Sequence[Outline]) -> dict[int, tuple[LookAlike, ...]]:
    """Return, by symmetry class, how well each other class resembles it, best overlap first.

    Of a class whose outline changes while the part rolls or rocks, the most similar one counts.
    """
    found: dict[int, list[LookAlike]] = {outline.symmetry_class: [] for outline in outlines}
    for one, other in combinations(outlines, 2):
        pairs = list(product((one.polygon, *one.family), (other.polygon, *other.family)))
        overlap, distance = _most_alike(pairs)
        verdict: Literal['same', 'mirrored', 'distinct'] = 'distinct'
        if any(same_outline(a, b) for a, b in pairs):
            verdict = 'same'
        elif any(same_outline(mirrored(a), b) for a, b in pairs):
            verdict = 'mirrored'
        for a, b in ((one, other), (other, one)):
            found[a.symmetry_class].append(LookAlike(b.symmetry_class, overlap, verdict, distance))
    return {k: tuple(sorted(each, key=lambda a: -a.overlap)) for k, each in found.items()}


def same_groups(found: Mapping[int, Sequence[LookAlike]]) -> list[tuple[int, ...]]:
    """Return all symmetry classes, those with the same outline in one group; both ascending.

    found : what `look_alikes` returns
    """
    groups: list[tuple[int, ...]] = []
    for number in sorted(found):
        same = {each.symmetry_class for each in found[number] if each.verdict == 'same'}
        for k, group in enumerate(groups):
            if same.issuperset(group):
                groups[k] = (*group, number)
                break
        else:
            groups.append((number,))
    return groups


def _most_alike(
    pairs: Sequence[tuple[shapely.Polygon, shapely.Polygon]],
) -> tuple[float, float]:
    """Return the maximum overlap of all pairs of a model and a seen outline, and its distance."""

    def bound(pair: tuple[shapely.Polygon, shapely.Polygon]) -> float:
        areas = sorted(each.area for each in pair)
        return float(areas[0] / areas[1])

    best = (0.0, np.inf)
    for model, seen in sorted(pairs, key=bound, reverse=True):
        if bound((model, seen)) > best[0]:
            best = max(best, best_overlap(model, seen), key=lambda found: found[0])
    return best
