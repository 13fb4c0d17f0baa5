"""Pose a part on the surface in each of its aspects, and draw pictures of it."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.ndimage import binary_dilation, uniform_filter

from resting_aspects_ros.arrays import Array, Indices
from resting_aspects_ros.aspects.aspect_set import Aspect
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.render import NOTHING, edges, rasterise
from resting_aspects_ros.rotations import rotate, turned_about_vertical

Image = npt.NDArray[np.float32]

# Each pixel of a picture is the mean of FINE x FINE rendered pixels, for smooth borders.
FINE = 3
# Share of the side of a picture that the largest part with its shadow fills.
FILLED = 0.94

PREVIEW = 96  # side of the picture with which the side that shows more edges is chosen, pixels

# The viewer is in front of the tray, a little to the right, and looks down; tray frame.
AZIMUTH, ELEVATION = np.radians(-62.0), np.radians(36.0)
TOWARDS_VIEWER = np.array(
    [np.cos(ELEVATION) * np.cos(AZIMUTH), np.cos(ELEVATION) * np.sin(AZIMUTH), np.sin(ELEVATION)]
)
RIGHT = np.array([-np.sin(AZIMUTH), np.cos(AZIMUTH), 0.0])
# Views. Their rows are the directions right, up and towards the viewer; tray frame.
OBLIQUE = np.stack([RIGHT, np.cross(TOWARDS_VIEWER, RIGHT), TOWARDS_VIEWER])
FROM_ABOVE = np.eye(3)  # the view of a camera above the tray
# The light comes from above, over the viewer's left shoulder.
LIGHT = np.array([0.0, 0.0, 1.0]) - 0.45 * RIGHT + 0.3 * TOWARDS_VIEWER
LIGHT /= np.linalg.norm(LIGHT)

MIN_SHADE = 0.5  # brightness of a side that faces away from the light
EDGE_COLOUR = np.array([0.13, 0.13, 0.15])
MAX_EDGE_SHARE = 0.6  # of the part's pixels; with more, edges are not drawn
SHADOW = 0.28  # opacity
SOFT = 7  # half width of the blur of the shadow, rendered pixels


@dataclass(frozen=True, eq=False)
class PosedPart:
    """A part on the surface z = 0, in the pose that shows an aspect; tray frame.

    points : (n, 3) float
        m.
    faces : (m, 3) int
    normals : (m, 3) float
        Unit vectors.
    areas : (m,) float
        m2.
    orientation : (4,) float
        Unit quaternion xyzw, tray from part.
    """

    points: Array
    faces: Indices
    normals: Array
    areas: Array
    orientation: Array


def pose_parts(part: Part, aspects: Sequence[Aspect]) -> list[PosedPart]:
    """Return the part in each aspect, with a rotation about the vertical that suits a drawing.

    The part's sides are parallel to the axes of the tray, the longer one from left to right. Of
    the two long sides, the one with more visible edges is in front.
    """
    solid = _untransformed(part)
    return [_posed(solid, aspect) for aspect in aspects]


def draw_parts(
    posed_parts: Sequence[PosedPart],
    colours: Sequence[tuple[float, float, float]],
    pixels: int,
    view: Array = OBLIQUE,
) -> list[Image]:
    """Draw parts on the surface, all from the same viewpoint and at the same scale.

    Parameters
    ----------
    posed_parts : sequence of PosedPart
    colours : sequence of (r, g, b)
        The colour of each part, from 0 to 1.
    pixels : int
        Rows and columns of each picture.
    view : (3, 3) float
        OBLIQUE or FROM_ABOVE.

    Returns
    -------
    list of (pixels, pixels, 4) float32
        Red, green, blue and opacity, 0 to 1; row 0 is the top row. The background is transparent.
    """
    spans = [
        np.ptp(np.concatenate([p.points, _on_surface(p.points)]) @ view[:2].T, axis=0).max()
        for p in posed_parts
    ]
    scale = FILLED * pixels * FINE / max(spans, default=1.0)
    return [
        _draw_part(p, np.array(c), scale, pixels, view)
        for p, c in zip(posed_parts, colours, strict=True)
    ]


def _untransformed(part: Part) -> PosedPart:
    """Return the part in the pose of its mesh."""
    points, faces = np.array(part.vertices), np.array(part.faces)
    if np.isnan(part.volume):
        faces = np.concatenate([faces, faces[:, ::-1]])  # an open mesh is visible from inside
    a, b, c = np.moveaxis(points[faces], 1, 0)
    normals = np.cross(b - a, c - a)
    twice = np.linalg.norm(normals, axis=1)
    upright = np.array([0.0, 0.0, 0.0, 1.0])
    normals /= np.maximum(twice, 1e-300)[:, None]
    return PosedPart(points, faces, normals, twice / 2, upright)


def _posed(solid: PosedPart, aspect: Aspect) -> PosedPart:
    posed = _on_tray(solid, aspect.orientation)
    # The mean direction of the upright sides, modulo 90 degrees, so that perpendicular and
    # opposite sides have the same direction.
    x, y, _ = posed.normals.T
    upright = posed.areas * np.hypot(x, y) ** 4
    side = float(np.angle((upright * np.exp(4j * np.arctan2(y, x))).sum())) / 4
    along = _on_tray(solid, turned_about_vertical(aspect.orientation, -side))
    width, depth, _ = np.ptp(along.points, axis=0)
    angle = -side + (np.pi / 2 if depth > width else 0.0)
    both = [turned_about_vertical(aspect.orientation, turn) for turn in (angle, angle + np.pi)]
    return max((_on_tray(solid, orientation) for orientation in both), key=_visible_edge_length)


def _on_tray(solid: PosedPart, orientation: Array) -> PosedPart:
    """Return the part with this orientation, in contact with the surface."""
    points = rotate(orientation, solid.points)
    points[:, 2] -= points[:, 2].min()
    normals = rotate(orientation, solid.normals)
    return dataclasses.replace(solid, points=points, normals=normals, orientation=orientation)


def _visible_edge_length(solid: PosedPart) -> int:
    """Return the length of the visible edges, pixels: how much a viewer sees of the shape."""
    points = solid.points @ OBLIQUE.T
    low, span = points.min(axis=0), np.ptp(points[:, :2], axis=0).max()
    seen = rasterise((points - low) * (PREVIEW / span), solid.faces, PREVIEW)
    return int(np.count_nonzero(edges(seen, solid.normals)))


def _on_surface(points: Array) -> Array:
    """Return the shadows of the points on the surface, tray frame."""
    return points - points[:, 2:] * (LIGHT / LIGHT[2])


def _draw_part(solid: PosedPart, colour: Array, scale: float, pixels: int, view: Array) -> Image:
    size = pixels * FINE
    shadow_points = _on_surface(solid.points)
    both = np.concatenate([solid.points, shadow_points]) @ view[:2].T * scale
    centre = np.append(size / 2 - (both.min(axis=0) + both.max(axis=0)) / 2, 0.0)
    seen = rasterise(solid.points @ view.T * scale + centre, solid.faces, size)
    lit = solid.faces[solid.normals @ LIGHT > 0]  # the shadow of these faces is the whole shadow
    shadow = rasterise(shadow_points @ view.T * scale + centre, lit, size).face != NOTHING

    shade = MIN_SHADE + (1 - MIN_SHADE) * (0.5 + 0.5 * solid.normals @ LIGHT) ** 1.5
    image = np.zeros((size, size, 4))
    soft = shadow.astype(float)
    for _ in range(2):
        soft = uniform_filter(soft, 2 * SOFT + 1, mode='constant')
    image[..., 3] = SHADOW * soft.round(9)  # removes rounding errors of zero
    part = seen.face != NOTHING
    image[part, :3] = shade[seen.face[part], None] * colour
    image[part, 3] = 1.0
    edge = binary_dilation(edges(seen, solid.normals))  # one pixel wider on all four sides
    # A part that is only a few pixels thick would consist of edges only.
    if np.count_nonzero(edge & part) < MAX_EDGE_SHARE * np.count_nonzero(part):
        image[edge, :3] = EDGE_COLOUR
        image[edge, 3] = 1.0
    return downsample(image, FINE)[::-1]


def downsample(image: npt.NDArray[np.floating[Any]], factor: int) -> Image:
    """Return the means over factor x factor pixels of an RGBA image; opacity weights colours."""
    image = np.concatenate([image[..., :3] * image[..., 3:], image[..., 3:]], axis=-1)
    size = len(image) // factor
    mean = image.reshape(size, factor, size, factor, 4).mean(axis=(1, 3))
    mean[..., :3] /= np.maximum(mean[..., 3:], 1e-9)
    return mean.astype(np.float32)
