"""Pixels that polygons cover, for images of outlines and of a tray."""

from collections.abc import Iterable, Iterator

import numpy as np
import shapely

from resting_aspects_ros.core.rotations import Array

# Scan lines per pixel with which the covered share of a pixel is computed.
LINES = 8


def rings(polygon: shapely.Polygon) -> Iterator[Array]:
    """Yield the corners (n, 2) of the outer ring and of each hole, the first one not repeated."""
    for ring in (polygon.exterior, *polygon.interiors):
        yield np.asarray(ring.coords, dtype=np.float64)[:-1]


def covered_share(
    polygons: shapely.Polygon | Iterable[shapely.Polygon], width: int, height: int
) -> Array:
    """Return the share (height, width) of each pixel that polygons cover, 0 to 1.

    The polygons are in image coordinates (px, (0, 0) is the outer corner of the first pixel),
    inside the image, all with the same sense of their outer rings, and their holes have the
    opposite sense. The share is exact along each of LINES horizontal lines of a pixel, unless
    polygons overlap within a pixel.
    """
    if isinstance(polygons, shapely.Polygon):
        polygons = [polygons]
    step = np.zeros(height * (width + 2))
    for ring in (ring for polygon in polygons for ring in rings(polygon)):
        x, y = ring.T
        dx, dy = np.roll(x, -1) - x, np.roll(y, -1) - y
        ends = np.sort(np.stack([y, y + dy]) * LINES - 0.5, axis=0)
        first, end = np.ceil(ends).astype(np.int64)
        count = end - first
        edge = np.repeat(np.arange(len(x)), count)
        line = np.arange(len(edge)) - np.repeat(np.cumsum(count) - count - first, count)
        crossing = x[edge] + dx[edge] * ((line + 0.5) / LINES - y[edge]) / dy[edge]
        column = np.floor(crossing).astype(np.int64)
        pixel = line // LINES * (width + 2) + column
        sign = np.sign(dy[edge]) / LINES
        inside = column + 1 - crossing
        # Everything to the right of the crossing is inside, or outside again.
        np.add.at(step, pixel, sign * inside)
        np.add.at(step, pixel + 1, sign * (1 - inside))
    share = step.reshape(height, width + 2).cumsum(axis=1)[:, :width]
    np.abs(share, out=share)
    return np.asarray(np.minimum(share, 1.0, out=share))
