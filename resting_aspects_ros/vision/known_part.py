"""A part that is looked for in images, and its classes that an observed polygon may show."""

from dataclasses import dataclass
from functools import cached_property

from resting_aspects_ros.arrays import Array
from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.vision.fitting import Shape
from resting_aspects_ros.vision.location import Placement, Pose
from resting_aspects_ros.vision.outline import Outline
from resting_aspects_ros.vision.rolling import Views, find_views


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


# -- Candidates -----------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Candidate:
    """A class of a part that an observed polygon may show.

    part : str
    symmetry_class : int
    aspects : tuple of int
        The aspects of the class, which look the same.
    x, y, yaw : float
        Camera pose of the outline: projection of the centre of mass, m, and yaw, rad.
    overlap : float
        Intersection over union; the noise of the observed polygon is smoothed.
    distance : float
        Largest distance between the boundaries, m.
    residual : float
        Root mean square of the distances between the boundaries, m.
    log_likelihood : float
        Natural logarithm up to a constant that all answers share; see `likelihood`.
    prior, posterior : float
        Probabilities; those of all candidates, none and touching add up to 1.
    roll : float
        Angle by which the part has rolled about the axis of the aspect, rad: that of the first
        pose, one of several if the outline does not tell it. 0 if the part does not roll.
    poses : tuple of Pose
        All poses of the part that look like this, tray frame; the most probable first.
    """

    part: str
    symmetry_class: int
    aspects: tuple[int, ...]
    x: float
    y: float
    yaw: float
    overlap: float
    distance: float
    residual: float
    log_likelihood: float
    prior: float
    posterior: float
    roll: float
    poses: tuple[Pose, ...]
