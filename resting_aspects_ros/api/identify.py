"""Tell from an observed outline which part lies where and how, and locate parts.

If an identification may be wrong, a hint states why: missing holes, a wrong scale, a mirrored
image.
"""

import dataclasses
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import shapely

from resting_aspects_ros.api.drop import DropResult, drop
from resting_aspects_ros.aspects.aspect_set import AspectSet
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.errors import InvalidValueError, located, shown, warn
from resting_aspects_ros.input_files import file_text, parse_json, read_input
from resting_aspects_ros.part.library import given_part
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.document import SCHEMA_VERSION, plain
from resting_aspects_ros.statistics.distribution import Distribution
from resting_aspects_ros.vision.camera import Telecentric
from resting_aspects_ros.vision.fitting import OutlineNoise
from resting_aspects_ros.vision.identification import (
    Identification,
    Polygonal,
    identify,
    observed_polygon,
)
from resting_aspects_ros.vision.location import Pose
from resting_aspects_ros.vision.outline import Outline, find_outlines
from resting_aspects_ros.vision.rolling import KnownPart

# Added to each count of a distribution, so that an aspect that was never seen remains possible.
PSEUDO_COUNT = 0.5

Shares = Distribution | DropResult | Mapping[int, float] | npt.ArrayLike

# Points of a boundary, and the maximum distance of equal ones as a share of their mean radius.
POINTS, EQUAL = 256, 0.02
# The same as a multiple of the noise, for a boundary of the right size.
NOISY = 5.0
# Ratio of a length in another unit to the same length in m.
_UNITS = {1000.0: 'mm', 100.0: 'cm', 39.3701: 'inches', 3.28084: 'feet'}
_Ring = npt.NDArray[np.complex128]
# Maximum size of a file with an outline.
MAX_BYTES = 1 << 24


def known_part(part: Part | str | Path, shares: Shares | None = None) -> KnownPart:
    """Prepare a part for `identify_part` and `locate_part`, so that each call takes milliseconds.

    Parameters
    ----------
    part : Part, str or Path
        A part, or what `load_part` accepts.
    shares : Distribution, DropResult, mapping or (k,) array, optional
        How often the part lies in each aspect: drops, a mapping from aspect ids to shares (aspects
        that it does not contain have the share 0), or the shares of all aspects by id, such as
        ``result.long_run.shares`` of `reorient`. By default the part is dropped 1000 times on
        rubber_mat.

    Returns
    -------
    KnownPart

    Raises
    ------
    InvalidValueError
        The shares are negative, all zero, or of other aspects; or the part has no aspect.
    PartError
        An outline has several pieces or no area.

    Examples
    --------
    >>> import resting_aspects_ros as ra
    >>> known = ra.known_part('l_bracket', {1: 0.5, 3: 0.5})
    >>> known.shares.tolist()
    [0.5, 0.0, 0.5, 0.0, 0.0]
    """
    loaded: Part | None
    if shares is None:
        shares = drop(part, keep_poses=False, model_range=False)
        loaded, aspects = shares.part, shares.distribution.aspects
        assert loaded is not None  # it was dropped
    else:
        loaded = given_part(part)
        aspects = find_aspects(loaded)
    if not len(aspects):
        raise InvalidValueError(f'invalid part {loaded.name}: expected a part with an aspect')
    by_aspect = _given(shares, aspects)
    outlines = find_outlines(loaded, aspects)
    by_class = np.array(
        [sum(by_aspect[number - 1] for number in each.aspects) for each in outlines]
    )
    found = KnownPart(loaded, aspects, outlines, by_class / by_class.sum())
    _ = found.views, [each.members for each in found.placements]  # computed once, now
    return found


