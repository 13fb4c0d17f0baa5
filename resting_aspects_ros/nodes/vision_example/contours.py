"""Contours of parts on a backlight with OpenCV, with subpixel accuracy.

It needs OpenCV 4.5 or newer, NumPy and SciPy, and nothing else of this package.
"""

from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from scipy.ndimage import map_coordinates
from scipy.spatial import cKDTree

from resting_aspects_ros.arrays import Array

# Noise is smoothed with this standard deviation, px.
SMOOTHING = 1.0
# Steps of Newton's method.
STEPS = 3


@dataclass(frozen=True, eq=False)
class Blob:
    """A dark region in an image: a part, or several that touch.

    outer : (n, 2) float
        Points (u, v) of its boundary, px; (0, 0) is the centre of the first pixel.
    holes : list of (m, 2) float
        Through-holes.
    """

    outer: Array
    holes: list[Array] = field(default_factory=list)

    @property
    def boundary(self) -> Array:
        """(k, 2) float: the points of all its boundaries, px."""
        return np.concatenate([self.outer, *self.holes])


def find_blobs(image: npt.NDArray[np.uint8], level: float, min_area: float) -> list[Blob]:
    """Return the dark regions of a grey image, with all holes.

    `cv2.findContours` returns the centres of the outermost pixels of a region, so that a part
    would be half a pixel too small at each edge, and a hole too large. Therefore each point is
    moved along the gradient of the grey values to where they have the level between part and
    light, by Newton's method. Each step is at most a pixel.

    Parameters
    ----------
    image : (height, width) uint8
    level : float
        Grey value of an edge: the mean of those of a part and of the light.
    min_area : float
        Minimum area of a region or a hole, px; smaller ones are dust.
    """
    grey = cv2.GaussianBlur(image.astype(np.float32), (0, 0), SMOOTHING)
    dark = (grey < level).astype(np.uint8)
    contours, hierarchy = cv2.findContours(dark, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    fields = [grey, cv2.Sobel(grey, -1, 1, 0, scale=1 / 8), cv2.Sobel(grey, -1, 0, 1, scale=1 / 8)]
    blobs: dict[int, Blob] = {}
    # Regions precede their holes: the last column is the region that a hole is in, or -1.
    parents = [] if hierarchy is None else np.reshape(hierarchy, (-1, 4))[:, 3]
    for parent, (k, contour) in sorted(zip(parents, enumerate(contours), strict=True), key=_first):
        if len(contour) < 3 or cv2.contourArea(contour) < min_area:
            continue
        points = _on_edge(np.reshape(contour, (-1, 2)), fields, level)
        if parent < 0:
            blobs[k] = Blob(points)
        elif parent in blobs:
            blobs[parent].holes.append(points)
    return list(blobs.values())


def clearances(boundaries: list[Array]) -> Array:
    """Return the distance (n,) of each region from the next one; infinite for a single one.

    The boundary (m, 2) of a region includes its holes, because the next one can be in a hole. Its
    points are about a pixel apart, so the distance is that of the points.
    """
    found = np.full(len(boundaries), np.inf)
    trees = [cKDTree(boundary) for boundary in boundaries]
    for k, boundary in enumerate(boundaries):
        for j in range(k):
            apart = np.min(trees[j].query(boundary)[0])
            found[k], found[j] = min(found[k], apart), min(found[j], apart)
    return found


def _first(row: tuple[int, object]) -> bool:
    return row[0] >= 0


def _on_edge(pixels: Array, fields: list[Any], level: float) -> Array:
    """Return the points (n, 2) of the edge next to pixels (n, 2).

    fields : grey values, and their derivatives along u and v
    """
    points = pixels.astype(np.float64)
    for _ in range(STEPS):
        # Not cv2.remap, which takes fewer than 32,767 points and rounds them to 1/32 px.
        place = points.T[::-1]
        grey, *slope = (map_coordinates(each, place, order=1, mode='nearest') for each in fields)
        gradient = np.stack(slope, axis=1)
        square = np.maximum((gradient**2).sum(axis=1), 1e-6)
        step = ((level - grey) / square)[:, None] * gradient
        points += step / np.maximum(np.linalg.norm(step, axis=1, keepdims=True), 1.0)
    return points
