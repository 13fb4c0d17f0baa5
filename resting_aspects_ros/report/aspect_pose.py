"""A part standing on the tray in each of its aspects, side by side."""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from resting_aspects_ros.core.aspects.aspect_set import Aspect
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.rotations import Array, down_in_part, rotate
from resting_aspects_ros.report.coarse_mesh import Indices, coarse_faces

# Between neighbours' centres of mass, R: no part reaches further than R from its own.
PITCH = 2.5
# Aspects in a row; of more than its square the rows are so long that they make a square.
ROW = 6
# Triangles of all aspects together: 1.4 MB of a message, which is 20 ms of work to send.
MAX_TRIANGLES = 20_000
# However many aspects there are, each is shown with up to so many.
MIN_TRIANGLES = 100
# Triangles of a picture, and of the view in a page: finer ones are smaller than its pixels.
MAX_OF_PICTURES = 50_000
# Vertices so close to the surface are where the part touches it, R.
_TOUCHING = 1e-6
# Of those the outermost in so many directions stay when a mesh is made coarse.
_AZIMUTHS = np.arange(8) * (np.pi / 4)


@dataclass(frozen=True, eq=False)
class AspectPose:
    """A pose of the part on the surface z = 0 that shows an aspect; tray frame.

    position : (3,) float
        Of the part frame, m.
    orientation : (4,) float
        Unit quaternion xyzw, tray from part: the aspect's.
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


def stand(part: Part, aspects: Sequence[Aspect]) -> list[AspectPose]:
    """Each aspect on its place: in order from left to right (x), row after row towards -y.

    The places are PITCH R apart, and their middle is the tray's origin.
    """
    places = _places(len(aspects)) * (PITCH * part.hull_radius)
    return [_standing(part, a, place) for a, place in zip(aspects, places, strict=True)]


def sent_faces(part: Part, aspects: Sequence[Aspect]) -> Indices:
    """(m, 3) faces of the part, fewer if they are too many to be sent for each aspect."""
    most = max(MAX_TRIANGLES // max(len(aspects), 1), MIN_TRIANGLES)
    return _shown_faces(part, aspects, most)


def shown_part(part: Part, aspects: Sequence[Aspect]) -> Part:
    """The part for pictures: with a coarser mesh if it has too many triangles."""
    faces = _shown_faces(part, aspects, MAX_OF_PICTURES)
    if faces is part.faces:
        return part
    used, number = np.unique(faces, return_inverse=True)
    return dataclasses.replace(
        part, vertices=part.vertices[used], faces=number.reshape(faces.shape)
    )


def _shown_faces(part: Part, aspects: Sequence[Aspect], most: int) -> Indices:
    """Faces whose corners are vertices of the part, among them those on which it stands.

    So it touches the surface in every aspect, however coarse it is.
    """
    if len(part.faces) <= most:
        return part.faces
    kept = [_touching(part, aspect) for aspect in aspects]
    return coarse_faces(part.vertices, part.faces, most, np.unique(np.concatenate(kept)))


def _places(count: int) -> Array:
    """(count, 2) x and y on a grid of unit steps around the origin."""
    columns = min(max(ROW, math.ceil(math.sqrt(count))), max(count, 1))
    number = np.arange(count)
    x, y = number % columns, -(number // columns)
    rows = -(-count // columns)
    return np.stack([x - (columns - 1) / 2, y + (rows - 1) / 2], axis=-1)


def _standing(part: Part, aspect: Aspect, place: Array) -> AspectPose:
    heights = _heights(part, aspect)
    centre = rotate(aspect.orientation, part.centre_of_mass[None])[0]
    position = np.append(place - centre[:2], -heights.min())
    return AspectPose(
        aspect.id, position, aspect.orientation, position + centre, float(np.ptp(heights))
    )


def _heights(part: Part, aspect: Aspect) -> Array:
    """(n,) heights of the vertices above the part frame's origin, turned into the aspect, m."""
    return np.asarray(part.vertices @ -down_in_part(aspect.orientation))


def _touching(part: Part, aspect: Aspect) -> Indices:
    """The outermost vertices that touch the surface, and one of the lowest."""
    heights = _heights(part, aspect)
    lowest = int(heights.argmin())
    near = np.flatnonzero(heights - heights[lowest] <= _TOUCHING * part.hull_radius)
    x, y, _ = rotate(aspect.orientation, part.vertices[near]).T
    along = np.outer(np.cos(_AZIMUTHS), x) + np.outer(np.sin(_AZIMUTHS), y)
    return np.append(near[along.argmax(axis=1)], lowest)
