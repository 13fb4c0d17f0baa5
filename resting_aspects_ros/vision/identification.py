"""Which part, in which aspect and where, an observed polygon shows, with probabilities."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
import shapely
from shapely import affinity
from shapely.geometry.polygon import orient

from resting_aspects_ros.arrays import Array
from resting_aspects_ros.errors import InvalidValueError, shown
from resting_aspects_ros.input_files import FileModel, validated
from resting_aspects_ros.vision.boundary import common_area, placed
from resting_aspects_ros.vision.camera import Pinhole, Telecentric, given_points, perspective_fits
from resting_aspects_ros.vision.fitting import (
    OutlineNoise,
    Shape,
    log_sum,
    unknown_likelihood,
)
from resting_aspects_ros.vision.rolling import (
    NEGLIGIBLE,
    Candidate,
    KnownPart,
    ViewFit,
    class_fits,
)

# -- Observed polygons ----------------------------------------------------------------------------


# Bounds of the extent of a polygon, m. Parts are larger than the first and lie on a tray.
MIN_EXTENT, MAX_EXTENT = 1e-5, 2.0
# Maximum distance of a polygon from the origin of the tray frame, m.
MAX_DISTANCE = 100.0
MAX_POINTS, MAX_HOLES = 100_000, 1000
# Maximum share of the area that the repair of a self-crossing polygon may change.
MAX_REPAIR = 0.01
# Reasons of GEOS for which a polygon with holes is not repaired.
MISPLACED_HOLES = ('hole lies outside shell', 'holes are nested')


class _Rings(FileModel):
    """The keys of a polygon."""

    outer: Any
    holes: Any = ()


Polygonal: TypeAlias = shapely.Polygon | Mapping[str, Any] | npt.ArrayLike


def observed_polygon(given: Polygonal) -> shapely.Polygon:
    """Return a valid polygon, the exterior counter-clockwise and the holes clockwise.

    Parameters
    ----------
    given : shapely.Polygon, (n, 2) array, or mapping
        A polygon, the points of its outer boundary, or a mapping with ``outer`` and, optionally,
        ``holes``, a list of (m, 2) arrays; m, tray frame (x right, y up seen from above). The
        direction and the first of the points are not significant; an edge from the last point to
        the first closes a boundary, whether the first point is repeated at the end or not.

    Raises
    ------
    InvalidValueError
        The mapping has other keys, or the polygon crosses itself (unless a repair changes its
        area by at most 1 %), is empty, tiny or huge, is probably in pixels or millimetres, has too
        many points, or has coordinates that are not finite numbers.
    """
    outer, holes = _rings(given)
    if len(holes) > MAX_HOLES:
        raise InvalidValueError(
            f'invalid number of holes {len(holes)}: expected at most {MAX_HOLES}'
        )
    ring = _ring('outer boundary', outer)
    _check_extent(ring)
    inner = [_ring(f'hole {k}', hole) for k, hole in enumerate(holes, start=1)]
    total = len(ring) + sum(map(len, inner))
    if total > MAX_POINTS:
        raise InvalidValueError(
            f'invalid polygon of {total} points: expected at most {MAX_POINTS}'
        )
    polygon = shapely.Polygon(ring, inner)
    if not polygon.is_valid:
        polygon = _repaired(polygon, ring, inner)
    if polygon.area < MIN_EXTENT**2:
        raise InvalidValueError(
            f'invalid polygon with an area of {polygon.area:.3g} m^2: expected a polygon that '
            f'encloses at least {MIN_EXTENT**2:g} m^2'
        )
    return orient(polygon)


def _rings(given: Polygonal) -> tuple[Any, list[Any]]:
    """Return the outer ring and the holes."""
    if isinstance(given, shapely.Polygon):
        return shapely.get_coordinates(given.exterior), [
            shapely.get_coordinates(hole) for hole in given.interiors
        ]
    if isinstance(given, shapely.Geometry):
        raise InvalidValueError(f'invalid polygon of type {given.geom_type}: expected one Polygon')
    if isinstance(given, Mapping):
        holes = given.get('holes', ())
        if 'outer' not in given or not isinstance(holes, list | tuple | np.ndarray):
            raise InvalidValueError(
                f'invalid polygon {shown(given)}: expected outer, a list of points, and '
                'optionally holes, a list of such lists'
            )
        validated(_Rings, given)
        return given['outer'], list(holes)
    return given, []


def _ring(name: str, points: Any) -> Array:
    """Return the points (n, 2) of a ring without repeated ones."""
    ring = given_points(points)
    if ring.ndim != 2 or ring.shape[1] != 2:
        raise InvalidValueError(
            f'invalid {name} {shown(points)}: expected a list of points [x, y] in m'
        )
    if len(ring) > MAX_POINTS + 1:
        raise InvalidValueError(
            f'invalid {name} of {len(ring)} points: expected at most {MAX_POINTS}'
        )
    bad = ~np.isfinite(ring).all(axis=1)
    if bad.any():
        k = int(bad.argmax())
        raise InvalidValueError(
            f'invalid point {k + 1} {shown(ring[k].tolist())} of the {name}: expected finite '
            'numbers'
        )
    closed = len(ring) > 1 and bool((ring[0] == ring[-1]).all())
    different = np.ones(len(ring), dtype=np.bool_)
    different[1:] = (ring[1:] != ring[:-1]).any(axis=1)
    ring = ring[different]
    if len(ring) - closed < 3:
        raise InvalidValueError(
            f'invalid {name} of {max(len(ring) - closed, 0)} different points: expected at least 3'
        )
    return ring


def _check_extent(ring: Array) -> None:
    size = np.ptp(ring, axis=0)
    extent = float(size.max())
    if extent < MIN_EXTENT:
        raise InvalidValueError(
            f'invalid polygon {extent:.3g} m long: expected at least {MIN_EXTENT:g} m'
        )
    if extent > MAX_EXTENT:
        raise InvalidValueError(
            f'invalid polygon {extent:.4g} m long: expected at most {MAX_EXTENT:g} m; its '
            'coordinates are probably in pixels or millimetres, and must be in m'
        )
    if np.abs(ring).max() > MAX_DISTANCE:
        raise InvalidValueError(
            f'invalid polygon at {shown(ring[0].tolist())} m: expected one within '
            f'{MAX_DISTANCE:g} m of the origin of the tray frame'
        )


def _repaired(polygon: shapely.Polygon, ring: Array, holes: list[Array]) -> shapely.Polygon:
    """Return the largest piece of the valid polygon; raises InvalidValueError if it differs."""
    reason = shapely.is_valid_reason(polygon).partition('[')[0].lower()
    pieces = shapely.get_parts(shapely.make_valid(polygon))
    pieces = [each for each in pieces if isinstance(each, shapely.Polygon)]
    if reason in MISPLACED_HOLES:  # which a repair would remove, if they are small
        pieces = []
    enclosed = _enclosed(ring) - sum(map(_enclosed, holes))
    if pieces:
        largest = max(pieces, key=lambda each: each.area)
        # The second sum is that of a figure of eight, whose loops cancel in the first.
        total = sum(each.area for each in pieces)
        if max(abs(largest.area - enclosed), total - largest.area) <= MAX_REPAIR * enclosed:
            return largest
    raise InvalidValueError(
        f'invalid polygon ({reason}): expected a boundary that does not cross itself, with its '
        'holes inside it'
    )


def _enclosed(ring: Array) -> float:
    x, y = (ring - ring[0]).T
    return abs(float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum())) / 2


# Details of an observed polygon that are smaller than this share of the noise are left out.
DETAIL = 0.25


class SurfaceViews:
    """The observed polygon as it would be on the tray, by height of its silhouette."""

    def __init__(
        self, seen: shapely.Polygon, noise: OutlineNoise, camera: Telecentric | None
    ) -> None:
        simple = seen.simplify(DETAIL * noise.sd, preserve_topology=False)
        whole = isinstance(simple, shapely.Polygon) and simple.is_valid and simple.area > 0
        self._seen = simple if whole else seen
        self._camera = camera
        self._views: dict[float, Shape] = {}

    def at(self, height: float) -> Shape:
        """Return the polygon as it is if the whole boundary is at a height, m."""
        if not isinstance(self._camera, Pinhole):
            height = 0.0
        if height not in self._views:
            polygon = self._seen
            if isinstance(self._camera, Pinhole):
                polygon = self._camera.projected(polygon, height)
            self._views[height] = Shape(polygon)
        return self._views[height]

    def parallax(self, height: float) -> float:
        """Return by how much the outline of a part may differ from the view at its height, m.

        An edge at the height 0 is displaced most, by its distance from the foot point times
        height / H.
        """
        if not isinstance(self._camera, Pinhole):
            return 0.0
        x, y, top = self._camera.position
        reach = np.linalg.norm(shapely.get_coordinates(self._seen) - (x, y), axis=1).max()
        return float(reach * height / top)


# -- Parts that touch -----------------------------------------------------------------------------


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
    fitting = [
        one for each in outlines if each.area <= seen.area for one in _placed(each, exterior, sd)
    ]
    return FOUND if _cover(fitting, exterior, sd) else NOT_FOUND


def _cover(outlines: Sequence[shapely.Polygon], seen: shapely.Polygon, sd: float) -> bool:
    """Return whether two or more of the placed outlines, chosen greedily, cover a polygon."""
    rest, total = seen, 0.0
    for others in range(MAX_PARTS):
        if not outlines:
            return False
        common = [common_area(one, rest) for one in outlines]
        k = int(np.argmax(common))
        total += outlines[k].area
        rest = shapely.difference(rest, outlines[k].buffer(2 * sd))
        if rest.area <= MAX_UNCOVERED * seen.area:
            # A single one is a part whose holes are missing.
            return others > 0 and bool(total * (1 - MAX_OVERLAP) <= seen.area)
    return False


def _placed(model: Shape, seen: shapely.Polygon, sd: float) -> list[shapely.Polygon]:
    """Return a model where one of its arcs is on the exterior of a polygon that contains it."""
    outer = shapely.Polygon(model.polygon.exterior)
    spacing = outer.length / POINTS
    one = _ring_of(outer, spacing)
    other = _ring_of(seen, spacing)
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
        moved = placed(outer, shift.real, shift.imag, angle)
        outside = shapely.difference(moved, seen).area
        if outside <= MAX_OUTSIDE * outer.area + 2 * sd * outer.length:
            found.append(moved)
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


def _ring_of(polygon: shapely.Polygon, spacing: float) -> np.ndarray:
    """Return points on the exterior at equal distances, counter-clockwise, as complex numbers."""
    ring = polygon.exterior
    count = max(3, round(ring.length / spacing))
    points = shapely.line_interpolate_point(ring, np.arange(count) / count, normalized=True)
    return np.asarray(shapely.get_coordinates(points) @ np.array([1, 1j]))


# -- Identification -------------------------------------------------------------------------------


# Prior probabilities that a polygon shows none of the known parts, or several that touch.
NONE_PRIOR, TOUCHING_PRIOR = 0.01, 0.03
# Outlines that differ at least so much, as a multiple of the noise, are not fitted, except for the
# nearest.
FAR, NEAREST = 8.0, 2
# Polygons fit as well as others if the logarithms of their likelihoods differ by less.
AS_WELL = 3.0
# The prior share of a class is at least this, because a share that was never seen is not zero.
MIN_SHARE = 1e-4


@dataclass(frozen=True, eq=False)
class Identification:
    """What an observed polygon may show.

    candidates : tuple of Candidate
        By posterior, descending; those that are far from the polygon are left out, except for the
        nearest.
    none : float
        Posterior probability that the polygon shows none of the known parts.
    touching : float
        Posterior probability that it shows several known parts that touch or overlap.
    effective_samples : float
        n, the number of independent errors of the boundary.
    mirrored : tuple of Candidate
        Candidates that fit the mirror image of the polygon as well as the first one fits the
        polygon, which they do not fit. If y is down in the coordinates, they are right instead.
    """

    candidates: tuple[Candidate, ...]
    none: float
    touching: float
    effective_samples: float
    mirrored: tuple[Candidate, ...] = ()

    @property
    def answer(self) -> str:
        """'part', 'none' or 'touching', whichever is most probable."""
        if 1 - self.none - self.touching >= max(self.none, self.touching):
            return 'part'
        return 'none' if self.none >= self.touching else 'touching'

    @property
    def best(self) -> Candidate | None:
        """The most probable candidate; None if the answer is not a part."""
        return self.candidates[0] if self.answer == 'part' else None


@dataclass(frozen=True, eq=False)
class _Hypothesis:
    """A class of a known part with its fits, the most probable one first."""

    known: KnownPart
    index: int
    seen: Shape
    fits: tuple[tuple[float, ViewFit], ...]
    prior: float

    @property
    def evidence(self) -> float:
        return log_sum([each[0] for each in self.fits])


def identify(
    seen: shapely.Polygon,
    known: Sequence[KnownPart],
    noise: OutlineNoise | None = None,
    camera: Telecentric | None = None,
) -> Identification:
    """Return which class of which part an observed polygon shows, and where.

    Parameters
    ----------
    seen : Polygon
        Tray frame, m, as `observed_polygon` returns it.
    known : sequence of KnownPart
        At least one; all are equally probable before.
    noise : OutlineNoise, optional
        Errors of the boundary.
    camera : Telecentric or Pinhole, optional
        Of a Pinhole, the hypotheses are what it sees of each part where the polygon is.
    """
    if not known:
        raise InvalidValueError('invalid number of parts 0: expected at least one')
    if isinstance(camera, Pinhole):
        _check_height(camera.position[2], known)
    noise = noise or OutlineNoise()
    found = _identified(seen, known, noise, camera)
    return replace(found, mirrored=_mirrored(found, seen, known, noise, camera))


def _check_height(top: float, known: Sequence[KnownPart]) -> None:
    """Raise InvalidValueError if the camera at a height, m, is not above all outlines."""
    for part in known:
        highest = max(part.outlines, key=lambda outline: outline.height)
        if top <= highest.height:
            raise InvalidValueError(
                f'invalid height {top:.4g} m of the camera: expected more than the height '
                f'{highest.height:.4g} m of {part.part.name} in aspect {highest.aspects[0]}'
            )


def _mirrored(
    found: Identification,
    seen: shapely.Polygon,
    known: Sequence[KnownPart],
    noise: OutlineNoise,
    camera: Telecentric | None,
) -> tuple[Candidate, ...]:
    """Return `Identification.mirrored`."""
    first = found.candidates[0]
    outlines = {
        (part.part.name, each.symmetry_class): each for part in known for each in part.outlines
    }
    symmetric = outlines[first.part, first.symmetry_class].mirror_symmetric
    if found.answer == 'touching' or (found.answer == 'part' and symmetric):
        return ()
    # The position of the camera is in the same coordinates, and so reversed, too.
    foot = (0.0, camera.position[1] if isinstance(camera, Pinhole) else 0.0)
    other = _identified(affinity.scale(seen, 1.0, -1.0, origin=foot), known, noise, camera)
    own = {(each.part, each.symmetry_class): each.log_likelihood for each in found.candidates}
    return tuple(
        each
        for each in other.candidates
        if other.answer == 'part'
        and each.log_likelihood > first.log_likelihood - AS_WELL
        and each.log_likelihood > own.get((each.part, each.symmetry_class), -np.inf) + AS_WELL
    )


def _identified(
    seen: shapely.Polygon,
    known: Sequence[KnownPart],
    noise: OutlineNoise,
    camera: Telecentric | None,
) -> Identification:
    """Return the answer without `mirrored`."""
    views = SurfaceViews(seen, noise, camera)
    count = views.at(0.0).perimeter / noise.correlation
    share = (1 - NONE_PRIOR - TOUCHING_PRIOR) / len(known)
    found = []
    for part, k, near in _near(known, views, noise):
        prior = share * max(float(part.shares[k]), MIN_SHARE)
        if isinstance(camera, Pinhole):
            shape = views.at(0.0)
            fits = perspective_fits(part, k, shape, camera, noise, count)
        else:
            shape = near
            fits = class_fits(part.views[k], part.outlines[k].yaw_symmetry, shape, noise, count)
        found.append(_Hypothesis(part, k, shape, fits, prior))
    found.sort(key=lambda each: -each.evidence - np.log(each.prior))
    scores = [each.evidence + np.log(each.prior) for each in found]
    nearest = min((one for each in found for _, one in each.fits), key=lambda one: one.fit.square)
    size = float(np.ptp(shapely.get_coordinates(views.at(0.0).polygon), axis=0).max())
    unknown = unknown_likelihood(nearest.fit, nearest.shape, noise, count, size)
    scores += [unknown + np.log(NONE_PRIOR), unknown + np.log(TOUCHING_PRIOR)]
    # Whether parts touch is found out only where it matters, because it takes longer.
    posterior = np.exp(np.array(scores) - log_sum(scores))
    if posterior[-2:].sum() > 1e-3:
        flat = views.at(found[0].known.outlines[found[0].index].height)
        odds = touching_odds(flat, [v.shapes[0] for part in known for v in part.views], noise.sd)
        scores[-1] = unknown + np.log(max(TOUCHING_PRIOR * odds, 1e-12))
        posterior = np.exp(np.array(scores) - log_sum(scores))
    candidates = tuple(
        _candidate(each, posterior[k], noise, isinstance(camera, Pinhole))
        for k, each in enumerate(found)
        if k == 0 or posterior[k] > np.exp(-NEGLIGIBLE)
    )
    return Identification(candidates, float(posterior[-2]), float(posterior[-1]), count)


def _near(
    known: Sequence[KnownPart], views: SurfaceViews, noise: OutlineNoise
) -> list[tuple[KnownPart, int, Shape]]:
    """Return the classes that are not far from the observed polygon, and always the nearest.

    See Shape.difference; the parallax may add to it.
    """
    rows = []
    for part in known:
        for k, outline in enumerate(part.outlines):
            seen = views.at(outline.height)
            far = min(shape.difference(seen) for shape in part.views[k].shapes)
            rows.append((far - views.parallax(outline.height), part, k, seen))
    rows.sort(key=lambda row: row[0])
    return [row[1:] for n, row in enumerate(rows) if n < NEAREST or row[0] < FAR * noise.sd]


def _candidate(
    each: _Hypothesis, posterior: float, noise: OutlineNoise, single: bool
) -> Candidate:
    """Return the candidate; ``single``: each fit has one pose for each aspect of the class."""
    known, k = each.known, each.index
    outline, placement = known.outlines[k], known.placements[k]
    first = each.fits[0][1]
    best = first.fit
    rolls = len(known.views[k].shapes) > 1
    # Those for the first turn of an outline precede the others.
    poses = len(outline.aspects) if single else None
    return Candidate(
        known.part.name,
        outline.symmetry_class,
        outline.aspects,
        best.x,
        best.y,
        best.yaw,
        best.overlap(first.shape.polygon, each.seen.polygon.simplify(noise.sd / 2)),
        best.largest,
        float(np.sqrt(best.square)),
        each.evidence,
        each.prior,
        float(posterior),
        first.roll,
        tuple(
            pose
            for _, one in each.fits
            for pose in placement.poses(
                one.fit.x, one.fit.y, one.fit.yaw, one.orientation if rolls else None
            )[:poses]
        ),
    )