def identify_part(
    polygon: Polygonal,
    parts: KnownPart | Part | str | Path | Iterable[KnownPart | Part | str | Path],
    *,
    noise: OutlineNoise | None = None,
    camera: Telecentric | None = None,
) -> Identification:
    """Return which aspects of which parts an observed polygon may show, with poses.

    Parameters
    ----------
    polygon : shapely.Polygon, (n, 2) array, or mapping with 'outer' and 'holes'
        Tray frame, m; seen from above, x right and y up. See `observed_polygon`.
    parts : KnownPart, Part, str or Path, or several
        Candidates, equally probable before. Others than a KnownPart are prepared at each call,
        which takes most of the time. Of equal parts, the first is used.
    noise : OutlineNoise, optional
        Errors of the boundary, by default 0.1 mm (standard deviation), independent after 1 mm.
    camera : Telecentric or Pinhole, optional
        With a Pinhole, the candidates are what it sees of the parts where the polygon is; the
        polygon is as seen on the surface.

    Returns
    -------
    Identification
        Candidates by posterior, and the probabilities of 'none of these' and 'touching parts'.

    Raises
    ------
    InvalidValueError
        The polygon is not valid, or there is no part.

    Examples
    --------
    >>> import resting_aspects_ros as ra
    >>> found = ra.identify_part([[0, 0], [0.04, 0], [0.04, 0.02], [0, 0.02]], 'l_bracket')
    >>> found.answer, found.best.aspects
    ('part', (3,))
    """
    seen = observed_polygon(polygon)
    if not isinstance(noise, OutlineNoise | None):
        raise InvalidValueError(f'invalid noise {shown(noise)}: expected an OutlineNoise')
    if not isinstance(camera, Telecentric | None):
        raise InvalidValueError(
            f'invalid camera {shown(camera)}: expected a Pinhole or Telecentric camera'
        )
    if isinstance(parts, KnownPart | Part | str | Path):
        parts = [parts]
    known: dict[str, KnownPart] = {}
    for each in parts:
        one = each if isinstance(each, KnownPart) else known_part(each)
        first = known.setdefault(one.part.part_sha256, one)
        if first is not one:
            warn(f'{one.part.name} is the same part as {first.part.name}: it is left out')
    return identify(seen, list(known.values()), noise, camera)


def locate_part(
    part: KnownPart | Part | str | Path, aspect: int, x: float, y: float, yaw: float
) -> tuple[Pose, ...]:
    """Return the poses of a part that a camera sees in an aspect at (x, y, yaw).

    Parameters
    ----------
    part : KnownPart, Part, str or Path
        Others than a KnownPart are prepared at each call, which takes most of the time.
    aspect : int
        Id of the aspect.
    x, y : float
        Projection of the centre of mass, tray frame, m.
    yaw : float
        Yaw of the outline of the class, rad, counter-clockwise seen from above.

    Returns
    -------
    tuple of Pose
        Tray frame; first those in the aspect. The others look the same: other aspects of the
        symmetry class, and rotations of the outline onto itself that no rotation of the part
        causes.

    Raises
    ------
    InvalidValueError
        The part has no such aspect, or a value is not a finite number.

    Examples
    --------
    >>> import resting_aspects_ros as ra
    >>> poses = ra.locate_part('l_bracket', 1, 0.1, 0.05, 0.0)
    >>> [pose.aspect for pose in poses], [pose.yaw_known for pose in poses]
    ([1], [True])
    """
    # The poses do not depend on the shares, so that the part need not be dropped for them.
    known = part if isinstance(part, KnownPart) else known_part(part, {1: 1.0})
    for placement in known.placements:
        if not isinstance(aspect, bool) and aspect in placement.outline.aspects:
            poses = placement.poses(x, y, yaw)
            return tuple(sorted(poses, key=lambda pose: pose.aspect != aspect))
    raise InvalidValueError(
        f'invalid aspect {shown(aspect)} of {known.part.name}: expected 1 to {len(known.aspects)}'
    )


def identification_document(found: Identification) -> dict[str, Any]:
    """Return an identification as a document of plain JSON types: m, rad, quaternions xyzw."""
    return {
        'schema_version': SCHEMA_VERSION,
        'answer': found.answer,
        'none': found.none,
        'touching': found.touching,
        'effective_samples': found.effective_samples,
        'mirrored': [
            {name: plain(getattr(each, name)) for name in ('part', 'symmetry_class', 'aspects')}
            for each in found.mirrored
        ],
        'candidates': [plain(dataclasses.asdict(each)) for each in found.candidates],
    }


