"""A camera with an air jet: which orientations on the track it takes for a wanted one.

Views of each row are made from its outline, with errors of the boundary, and identified as a
camera above a tray would do it (`identify`). The row of the most probable pose is the answer; of
rows that look the same, the one with the largest share.
"""

from collections.abc import Sequence

import numpy as np
import shapely

from resting_aspects_ros.arrays import Array
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.tracks.orientations import Orientation, same_orientation
from resting_aspects_ros.vision.fitting import OutlineNoise
from resting_aspects_ros.vision.identification import identify, observed_polygon
from resting_aspects_ros.vision.outline import seen_outline
from resting_aspects_ros.vision.rolling import KnownPart

# Views of each row.
VIEWS = 20
# Two orientations within this, rad, are one row.
WITHIN = 0.1


def confusion(
    known: KnownPart, rows: Sequence[Orientation], sd: float, seed: int, views: int = VIEWS
) -> Array:
    """Return the confusion matrix (n, n + 1) of the rows: shares of the views of a row.

    Column j is the share that is identified as row j, the last one what is identified as none.

    sd : standard deviation of the boundary that the camera sees, m
    """
    noise = OutlineNoise(sd)
    counts = np.zeros((len(rows), len(rows) + 1))
    for k, row in enumerate(rows):
        outline = seen_outline(known.part, row.orientation)
        random = np.random.default_rng((seed, 11, row.id))
        for _ in range(views):
            seen = _seen(outline, noise, random)
            counts[k, _answer(seen, known, rows, noise)] += 1
    return counts / views


def _seen(
    outline: shapely.Polygon, noise: OutlineNoise, random: np.random.Generator
) -> shapely.Polygon:
    """Return an outline whose boundary has independent errors at each correlation length."""
    rings = [_ring(ring, noise, random) for ring in (outline.exterior, *outline.interiors)]
    return shapely.Polygon(rings[0], rings[1:])


def _ring(ring: shapely.LinearRing, noise: OutlineNoise, random: np.random.Generator) -> Array:
    count = max(int(ring.length / noise.correlation), 8)
    at = shapely.line_interpolate_point(ring, np.arange(count) / count, normalized=True)
    points = np.concatenate([shapely.get_coordinates(ring)[:-1], shapely.get_coordinates(at)])
    place = shapely.line_locate_point(ring, shapely.points(points))
    points = points[np.argsort(place, kind='stable')]
    return np.asarray(points + noise.sd * random.standard_normal(points.shape))


def _answer(
    seen: shapely.Polygon, known: KnownPart, rows: Sequence[Orientation], noise: OutlineNoise
) -> int:
    """Return the index of the row that a polygon is identified as; n: none."""
    try:
        best = identify(observed_polygon(seen), [known], noise).best
    except InvalidValueError:  # the noise is so large that the polygon crosses itself
        return len(rows)
    if best is None:
        return len(rows)
    symmetry = known.aspects.symmetry
    for k in sorted(range(len(rows)), key=lambda k: -rows[k].probability):
        if any(
            same_orientation(pose.orientation, rows[k].orientation, symmetry, WITHIN)
            for pose in best.poses
        ):
            return k
    return len(rows)
