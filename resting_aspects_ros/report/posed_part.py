"""Pictures of a part as it lies on the surface in its aspects."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.ndimage import binary_dilation, uniform_filter

from resting_aspects_ros.core.aspects.aspect_set import Aspect
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.rotations import Array, rotate, turned_about_vertical
from resting_aspects_ros.report.render import NOTHING, Indices, edges, rasterise

Image = npt.NDArray[np.float32]

# Each pixel of a picture is the mean of so many squared: smooth borders.
FINE = 3
# Part of the picture's side that the largest part and its shadow may take.
FILLED = 0.94

GLANCE = 96  # pixels of the picture that tells which side shows more

# Of a viewer in front, a little to the right, who looks down as a person does; tray frame.
AZIMUTH, ELEVATION = np.radians(-62.0), np.radians(36.0)
TOWARDS_VIEWER = np.array(
    [np.cos(ELEVATION) * np.cos(AZIMUTH), np.cos(ELEVATION) * np.sin(AZIMUTH), np.sin(ELEVATION)]
)
RIGHT = np.array([-np.sin(AZIMUTH), np.cos(AZIMUTH), 0.0])
# Views. Rows: to the right in the picture, up in it, towards the viewer; tray frame.
OBLIQUE = np.stack([RIGHT, np.cross(TOWARDS_VIEWER, RIGHT), TOWARDS_VIEWER])
FROM_ABOVE = np.eye(3)  # what a camera over the tray sees
# The light comes from above, over the viewer's left shoulder.
LIGHT = np.array([0.0, 0.0, 1.0]) - 0.45 * RIGHT + 0.3 * TOWARDS_VIEWER
LIGHT /= np.linalg.norm(LIGHT)

DARKEST = 0.5  # of the colour, on a side that faces away from the light
EDGE_COLOUR = np.array([0.13, 0.13, 0.15])
MAX_EDGE = 0.6  # of the part's pixels
SHADOW = 0.28  # opacity
SOFT = 7  # fine pixels of the shadow's border


@dataclass(frozen=True, eq=False)
class PosedPart:
    """A part as it is shown in an aspect, on the surface z = 0; tray frame.

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


def lay(part: Part, aspects: Sequence[Aspect]) -> list[PosedPart]:
    """The part in each aspect as people draw parts.

    A pose is free to turn about the vertical; each is turned so that the part's sides run along
    the axes of the tray, its longer one from left to right, and shows the one of its two long
    sides on which there is more to see.
    """
    solid = _solid(part)
    return [_laid(solid, aspect) for aspect in aspects]


def portraits(
    lying: Sequence[PosedPart],
    colours: Sequence[tuple[float, float, float]],
    pixels: int,
    view: Array = OBLIQUE,
) -> list[Image]:
    """Draw parts that lie on the surface, all from one viewpoint and at one scale.

    Parameters
    ----------
    lying : sequence of PosedPart
    colours : sequence of (r, g, b)
        Of each, 0 to 1.
    pixels : int
        Rows and columns of each picture.
    view : (3, 3) float
        OBLIQUE or FROM_ABOVE.

    Returns
    -------
    list of (pixels, pixels, 4) float32
        Red, green, blue and opacity, 0 to 1; row 0 is the top one. Transparent around the part
        and its shadow.
    """
    spans = [
        np.ptp(np.concatenate([p.points, _on_surface(p.points)]) @ view[:2].T, axis=0).max()
        for p in lying
    ]
    scale = FILLED * pixels * FINE / max(spans, default=1.0)
    return [
        _portrait(p, np.array(c), scale, pixels, view) for p, c in zip(lying, colours, strict=True)
    ]


def _solid(part: Part) -> PosedPart:
    """As its mesh has it."""
    points, faces = np.array(part.vertices), np.array(part.faces)
    if np.isnan(part.volume):
        faces = np.concatenate([faces, faces[:, ::-1]])  # not closed: its inside can be seen
    a, b, c = np.moveaxis(points[faces], 1, 0)
    normals = np.cross(b - a, c - a)
    twice = np.linalg.norm(normals, axis=1)
    upright = np.array([0.0, 0.0, 0.0, 1.0])
    normals /= np.maximum(twice, 1e-300)[:, None]
    return PosedPart(points, faces, normals, twice / 2, upright)


