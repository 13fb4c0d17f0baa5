"""A part that is looked for in images, with everything that does not depend on the image."""

from dataclasses import dataclass
from functools import cached_property

from resting_aspects_ros.core.aspects.aspect_set import AspectSet
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.rotations import Array
from resting_aspects_ros.core.vision.fitting import Shape
from resting_aspects_ros.core.vision.location import Placement
from resting_aspects_ros.core.vision.outline import Outline


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
    def shapes(self) -> tuple[tuple[Shape, ...], ...]:
        """For each class, the shapes of the outline and of its family."""
        found = tuple(
            tuple(Shape(polygon) for polygon in (each.polygon, *each.family))
            for each in self.outlines
        )
        for shape in (shape for shapes in found for shape in shapes):
            _ = shape.spectrum  # computed now, so that the first identification is fast, too
        return found
