"""Pictures of a part as it lies on the surface in its aspects."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from resting_aspects_ros.core.aspect_set import Aspect
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.core.rotations import Array, rotate
from resting_aspects_ros.report.render import NOTHING, Indices, edges, rasterise

Image = npt.NDArray[np.float32]

# Each pixel of a picture is the mean of so many squared: smooth borders.
FINE = 3
# Part of the picture's side that the largest part and its shadow may take.
FILLED = 0.94

GLANCE = 96  # pixels of the picture that tells which side shows more

# Where the viewer is, tray frame: in front, a little to the right, looking down as a person does.
AZIMUTH, ELEVATION = np.radians(-62.0), np.radians(36.0)
TOWARDS_VIEWER = np.array(
    [np.cos(ELEVATION) * np.cos(AZIMUTH), np.cos(ELEVATION) * np.sin(AZIMUTH), np.sin(ELEVATION)]
)
RIGHT = np.array([-np.sin(AZIMUTH), np.cos(AZIMUTH), 0.0])
# Rows: to the right in the picture, up in it, towards the viewer; tray frame.
VIEW = np.stack([RIGHT, np.cross(TOWARDS_VIEWER, RIGHT), TOWARDS_VIEWER])
# The light comes from above, over the viewer's left shoulder.
LIGHT = np.array([0.0, 0.0, 1.0]) - 0.45 * RIGHT + 0.3 * TOWARDS_VIEWER
LIGHT /= np.linalg.norm(LIGHT)

DARKEST = 0.5  # of the colour, on a side that faces away from the light
EDGE_COLOUR = np.array([0.13, 0.13, 0.15])
SHADOW = 0.28  # opacity
SOFT = 7  # fine pixels of the shadow's border


@dataclass(frozen=True, eq=False)
class _Solid:
    """A part's surface: points (n, 3) m, faces (m, 3), unit normals (m, 3), areas (m,) m2."""

    points: Array
    faces: Indices
    normals: Array
    areas: Array


def portraits(
    part: Part,
    aspects: Sequence[Aspect],
    colours: Sequence[tuple[float, float, float]],
    pixels: int,
) -> list[Image]:
    """Draw the part in each aspect, all from one viewpoint and at one scale.

    A pose is free to turn about the vertical; each is turned so that the part's sides run along
    the axes of the tray, its longer one from left to right, because people draw parts so, and
    shows the one of its two long sides on which there is more to see.

    Parameters
    ----------
    part : Part
    aspects : sequence of Aspect
    colours : sequence of (r, g, b)
        Of each, 0 to 1.
    pixels : int
        Rows and columns of each picture.

    Returns
    -------
    list of (pixels, pixels, 4) float32
        Red, green, blue and opacity, 0 to 1; row 0 is the top one. Transparent around the part
        and its shadow.
    """
    solid = _solid(part)
    placed = [_placed(solid, aspect) for aspect in aspects]
    spans = [
        np.ptp(np.concatenate([p.points, _on_surface(p.points)]) @ VIEW[:2].T, axis=0).max()
        for p in placed
    ]
    scale = FILLED * pixels * FINE / max(spans, default=1.0)
    return [_portrait(p, np.array(c), scale, pixels) for p, c in zip(placed, colours, strict=True)]


def _solid(part: Part) -> _Solid:
    points, faces = np.array(part.vertices), np.array(part.faces)
    if np.isnan(part.volume):
        faces = np.concatenate([faces, faces[:, ::-1]])  # not closed: its inside can be seen
    a, b, c = np.moveaxis(points[faces], 1, 0)
    normals = np.cross(b - a, c - a)
    twice = np.linalg.norm(normals, axis=1)
    return _Solid(points, faces, normals / np.maximum(twice, 1e-300)[:, None], twice / 2)


