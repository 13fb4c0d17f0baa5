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
from typing import TYPE_CHECKING

import numpy as np
import shapely

from resting_aspects_ros.arrays import Array
from resting_aspects_ros.tracks.orientations import Orientation

if TYPE_CHECKING:
    from resting_aspects_ros.tracks.traps import Surface

# Lengths that are longer than every part, m.
FAR = 10.0
# A part that is supported by less than this, m, falls.
CERTAIN = 1e-6
# Places of the part between two events of its passage, and how far two places are apart at a hole
# with oblique edges, m. A round hole has more than ROUND corners. If it is longer than LONG, m,
# its edge is as flat between two places that are further apart.
BETWEEN, STEP, ROUND, LONG = 3, 3e-4, 32, 0.05
# Beside an event, m.
BESIDE = 1e-7
# Critical values are found within this, m.
RESOLUTION = 2e-6
# Contact regions with a smaller area than the square of this share of the part are edges and
# corners. Where such a contact ends, the body of the part catches the edge of the track.
LINE = 1e-2


def supports(
    row: Orientation,
    surface: 'Surface',
    hole: shapely.Polygon | None = None,
    places: Array | None = None,
    shift: float = 0.0,
) -> bool:
    """Return whether a track supports a part at all places.

    Parameters
    ----------
    hole : shapely polygon, optional
        What is cut out of the track, x and y in m.
    places : (n,) float
        x of the centre of mass while the part passes the hole, m; by default only 0.
    shift : float
        How far something at the wall has moved the part away from it, m.
    """
    contact = row.contact
    if shift:
        contact = shapely.transform(contact, lambda at: at + np.array([0.0, shift]))
    rest = shapely.intersection(contact, surface.area)
    if hole is not None:
        moved = np.zeros(1) if places is None else places
        ring = shapely.get_coordinates(hole)
        holes = shapely.polygons(ring - moved[:, None, None] * [1.0, 0.0])
        rest = shapely.difference(rest, holes)
    hulls = shapely.convex_hull(rest)
    tilt, x = math.tan(surface.roll), row.com_height * math.tan(surface.pitch)
    low = row.yaw.distance + shift - row.com_height * tilt
    reach = shapely.LineString([(x, low), (x, low + row.wall_top * tilt + CERTAIN)])
    return bool(
        ((shapely.area(hulls) > CERTAIN * row.length) & shapely.intersects(hulls, reach)).all()
    )


def passage(row: Orientation, hole: shapely.Polygon) -> Array:
    """Return the places (n,) of the centre of mass at which the part passes a hole, x and y in m.

    They are those at which a corner of the contact region meets the start, the end or the edge of
    the hole, or a corner of the hole the edge of the contact region, beside them, and some in
    between.
    """
    corners, ring = _corners(row.contact), _corners(hole)
    ends, x = shapely.bounds(hole)[[0, 2]], corners[:, :1]
    meetings = [ends - x, _crossed(hole, corners[:, 1]) - x, ends[None]]
    is_round = len(ring) > ROUND
    if not is_round:
        meetings.append(ring[:, :1] - _crossed(row.contact, ring[:, 1]))
    found = np.concatenate(meetings).ravel()
    events = np.unique(np.round(found[np.isfinite(found)], 9))
    share = np.arange(1, BETWEEN + 1) / (BETWEEN + 1)
    between = (events[:-1, None] + np.diff(events)[:, None] * share).ravel()
    places = [between, (events[:, None] + [-BESIDE, BESIDE]).ravel()]
    if not shapely.equals(hole, shapely.envelope(hole)):
        flat = math.sqrt(max(1.0, (ends[1] - ends[0]) / LONG)) if is_round else 1.0
        places.append(np.arange(events[0], events[-1], STEP * flat))
    return np.unique(np.concatenate(places))


def _corners(region: shapely.Geometry) -> Array:
    return np.unique(np.round(shapely.get_coordinates(region), 9), axis=0)


def _crossed(region: shapely.Geometry, y: Array) -> Array:
    """Return x (n, 2) of the first and the last point of a region at each y (n,), or nan."""
    low, high = shapely.bounds(region)[[0, 2]]
    lines = np.stack([low + 0 * y, y, high + 0 * y, y], 1).reshape(-1, 2, 2)
    crossing = shapely.intersection(shapely.linestrings(lines), region)
    return np.asarray(shapely.bounds(crossing)[:, [0, 2]])


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
