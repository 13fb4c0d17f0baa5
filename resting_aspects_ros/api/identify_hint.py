"""Why an identification may be wrong: missing holes, a wrong scale, or a mirrored image."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import shapely

from resting_aspects_ros.core.vision.identification import Identification
from resting_aspects_ros.core.vision.known_part import KnownPart
from resting_aspects_ros.core.vision.likelihood import OutlineNoise
from resting_aspects_ros.core.vision.outline import Outline

# Points of a boundary, and the maximum distance of equal ones as a share of their mean radius.
POINTS, EQUAL = 256, 0.02
# The same as a multiple of the noise, for a boundary of the right size.
NOISY = 5.0
# Ratio of a length in another unit to the same length in m.
_UNITS = {1000.0: 'mm', 100.0: 'cm', 39.3701: 'inches', 3.28084: 'feet'}

_Ring = npt.NDArray[np.complex128]


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