def _given(shares: Shares, aspects: AspectSet) -> npt.NDArray[np.float64]:
    """Return the given shares (k,) of the aspects; raises InvalidValueError."""
    if isinstance(shares, DropResult):
        shares = shares.distribution
    if isinstance(shares, Distribution):
        if not aspects.matches(shares.aspects):
            raise InvalidValueError(
                'invalid shares: expected the distribution of the same part, with the same aspects'
            )
        return np.asarray(shares.counts + PSEUDO_COUNT)
    count = len(aspects)
    if isinstance(shares, Mapping):
        for number in shares:
            if isinstance(number, bool) or number not in range(1, count + 1):
                raise InvalidValueError(
                    f'invalid aspect {shown(number)} of the shares: expected 1 to {count}'
                )
        shares = [shares.get(number, 0.0) for number in range(1, count + 1)]
    try:
        found = np.asarray(shares, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        found = np.zeros(0)
    if found.shape != (count,) or not (
        np.isfinite(found).all() and found.min() >= 0 < found.sum()
    ):
        raise InvalidValueError(
            f'invalid shares {shown(shares)}: expected {count} numbers of 0 or more, one for each '
            'aspect, with a sum above 0'
        )
    return found


@dataclass(frozen=True)
class _Similar:
    """An outline whose outer boundary has the same shape: the observed one is larger by scale."""

    part: str
    outline: Outline
    scale: float

    @property
    def name(self) -> str:
        return _name(self.part, self.outline.aspects)


def _name(part: str, aspects: Sequence[int]) -> str:
    return f'{part}, aspect{"s" * (len(aspects) > 1)} {", ".join(map(str, aspects))}'


def identification_hint(
    found: Identification,
    seen: shapely.Polygon,
    known: Sequence[KnownPart],
    noise: OutlineNoise | None = None,
) -> str:
    """Return why an outline shows no known part, or another one; can be empty.

    Parameters
    ----------
    found : Identification
        The answer for ``seen``.
    seen : Polygon
        Tray frame, m, as `observed_polygon` returns it.
    known : sequence of KnownPart
    noise : OutlineNoise, optional
        That of the identification.
    """
    return ' '.join(filter(None, (_reason(found, seen, known, noise), mirror_text(found))))


def mirror_text(found: Identification) -> str:
    """Return which aspects the mirror image of an outline shows; can be empty."""
    if not found.mirrored:
        return ''
    names = '; '.join(_name(each.part, each.aspects) for each in found.mirrored)
    return (
        f'The mirror image of the outline fits {names}: if y points down in its coordinates, as '
        'in an image, reverse the sign of y.'
    )


def _reason(
    found: Identification,
    seen: shapely.Polygon,
    known: Sequence[KnownPart],
    noise: OutlineNoise | None,
) -> str:
    """Return why an outline shows no known part; can be empty."""
    if found.answer == 'part':
        return ''
    sd = (noise or OutlineNoise()).sd
    similar = list(_similar(seen, known, sd))
    if not similar:
        return ''
    best = min(similar, key=lambda each: abs(np.log(each.scale)))
    if abs(best.scale - 1) * best.outline.length / 2 > max(3 * sd, EQUAL * best.outline.length):
        return _scale_text(best)
    for each in similar:
        if abs(np.log(each.scale)) < 2 * EQUAL and _same_holes(seen, each.outline):
            return _noise_text(found, sd)
    return _holes_text(best, seen)


def _scale_text(best: _Similar) -> str:
    text = f'It has the shape of {best.name}, but its lengths are {best.scale:.3g} times as long'
    for ratio, unit in _UNITS.items():
        if abs(best.scale / ratio - 1) < EQUAL:
            return f'{text}: its coordinates are probably in {unit} instead of m.'
        if abs(best.scale * ratio - 1) < EQUAL:
            return f'{text}: the mesh is probably not in the assumed unit (--unit).'
    return (
        f'{text}: check the scale of the camera (pixels per mm), the unit of the coordinates (m), '
        'and that of the mesh (--unit).'
    )


def _holes_text(best: _Similar, seen: shapely.Polygon) -> str:
    count, expected = len(seen.interiors), len(best.outline.polygon.interiors)
    text = f'Its outer boundary is that of {best.name}, but '
    if count == expected:
        return f'{text}its holes differ.'
    many = f'{expected} hole{"" if expected == 1 else "s"}' if expected else 'no hole'
    text += f'it has {count or "no"} hole{"" if count == 1 else "s"} where {many} '
    text += f'{"are" if expected > 1 else "is"} expected'
    if count < expected:
        return f'{text}: through-holes are part of an outline, and belong in "holes".'
    return f'{text}.'


def _noise_text(found: Identification, sd: float) -> str:
    residual = 1000 * min(each.residual for each in found.candidates)
    return (
        f'The nearest outline deviates by {residual:.2g} mm (root mean square), which is too much '
        f'for a noise of {1000 * sd:.2g} mm.'
    )


def _same_holes(seen: shapely.Polygon, outline: Outline) -> bool:
    def area(polygon: shapely.Polygon) -> float:
        return float(shapely.Polygon(polygon.exterior).area - polygon.area)

    model = outline.polygon
    difference = abs(area(seen) - area(model))
    return len(seen.interiors) == len(model.interiors) and difference <= 0.1 * area(model)


def _similar(seen: shapely.Polygon, known: Sequence[KnownPart], sd: float) -> Iterator[_Similar]:
    """Yield the outlines whose outer boundaries have the shape of the observed one."""
    ring = _ring(seen)
    # At the right scale, the noise can be larger.
    noise = NOISY * sd / float(np.abs(ring).mean())
    for part in known:
        for outline in part.outlines:
            for polygon in (outline.polygon, *outline.family):
                scale, distance = _fit(_ring(polygon), ring)
                right = abs(np.log(scale)) < 2 * EQUAL
                if distance <= (max(EQUAL, noise) if right else EQUAL):
                    yield _Similar(part.part.name, outline, scale)


def _ring(polygon: shapely.Polygon) -> _Ring:
    """Return points on the exterior at equal distances, about their mean, counter-clockwise.

    Steps of pixels are smoothed, because they make the boundary longer.
    """
    simple = polygon.simplify(0.005 * np.sqrt(polygon.area)).exterior
    exterior = simple if simple.is_ccw else shapely.reverse(simple)
    along = np.arange(POINTS) / POINTS
    points = shapely.get_coordinates(
        shapely.line_interpolate_point(exterior, along, normalized=True)
    )
    found = points @ np.array([1, 1j])
    return np.asarray(found - found.mean())


def _fit(model: _Ring, seen: _Ring) -> tuple[float, float]:
    """Return the scale of the best fit over start and yaw, and its distance over the radius."""
    products = np.fft.ifft(np.fft.fft(seen) * np.fft.fft(model).conj())
    energies = float((np.abs(model) ** 2).sum()), float((np.abs(seen) ** 2).sum())
    best = float(np.abs(products).max())
    rest = max(1 - best**2 / (energies[0] * energies[1]), 0.0)
    return best / energies[0], float(np.sqrt(rest))


def read_polygon(path: Path) -> shapely.Polygon:
    """Return the polygon of a document with outer and holes; raises InvalidValueError."""
    document = parse_json(path, read_input(path, MAX_BYTES, 'polygon'))
    if 'outlines' in document and 'outer' not in document:
        raise InvalidValueError(
            f'invalid --polygon {file_text(path)}: expected one outline with outer and holes; '
            'this is the document of resting_aspects outlines, whose list outlines has one for '
            'each class'
        )
    with located(file_text(path)):
        return observed_polygon(document)
