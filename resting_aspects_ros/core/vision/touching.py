"""Whether an observed polygon that is not a known outline shows parts that touch or overlap.

The rule: its area is larger than that of some known outline, and at most MAX_PARTS times that of
the largest. Then known outlines are placed on it: an arc of an outline, half its perimeter long,
must coincide with an arc of the observed exterior, and the outline must be inside the observed
polygon. If at most MAX_PARTS outlines that are placed in this way cover the polygon and overlap
little, it shows touching parts. This speaks for them by the factor FOUND. The opposite speaks
against them by the factor NOT_FOUND only, because parts that lie on each other are tilted or hide
more than half of an outline.
"""

from collections.abc import Sequence

import numpy as np
import shapely

from resting_aspects_ros.core.rotations import Array
from resting_aspects_ros.core.vision.boundary import turn
from resting_aspects_ros.core.vision.common_area import common_area
from resting_aspects_ros.core.vision.fitting import Shape

MIN_AREA, MAX_PARTS = 1.05, 4
# Ratios of the probabilities with touching parts and with an unknown outline.
FOUND, NOT_FOUND = 100.0, 0.1
# Length of an arc as a share of the perimeter of an outline, and number of points on that.
ARC, POINTS = 0.5, 160
# Maximum root mean square distance of the arcs, as a multiple of the noise and a share of the
# distance of the points.
NOISE, STEP = 3.0, 0.5
# Maximum shares of an outline that are outside the observed polygon, of the observed polygon that
# no outline covers, and of the outlines that overlap.
MAX_OUTSIDE, MAX_UNCOVERED, MAX_OVERLAP = 0.04, 0.04, 0.35
# Every how many points an arc starts, and number of arcs that are placed.
EVERY, TRIED = 2, 6


def touching_odds(seen: Shape, outlines: Sequence[Shape], sd: float) -> float:
    """Return the probability of the polygon with touching parts over that with another outline.

    ``sd`` is the standard deviation of the boundary, m.
    """
    areas = [each.area for each in outlines]
    if not MIN_AREA * min(areas) <= seen.area <= MAX_PARTS * max(areas):
        return 0.0
    exterior = shapely.Polygon(seen.polygon.simplify(2 * sd).exterior)
    placed = [
        one for each in outlines if each.area <= seen.area for one in _placed(each, exterior, sd)
    ]
    return FOUND if _cover(placed, exterior, sd) else NOT_FOUND


def _cover(placed: Sequence[shapely.Polygon], seen: shapely.Polygon, sd: float) -> bool:
    """Return whether two or more of the placed outlines, chosen greedily, cover a polygon."""
    rest, total = seen, 0.0
    for others in range(MAX_PARTS):
        if not placed:
            return False
        common = [common_area(one, rest) for one in placed]
        k = int(np.argmax(common))
        total += placed[k].area
        rest = shapely.difference(rest, placed[k].buffer(2 * sd))
        if rest.area <= MAX_UNCOVERED * seen.area:
            # A single one is a part whose holes are missing.
            return others > 0 and bool(total * (1 - MAX_OVERLAP) <= seen.area)
    return False


def _placed(model: Shape, seen: shapely.Polygon, sd: float) -> list[shapely.Polygon]:
    """Return a model where one of its arcs is on the exterior of a polygon that contains it."""
    outer = shapely.Polygon(model.polygon.exterior)
    spacing = outer.length / POINTS
    one = _ring(outer, spacing)
    other = _ring(seen, spacing)
    arc = int(ARC * len(one))
    if arc >= len(other):
        return []
    starts = np.arange(0, len(one), EVERY)
    places = (starts[:, None] + np.arange(arc)) % len(one)
    pieces = one[places]
    mean = pieces.mean(axis=1, keepdims=True)
    spread = (np.abs(pieces - mean) ** 2).sum(axis=1)
    spectrum = np.fft.fft(other)
    products = np.fft.ifft(spectrum * np.fft.fft((pieces - mean), len(other)).conj(), axis=1)
    window = np.fft.fft(np.ones(arc), len(other)).conj()
    sums = np.fft.ifft(spectrum * window)
    squares = np.fft.ifft(np.fft.fft(np.abs(other) ** 2) * window).real
    around = squares - np.abs(sums) ** 2 / arc
    rest = (spread[:, None] + around - 2 * np.abs(products)) / arc
    limit = (NOISE * sd + STEP * spacing) ** 2
    found = []
    for flat in _separate(rest, limit, len(one) // 8):
        k, place = np.unravel_index(flat, rest.shape)
        angle = float(np.angle(products[k, place]))
        shift = sums[place] / arc - np.exp(1j * angle) * mean[k, 0]
        move = np.array([shift.real, shift.imag])
        placed = shapely.transform(outer, lambda points, a=angle, m=move: points @ turn(a).T + m)
        outside = shapely.difference(placed, seen).area
        if outside <= MAX_OUTSIDE * outer.area + 2 * sd * outer.length:
            found.append(placed)
    return found


def _separate(rest: Array, limit: float, apart: int) -> list[int]:
    """Return the places of at most TRIED minima below a limit, one of each range of places."""
    found: list[int] = []
    best = rest.min(axis=0)
    for place in np.argsort(best, kind='stable'):
        if best[place] > limit or len(found) == TRIED:
            break
        taken = [flat % rest.shape[1] for flat in found]
        if all(abs(int(place) - other) > apart for other in taken):
            found.append(int(rest[:, place].argmin()) * rest.shape[1] + int(place))
    return found


def _ring(polygon: shapely.Polygon, spacing: float) -> np.ndarray:
    """Return points on the exterior at equal distances, counter-clockwise, as complex numbers."""
    corners = shapely.get_coordinates(polygon.exterior) @ np.array([1, 1j])
    along = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(corners)))])
    count = max(3, round(along[-1] / spacing))
    return np.asarray(np.interp(np.arange(count) * along[-1] / count, along, corners))