def _placed(solid: _Solid, aspect: Aspect) -> _Solid:
    """The part on the surface, tray frame."""
    lying = _Solid(
        rotate(aspect.orientation, solid.points),
        solid.faces,
        rotate(aspect.orientation, solid.normals),
        solid.areas,
    )
    lying.points[:, 2] -= lying.points[:, 2].min()
    # The direction of the upright sides, of period 90 degrees: sides that stand square to each
    # other, or face each other, agree.
    x, y, _ = lying.normals.T
    upright = lying.areas * np.hypot(x, y) ** 4
    side = np.angle((upright * np.exp(4j * np.arctan2(y, x))).sum()) / 4
    width, depth = np.ptp(lying.points @ _about_vertical(-side)[:2].T, axis=0)
    angle = -side + (np.pi / 2 if depth > width else 0.0)
    return max((_turned(lying, angle), _turned(lying, angle + np.pi)), key=_edges_to_see)


def _turned(solid: _Solid, angle: float) -> _Solid:
    turn = _about_vertical(angle)
    return _Solid(solid.points @ turn.T, solid.faces, solid.normals @ turn.T, solid.areas)


def _edges_to_see(solid: _Solid) -> int:
    """How much a viewer learns of the part: the length of the edges seen, pixels."""
    points = solid.points @ VIEW.T
    low, span = points.min(axis=0), np.ptp(points[:, :2], axis=0).max()
    seen = rasterise((points - low) * (GLANCE / span), solid.faces, GLANCE)
    return int(np.count_nonzero(edges(seen, solid.normals)))


def _about_vertical(angle: float) -> Array:
    cos, sin = np.cos(angle), np.sin(angle)
    return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])


def _on_surface(points: Array) -> Array:
    """Where the light throws the points' shadows, tray frame."""
    return points - points[:, 2:] * (LIGHT / LIGHT[2])


def _portrait(solid: _Solid, colour: Array, scale: float, pixels: int) -> Image:
    size = pixels * FINE
    shadow_points = _on_surface(solid.points)
    both = np.concatenate([solid.points, shadow_points]) @ VIEW[:2].T * scale
    centre = np.append(size / 2 - (both.min(axis=0) + both.max(axis=0)) / 2, 0.0)
    seen = rasterise(solid.points @ VIEW.T * scale + centre, solid.faces, size)
    lit = solid.faces[solid.normals @ LIGHT > 0]  # their shadows face up, and cover all of it
    shadow = rasterise(shadow_points @ VIEW.T * scale + centre, lit, size).face != NOTHING

    shade = DARKEST + (1 - DARKEST) * (0.5 + 0.5 * solid.normals @ LIGHT) ** 1.5
    image = np.zeros((size, size, 4))
    image[..., 3] = SHADOW * _blurred(shadow.astype(float))
    part = seen.face != NOTHING
    image[part, :3] = shade[seen.face[part], None] * colour
    image[part, 3] = 1.0
    edge = _thicker(edges(seen, solid.normals))
    image[edge, :3] = EDGE_COLOUR
    image[edge, 3] = 1.0
    return _reduced(image)[::-1].astype(np.float32)


def _reduced(image: Array) -> Array:
    """The mean over FINE x FINE pixels, of colours as much as they cover."""
    image = np.concatenate([image[..., :3] * image[..., 3:], image[..., 3:]], axis=-1)
    size = len(image) // FINE
    mean = image.reshape(size, FINE, size, FINE, 4).mean(axis=(1, 3))
    mean[..., :3] /= np.maximum(mean[..., 3:], 1e-9)
    return np.asarray(mean)


def _thicker(mask: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """The mask and its neighbours to all four sides."""
    wide = mask.copy()
    wide[1:] |= mask[:-1]
    wide[:-1] |= mask[1:]
    wide[:, 1:] |= mask[:, :-1]
    wide[:, :-1] |= mask[:, 1:]
    return wide


def _blurred(image: Array) -> Array:
    """Mean over a square of 2 SOFT + 1, twice."""
    for _ in range(2):
        for axis in (0, 1):
            padded = np.pad(image, [(SOFT + 1, SOFT) if a == axis else (0, 0) for a in (0, 1)])
            total = padded.cumsum(axis=axis)
            width = 2 * SOFT + 1
            ends = np.take(total, np.arange(width, total.shape[axis]), axis=axis)
            starts = np.take(total, np.arange(total.shape[axis] - width), axis=axis)
            image = (ends - starts) / width
    return image
