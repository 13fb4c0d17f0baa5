"""Aspects that a figure draws as one, and pictures of the part in them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from resting_aspects_ros.arrays import Array
from resting_aspects_ros.aspects.aspect_set import Aspect, AspectSet
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.aspect_pose import picture_part
from resting_aspects_ros.report.colours import GREY, aspect_colour, rgb
from resting_aspects_ros.report.posed_part import Image, draw_parts, pose_parts
from resting_aspects_ros.report.rows import ids_text

MAX_GROUPS = 12


@dataclass(frozen=True, eq=False)
class Group:
    """Aspects that a figure draws as one.

    name : str
        '3', '1 and 2', '18 others'.
    colour : str
        '#RRGGBB'.
    alike : bool
        Whether the aspects are in one symmetry class, so that the group has a picture.
    """

    name: str
    aspects: tuple[Aspect, ...]
    colour: str
    alike: bool = True

    @property
    def title(self) -> str:
        """The name with the word 'aspect', as 'aspects 1 and 2'."""
        return f'aspect{"s" * (len(self.aspects) > 1)} {self.name}' if self.alike else self.name


def group_of(alike: tuple[Aspect, ...]) -> Group:
    """Return the group of some or all aspects of a symmetry class."""
    return Group(ids_text(alike), alike, aspect_colour(alike[0]))


def aspect_groups(aspects: AspectSet, weights: Array) -> list[Group]:
    """Return a group for each aspect, or for each symmetry class if there are many aspects.

    If there are also many classes, those with the largest weights have a group each, in the order
    of their numbers, and a last group contains all other aspects. Many is more than MAX_GROUPS.

    Parameters
    ----------
    weights : (k,) float
        How important each aspect is in the figure, 0 or more.
    """
    by_class = len(aspects) > MAX_GROUPS
    rows = aspects.classes() if by_class else [(aspect,) for aspect in aspects.aspects]
    total = np.array([weights[[aspect.id - 1 for aspect in row]].sum() for row in rows])
    shown = set(np.argsort(-total, kind='stable')[:MAX_GROUPS].tolist())
    groups = [group_of(row) for k, row in enumerate(rows) if k in shown]
    if others := [aspect for k, row in enumerate(rows) if k not in shown for aspect in row]:
        groups.append(Group(f'{len(others)} others', tuple(others), GREY, alike=False))
    return groups


def membership(groups: Sequence[Group], count: int) -> Array:
    """Return (groups, count) numbers: 1 if the aspect of the column is in the group, else 0."""
    member = np.zeros((len(groups), count))
    for k, group in enumerate(groups):
        member[k, [aspect.id - 1 for aspect in group.aspects]] = 1.0
    return member


def group_images(part: Part | None, groups: Sequence[Group], pixels: int) -> list[Image | None]:
    """Return a picture of the part in each group, None without a part or for other aspects."""
    shown = [k for k, group in enumerate(groups) if group.alike]
    images: list[Image | None] = [None] * len(groups)
    if part is None or not shown:
        return images
    aspects = [groups[k].aspects[0] for k in shown]
    posed_parts = pose_parts(picture_part(part, aspects), aspects)
    drawn = draw_parts(posed_parts, [rgb(groups[k].colour) for k in shown], pixels)
    for k, image in zip(shown, drawn, strict=True):
        images[k] = image
    return images
