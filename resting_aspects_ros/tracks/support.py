"""Whether a track with a piece cut out of it supports an orientation: statics of a rigid part.

The wall pushes the part at any height up to ``wall_top``. Moments about x then place the resultant
of the track's forces at

    y from d - h tan(roll) to d + (wall_top - h) tan(roll),    x = h tan(pitch)

with the distance d of the centre of mass from the wall and its height h above the track. The part
stays while such a point is in the convex hull of the contact region on the track (for a track
without roll: Berretty, Goldberg, Overmars and van der Stappen 2001, IJRR 20). Friction of the
track is left out: vibration averages it to zero.
"""

import math
from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import shapely

from resting_aspects_ros.arrays import Array
from resting_aspects_ros.tracks.orientations import Orientation

# Lengths that are longer than every part, m.
FAR = 10.0
# Points between which the wall pushes, and places of the part between two events of its passage.
PUSHES, BETWEEN = 9, 3
# Beside an event, m.
BESIDE = 1e-7
# Critical values are found within this, m.
RESOLUTION = 2e-6
# Contact regions with a smaller area than the square of this share of the part are edges and
# corners. Where such a contact ends, the body of the part catches the edge of the track.
LINE = 1e-2


def resultants(row: Orientation, roll: float, pitch: float = 0.0, shift: float = 0.0) -> Array:
    """Return points (n, 2) at which the resultant of the track's forces can be, m.

    shift : how far something at the wall has moved the part away from it, m
    """
    tilt = math.tan(roll)
    low = row.yaw.distance + shift - row.com_height * tilt
    high = low + row.wall_top * tilt
    y = np.linspace(low, high, PUSHES if tilt else 1)
    return np.stack([np.full(len(y), row.com_height * math.tan(pitch)), y], axis=1)


def support_margin(
    row: Orientation,
    track: shapely.Geometry,
    roll: float,
    pitch: float = 0.0,
    places: Array | None = None,
    shift: float = 0.0,
) -> float:
    """Return by how much the resultant stays inside the support, m; negative: the part falls.

    Parameters
    ----------
    track : shapely geometry
        Of the track, x and y in m.
    places : (n,) float
        x of the centre of mass while the part passes, m; by default only 0.
    shift : float
        See `resultants`.
    """
    moved = np.zeros(1) if places is None else places
    contact = _shifted(row.contact, 0.0, shift)
    pieces = np.array([_shifted(contact, x, 0.0) for x in moved.tolist()])
    hulls = shapely.convex_hull(shapely.intersection(pieces, track))
    there = resultants(row, roll, pitch, shift) + np.stack([moved, 0 * moved], axis=1)[:, None]
    return float(_inside(hulls, shapely.points(there)).max(axis=1).min())


def _shifted(geometry: shapely.Geometry, x: float, y: float) -> shapely.Geometry:
    return shapely.transform(geometry, lambda at: at + np.array([x, y])) if x or y else geometry


def _inside(hulls: npt.NDArray[np.object_], points: npt.NDArray[np.object_]) -> Array:
    """Return signed distances (n, m) of points (n, m) inside convex hulls (n,), m."""
    flat = shapely.get_dimensions(hulls) == 2
    outside = -shapely.distance(hulls[:, None], points)
    inside = shapely.distance(shapely.boundary(hulls)[:, None], points)
    within = flat[:, None] & shapely.contains(hulls[:, None], points)
    return np.asarray(np.nan_to_num(np.where(within, inside, outside), nan=-FAR))


def passage(row: Orientation, start: float, end: float) -> Array:
    """Return the places (n,) of the centre of mass at which the part passes a piece of track.

    They are those at which a corner of the contact region meets the start or the end of the piece,
    beside them, and some in between.

    start, end : x of the piece, m
    """
    corners = np.unique(np.round(shapely.get_coordinates(row.contact)[:, 0], 9))
    events = np.unique(np.concatenate([start - corners, end - corners, [start, end]]))
    share = np.arange(1, BETWEEN + 1) / (BETWEEN + 1)
    between = events[:-1, None] + np.diff(events)[:, None] * share
    beside = (events[:, None] + [-BESIDE, BESIDE]).ravel()
    return np.unique(np.concatenate([between.ravel(), beside]))


def is_line(row: Orientation) -> bool:
    """Return whether the part touches the track only along edges, and at corners."""
    pieces = shapely.get_parts(row.contact)
    return float(shapely.area(pieces).sum()) < (LINE * max(row.length, row.width)) ** 2


def critical_value(passes: Callable[[float], bool], low: float, high: float) -> float:
    """Return the dimension, m, at which a row changes between pass and reject, by bisection.

    Infinite if it passes in the whole range, and minus infinity if it passes nowhere in it.
    """
    at_low, at_high = passes(low), passes(high)
    if at_low == at_high:
        return math.inf if at_low else -math.inf
    while high - low > RESOLUTION:
        middle = (low + high) / 2
        if passes(middle) == at_low:
            low = middle
        else:
            high = middle
    return (low + high) / 2
