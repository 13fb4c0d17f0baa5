"""The natural resting aspects of a part, and which of them a resting pose is in.

First version: an aspect is a flat facet of the hull with the centre of mass over its inside. So a
part that can rest on a curved side has an aspect for each flat of its mesh that is wide enough.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.facets import Facet, hull_facets
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.rotations import Array, down_in_part, orientation_with_down, rotate

# A part rests on a facet if its centre of mass is inside by more than this, R. Less is
# indistinguishable from the noise of float32 coordinates, and any breath tips the part over.
STABLE_MARGIN = 1e-4
# A pose is in the aspect with the nearest down direction, if that is within this. Bullet rests
# within hundredths of a degree of a facet, on the margin of its shape; what is further off lies
# on no facet.
POSE_ANGLE = np.radians(3.0)
# Ids are ordered by centre of mass height in steps of this, R, and by share in steps of this.
ORDER_STEP = 1e-3


@dataclass(frozen=True, eq=False)
class Aspect:
    """One way in which a part comes to rest.

    id : int
        From 1, lowest centre of mass first.
    down_in_part : (3,) float
        Unit vector of gravity, part frame.
    com_height : float
        Of the centre of mass above the surface, m.
    orientation : (4,) float
        Unit quaternion xyzw, tray from part, of a pose that shows the aspect.
    support : (k, 2) float
        Contact polygon on the surface in that pose, m, tray axes, origin below the centre of mass.
    solid_angle : float
        Of its facet seen from the centre of mass, sr.
    """

    id: int
    down_in_part: Array
    com_height: float
    orientation: Array
    support: Array
    solid_angle: float


@dataclass(frozen=True, eq=False)
class AspectSet:
    """All aspects of a part, ordered by id."""

    part_sha256: str
    aspects: tuple[Aspect, ...]

    def __len__(self) -> int:
        return len(self.aspects)

    def classify(self, orientation: Array) -> npt.NDArray[np.int64]:
        """(n,) ids of the aspects that poses are in; 0 where none fits.

        Parameters
        ----------
        orientation : (n, 4) float
            Unit quaternions xyzw, tray from part.
        """
        down = down_in_part(np.asarray(orientation, dtype=np.float64).reshape(-1, 4))
        if not self.aspects:
            return np.zeros(len(down), dtype=np.int64)
        directions = np.array([a.down_in_part for a in self.aspects])
        nearest = (down @ directions.T).argmax(axis=1)
        chord = np.linalg.norm(down - directions[nearest], axis=1)
        return np.where(chord <= 2 * np.sin(POSE_ANGLE / 2), nearest + 1, 0)


def find_aspects(part: Part) -> AspectSet:
    """The facets of the part's hull on which it can rest, in the order of DESIGN's rule 4."""
    facets = [
        facet
        for facet in hull_facets(part.hull_vertices - part.centre_of_mass)
        if facet.margin > STABLE_MARGIN * part.hull_radius
    ]
    ordered = _in_order(facets, part)
    aspects = tuple(_aspect(number, facet) for number, facet in enumerate(ordered, start=1))
    return AspectSet(part.part_sha256, aspects)


def _in_order(facets: Sequence[Facet], part: Part) -> list[Facet]:
    """By centre of mass height, then solid angle, then direction in the part's intrinsic frame.

    The keys are compared in steps, so that noise does not reorder facets that are equal; those
    that no key tells apart are mapped onto each other by a symmetry of the part.
    """
    keys: list[Callable[[Facet], float]] = [
        lambda facet: facet.height / part.hull_radius,
        lambda facet: -facet.solid_angle / (4 * np.pi),
        *(lambda facet, axis=axis: -float(facet.normal @ axis) for axis in part.principal_axes.T),
    ]
    groups = [list(facets)]
    for key in keys:
        groups = [step for group in groups for step in _steps(group, key)]
    return [facet for group in groups for facet in group]


def _steps(facets: list[Facet], key: Callable[[Facet], float]) -> list[list[Facet]]:
    """Facets in ascending steps of a key."""
    groups: list[list[Facet]] = []
    for facet in sorted(facets, key=key):
        if groups and key(facet) - key(groups[-1][0]) <= ORDER_STEP:
            groups[-1].append(facet)
        else:
            groups.append([facet])
    return groups


def _aspect(number: int, facet: Facet) -> Aspect:
    orientation = orientation_with_down(facet.normal)
    return Aspect(
        id=number,
        down_in_part=facet.normal,
        com_height=facet.height,
        orientation=orientation,
        support=rotate(orientation, facet.polygon)[:, :2],
        solid_angle=facet.solid_angle,
    )