def _laid(solid: PosedPart, aspect: Aspect) -> PosedPart:
    lying = _on_tray(solid, aspect.orientation)
    # The direction of the upright sides, of period 90 degrees: sides that stand square to each
    # other, or face each other, agree.
    x, y, _ = lying.normals.T
    upright = lying.areas * np.hypot(x, y) ** 4
    side = float(np.angle((upright * np.exp(4j * np.arctan2(y, x))).sum())) / 4
    along = _on_tray(solid, turned_about_vertical(aspect.orientation, -side))
    width, depth, _ = np.ptp(along.points, axis=0)
    angle = -side + (np.pi / 2 if depth > width else 0.0)
    both = [turned_about_vertical(aspect.orientation, turn) for turn in (angle, angle + np.pi)]
    return max((_on_tray(solid, orientation) for orientation in both), key=_edges_to_see)


def _on_tray(solid: PosedPart, orientation: Array) -> PosedPart:
    """The part with this orientation, on the surface."""
    points = rotate(orientation, solid.points)
    points[:, 2] -= points[:, 2].min()
    normals = rotate(orientation, solid.normals)
    return dataclasses.replace(solid, points=points, normals=normals, orientation=orientation)


def _edges_to_see(solid: PosedPart) -> int:
    """How much a viewer learns of the part: the length of the edges seen, pixels."""
    points = solid.points @ OBLIQUE.T
    low, span = points.min(axis=0), np.ptp(points[:, :2], axis=0).max()
    seen = rasterise((points - low) * (GLANCE / span), solid.faces, GLANCE)
    return int(np.count_nonzero(edges(seen, solid.normals)))


def _on_surface(points: Array) -> Array:
    """Where the light throws the points' shadows, tray frame."""
    return points - points[:, 2:] * (LIGHT / LIGHT[2])


def _portrait(solid: PosedPart, colour: Array, scale: float, pixels: int, view: Array) -> Image:
    size = pixels * FINE
    shadow_points = _on_surface(solid.points)
    both = np.concatenate([solid.points, shadow_points]) @ view[:2].T * scale
    centre = np.append(size / 2 - (both.min(axis=0) + both.max(axis=0)) / 2, 0.0)
    seen = rasterise(solid.points @ view.T * scale + centre, solid.faces, size)
    lit = solid.faces[solid.normals @ LIGHT > 0]  # their shadows face up, and cover all of it
    shadow = rasterise(shadow_points @ view.T * scale + centre, lit, size).face != NOTHING

    shade = DARKEST + (1 - DARKEST) * (0.5 + 0.5 * solid.normals @ LIGHT) ** 1.5
    image = np.zeros((size, size, 4))
    soft = shadow.astype(float)
    for _ in range(2):
        soft = uniform_filter(soft, 2 * SOFT + 1, mode='constant')
    image[..., 3] = SHADOW * soft.round(9)  # without what rounding leaves of nothing
    part = seen.face != NOTHING
    image[part, :3] = shade[seen.face[part], None] * colour
    image[part, 3] = 1.0
    edge = binary_dilation(edges(seen, solid.normals))  # a pixel more to all four sides
    # A part that is a few pixels thin would be all edge.
    if np.count_nonzero(edge & part) < MAX_EDGE * np.count_nonzero(part):
        image[edge, :3] = EDGE_COLOUR
        image[edge, 3] = 1.0
    return reduced(image, FINE)[::-1]


def reduced(image: npt.NDArray[np.floating[Any]], factor: int) -> Image:
    """The mean over factor x factor pixels of an RGBA image, of colours as much as they cover."""
    image = np.concatenate([image[..., :3] * image[..., 3:], image[..., 3:]], axis=-1)
    size = len(image) // factor
    mean = image.reshape(size, factor, size, factor, 4).mean(axis=(1, 3))
    mean[..., :3] /= np.maximum(mean[..., 3:], 1e-9)
    return mean.astype(np.float32)
