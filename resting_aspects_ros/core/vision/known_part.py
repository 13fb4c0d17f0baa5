"""A part that is looked for in images, with everything that does not depend on the image."""

from dataclasses import dataclass
from functools import cached_property

from resting_aspects_ros.core.aspects.aspect_set import AspectSet
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.rotations import Array
from resting_aspects_ros.core.vision.fitting import Shape
from resting_aspects_ros.core.vision.location import Placement
from resting_aspects_ros.core.vision.outline import Outline
from resting_aspects_ros.core.vision.rolling import Views, find_views


@dataclass(frozen=True, eq=False)
class KnownPart:
    """A part that is looked for, with its outlines and the prior shares of its classes.

    shares : (c,) float
        In the order of the outlines; the sum is 1.
    """

    part: Part
    aspects: AspectSet
    outlines: tuple[Outline, ...]
    shares: Array

    @cached_property
    def placements(self) -> tuple[Placement, ...]:
        """One for each outline."""
        return tuple(Placement(self.part, self.aspects, each) for each in self.outlines)

    @cached_property
    def views(self) -> tuple[Views, ...]:
        """For each class, its outlines by roll."""
        found = tuple(find_views(self.part, self.aspects, each) for each in self.outlines)
        for views in found:
            _ = views.spectra  # computed now, so that the first identification is fast, too
        return found

    @property
    def shapes(self) -> tuple[tuple[Shape, ...], ...]:
        """For each class, the shapes of its outlines."""
        return tuple(views.shapes for views in self.views)
