"""Poses that show a part on the tray in each of its aspects, side by side."""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from resting_aspects_ros.arrays import Array, Indices
from resting_aspects_ros.aspects.aspect_set import Aspect
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.coarse_mesh import coarse_faces
from resting_aspects_ros.rotations import down_in_part, rotate

# Distance between neighbouring centres of mass, hull radii R: no point of a part is further than
# R from its centre of mass.
PITCH = 2.5
# Aspects in a row of the grid. More than ROW * ROW aspects are arranged in a square.
ROW = 6
# Maximum number of triangles of all aspects together: a message of 1.4 MB, sent in 20 ms.
MAX_TRIANGLES = 20_000
# The limit for one aspect is never lower than this, however many aspects there are.
MIN_TRIANGLES = 100
# Maximum number of triangles in pictures and in the 3D view of a page: with more, triangles are
# smaller than pixels.
MAX_PICTURE_TRIANGLES = 50_000
# Vertices this close to the surface touch it, R.
_TOUCHING = 1e-6
# A coarse mesh keeps the outermost touching vertices in these directions.
_AZIMUTHS = np.arange(8) * (np.pi / 4)


@dataclass(frozen=True, eq=False)
class AspectPose:
    """A pose of the part on the surface z = 0 that shows an aspect; tray frame.

    position : (3,) float
        Position of the part frame, m.
    orientation : (4,) float
        Orientation of the aspect: unit quaternion xyzw, tray from part.
    centre_of_mass : (3,) float
        m.
    top : float
        Height of the highest point, m.
    """

    aspect_id: int
    position: Array
    orientation: Array
    centre_of_mass: Array
    top: float


def aspect_poses(part: Part, aspects: Sequence[Aspect]) -> list[AspectPose]:
    """Return a pose for each aspect, in order from left to right (x), row by row towards -y.

    The poses are PITCH R apart, and the grid is centred on the tray's origin.
    """
    places = _places(len(aspects)) * (PITCH * part.hull_radius)
    return [_pose_at(part, a, place) for a, place in zip(aspects, places, strict=True)]


def message_faces(part: Part, aspects: Sequence[Aspect]) -> Indices:
    """Return (m, 3) faces of the part, coarse if a message of all aspects would be too large."""
    max_faces = max(MAX_TRIANGLES // max(len(aspects), 1), MIN_TRIANGLES)
    return _simplified_faces(part, aspects, max_faces)


def picture_part(part: Part, aspects: Sequence[Aspect]) -> Part:
    """Return the part for pictures: with a coarse mesh if it has too many triangles."""
    faces = _simplified_faces(part, aspects, MAX_PICTURE_TRIANGLES)
    if faces is part.faces:
        return part
    used, number = np.unique(faces, return_inverse=True)
    return dataclasses.replace(
        part, vertices=part.vertices[used], faces=number.reshape(faces.shape)
    )


def _simplified_faces(part: Part, aspects: Sequence[Aspect], max_faces: int) -> Indices:
    """Return at most ``max_faces`` faces between vertices of the part.

    They keep vertices on which the part rests, so that it touches the surface in every aspect.
    """
    if len(part.faces) <= max_faces:
        return part.faces
    kept = [_touching(part, aspect) for aspect in aspects]
    return coarse_faces(part.vertices, part.faces, max_faces, np.unique(np.concatenate(kept)))


def _places(count: int) -> Array:
    """Return (count, 2) x and y on a grid of unit steps around the origin."""
    columns = min(max(ROW, math.ceil(math.sqrt(count))), max(count, 1))
    number = np.arange(count)
    x, y = number % columns, -(number // columns)
    rows = -(-count // columns)
    return np.stack([x - (columns - 1) / 2, y + (rows - 1) / 2], axis=-1)


def _pose_at(part: Part, aspect: Aspect, place: Array) -> AspectPose:
    heights = _heights(part, aspect)
    centre = rotate(aspect.orientation, part.centre_of_mass[None])[0]
    position = np.append(place - centre[:2], -heights.min())
    return AspectPose(
        aspect.id, position, aspect.orientation, position + centre, float(np.ptp(heights))
    )


def _heights(part: Part, aspect: Aspect) -> Array:
    """Return the (n,) heights of the vertices above the origin of the part frame, m."""
    return np.asarray(part.vertices @ -down_in_part(aspect.orientation))


def _touching(part: Part, aspect: Aspect) -> Indices:
    """Return the outermost vertices that touch the surface, and the lowest vertex."""
    heights = _heights(part, aspect)
    lowest = int(heights.argmin())
    near = np.flatnonzero(heights - heights[lowest] <= _TOUCHING * part.hull_radius)
    x, y, _ = rotate(aspect.orientation, part.vertices[near]).T
    along = np.outer(np.cos(_AZIMUTHS), x) + np.outer(np.sin(_AZIMUTHS), y)
    return np.append(near[along.argmax(axis=1)], lowest)


def triangle_counts(part: Part | None, shown: Part | None) -> tuple[int, int] | None:
    """Return the numbers of triangles of the part and of the simplified part, if they differ."""
    if part is None or shown is None or len(part.faces) == len(shown.faces):
        return None
    return len(part.faces), len(shown.faces)
