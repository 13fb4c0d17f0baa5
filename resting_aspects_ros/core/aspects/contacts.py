"""Which sides of a part touch which planes, where there are walls: contacts of resting poses.

On a level plane, the yaw of a part does not matter. Near a wall it is not free: a part lies with
one side on the floor and leans with another side, an edge or a corner at the wall. Planes touch
only the convex hull of a part.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.aspects.aspect_set import POSE_ANGLE, AspectSet
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.rotations import Array, angle_between, rotate

Indices = npt.NDArray[np.int64]

# A part touches a plane if its hull is closer than this, R. Engines let parts rest at 0.001.
TOUCH = 0.01
# Points of the hull that are at most this much further from a plane, R, touch it too; they span a
# side, an edge, or nothing.
FLAT = 0.01
# Codes of contacts that are in no aspect; positive codes are ids of aspects.
NONE, SIDE, EDGE, CORNER = 0, -1, -2, -3
CODE_TEXT = {NONE: '-', SIDE: 'other side', EDGE: 'edge', CORNER: 'corner'}


@dataclass(frozen=True, eq=False)
class ContactPlane:
    """A plane that parts can touch.

    name : str
        Such as 'wall'.
    normal : (3,) float
        Unit vector that points away from the body, tray frame.
    offset : float
        Points x on the plane have ``normal @ x == offset``, m.
    """

    name: str
    normal: Array
    offset: float = 0.0


class ContactFinder:
    """Finds the contacts of the resting poses of a part.

    Parameters
    ----------
    part : Part
    aspects : AspectSet
        Aspects of the part on a level plane: their ids name its sides.
    planes : sequence of ContactPlane
    """

    def __init__(self, part: Part, aspects: AspectSet, planes: Sequence[ContactPlane]) -> None:
        self.planes = tuple(planes)
        self._aspects = aspects
        self._corners = part.hull_vertices
        self._radius = part.hull_radius

    def find(self, position: Array, orientation: Array) -> Indices:
        """Return the contacts (n, planes): the id of an aspect, or NONE, SIDE, EDGE or CORNER.

        Parameters
        ----------
        position, orientation : (n, 3) and (n, 4) float
            Poses tray from part, m and unit quaternions xyzw.
        """
        found = np.zeros((len(position), len(self.planes)), dtype=np.int64)
        inverse = orientation * [-1, -1, -1, 1]
        for k, plane in enumerate(self.planes):
            normal = rotate(inverse, np.tile(plane.normal, (len(position), 1)))
            height = normal @ self._corners.T
            lowest = height.min(axis=1)
            gap = position @ plane.normal - plane.offset + lowest
            near = height <= (lowest + FLAT * self._radius)[:, None]
            touches = gap < TOUCH * self._radius
            ids, angle = self._aspects.locate(-normal)
            code = np.where(angle <= POSE_ANGLE, ids, 0)
            for i in np.flatnonzero(touches & (code == 0)):
                code[i] = self._kind(self._corners[near[i]])
            found[:, k] = np.where(touches, code, NONE)
        return found

    def _kind(self, points: Array) -> int:
        """Return SIDE, EDGE or CORNER for the points (k, 3) of a hull that touch a plane."""
        size = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
        spread = size / np.sqrt(len(points)) > FLAT * self._radius
        return (CORNER, EDGE, SIDE, SIDE)[int(spread.sum())]


def pose_angles(orientation: Array, other: Array, rotations: Array, normal: Array | None) -> Array:
    """Return the angles (n,), rad, from orientations to another one, minimised over rotations.

    Parameters
    ----------
    orientation, other : (n, 4) and (4,) float
        Unit quaternions xyzw, tray from part.
    rotations : (g, 3, 3) float
        Rotations of the part onto itself, part frame.
    normal : (3,) float or None
        Unit vector, tray frame, about which the parts may be turned; None: about none.
    """
    inverse = orientation * [-1, -1, -1, 1]
    if normal is not None:
        seen = rotate(inverse, np.tile(normal, (len(orientation), 1)))
        of_other = rotate(other * [-1, -1, -1, 1], normal[None])[0]
        return np.asarray(np.min([angle_between(seen, r @ of_other) for r in rotations], axis=0))
    axes = np.eye(3)
    # The cosine of the angle of a rotation is (trace - 1) / 2.
    frames = np.stack([rotate(orientation, np.tile(x, (len(orientation), 1))) for x in axes], 2)
    of_other = np.stack([rotate(other, x[None])[0] for x in axes], axis=1)
    traces = [np.einsum('nij,ij->n', frames, of_other @ r.T) for r in rotations]
    return np.asarray(np.arccos(np.clip((np.max(traces, axis=0) - 1) / 2, -1, 1)))


def class_of_contacts(aspects: AspectSet, contacts: tuple[int, ...]) -> tuple[int, ...]:
    """Return the smallest of the contacts that rotations of the part onto itself make of these."""
    symmetry = aspects.symmetry
    if symmetry is None or not len(aspects):
        return contacts
    down = np.array([aspect.down_in_part for aspect in aspects.aspects])
    found = []
    for rotation in symmetry.rotations:
        ids = aspects.locate(down @ rotation.T)[0].tolist()
        found.append(tuple(ids[c - 1] if c > 0 else c for c in contacts))
    return min(found)
