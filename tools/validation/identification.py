"""Validation of identification: rendered images, other parts, and parts that touch."""

import dataclasses
import time
from collections.abc import Iterator

import contourpy
import numpy as np
import numpy.typing as npt
import shapely
from PIL import Image, ImageDraw
from rich.progress import track
from scipy.ndimage import gaussian_filter
from shapely import affinity

from resting_aspects_ros.api.identify import known_part
from resting_aspects_ros.part.library import PartLibrary
from resting_aspects_ros.vision.fitting import OutlineNoise
from resting_aspects_ros.vision.identification import identify, observed_polygon
from resting_aspects_ros.vision.outline import Outline, look_alikes
from resting_aspects_ros.vision.rolling import KnownPart
from validation.dropper import ROOT, SEED

Array = npt.NDArray[np.float64]

PIXEL, FINE = 1e-4, 8  # m; number of subpixels along each side
IMAGES = 60  # of each class
TOUCHING = 150


@dataclasses.dataclass(frozen=True)
class Camera:
    """Blur of the edge, px, and noise: standard deviation, of full contrast, and blur, px."""

    name: str
    blur: float
    noise: float
    grain: float


# Standard deviation of the boundary, px: noise x sqrt(2 pi) x blur. The correlation of blurred
# noise along the boundary is 2 sqrt(pi) x grain.
SHARP = Camera('sharp: blur 1 px, noise 10 %, independent pixels', 1.0, 0.10, 0.0)
GRAINY = Camera('grainy: blur 3 px, noise 13 %, grain 2.8 px', 3.0, 0.133, 2.82)
COARSE = Camera('coarse: blur 4 px, noise 15 %, grain 2.8 px', 4.0, 0.15, 2.82)


def identification() -> Iterator[str]:
    """Validate the identification of the example parts."""
    library = PartLibrary(ROOT / 'config' / 'parts')
    known = [known_part(library.load(name)) for name in library.names()]
    yield '## Identification'
    yield ''
    yield from _images(known)
    yield from _refused(known)


def rendered(
    polygon: shapely.Polygon, camera: Camera, generator: np.random.Generator
) -> shapely.Polygon:
    """Return the contour of a polygon in an image with blur and noise, m.

    The polygon is rasterized with FINE x FINE subpixels for each pixel of PIXEL; the contour is
    that of half the contrast, by marching squares with linear interpolation.
    """
    margin = 4 * (camera.blur + 1) * PIXEL
    low = np.array(polygon.bounds[:2]) - margin
    size = np.ceil((np.array(polygon.bounds[2:]) + margin - low) / PIXEL).astype(int)
    image = Image.new('L', tuple(size * FINE), 0)
    draw = ImageDraw.Draw(image)
    for ring, value in [(polygon.exterior, 255), *((r, 0) for r in polygon.interiors)]:
        # The centre of subpixel k has the coordinate k + 1/2.
        points = (shapely.get_coordinates(ring) - low) / PIXEL * FINE - 0.5
        draw.polygon([tuple(point) for point in points], fill=value)
    pixels = np.asarray(image, dtype=np.float64) / 255
    pixels = pixels.reshape(size[1], FINE, size[0], FINE).mean(axis=(1, 3))
    pixels = gaussian_filter(pixels, camera.blur)
    noise = generator.standard_normal(pixels.shape)
    if camera.grain:
        noise = gaussian_filter(noise, camera.grain)
        noise /= noise.std()
    lines = contourpy.contour_generator(z=pixels + camera.noise * noise).lines(0.5)
    rings = [shapely.Polygon(np.asarray(line)) for line in lines if len(line) > 3]
    rings = [ring for ring in rings if ring.area > 50]
    outer = max(rings, key=lambda ring: ring.area)
    holes = [r.exterior.coords for r in rings if r is not outer and outer.contains(r)]
    found = shapely.Polygon(outer.exterior.coords, holes)
    return shapely.transform(found, lambda points: low + (points + 0.5) * PIXEL)


def _placed(outline: Outline, generator: np.random.Generator) -> tuple[shapely.Polygon, Array]:
    """Return an outline at a random camera pose, and x, y, m, and yaw, rad."""
    x, y = generator.uniform(-0.1, 0.1, 2)
    yaw = generator.uniform(-np.pi, np.pi)
    turned = affinity.rotate(outline.polygon, yaw, origin=(0, 0), use_radians=True)
    return affinity.translate(turned, x, y), np.array([x, y, yaw])


def _images(known: list[KnownPart]) -> Iterator[str]:
    yield '### Rendered images'
    yield ''
    yield (
        f'{IMAGES} images of each class of each part at random poses, rasterized at 10 px/mm, '
        'blurred, with noise; the contours are found by marching squares (contourpy). '
        'Identified with the outlines of the part; the stated '
        'noise is 0.1 mm (default), and 0.2 mm for the coarse camera. *Right*: the most '
        'probable class, or one that is called its look-alike, is the true one. Errors are the '
        '99th percentiles of yaw (modulo the symmetry of the outline) and of the centroid.'
    )
    yield ''
    yield '| camera | images | right | refused | yaw (deg) | position (mm) | time (ms) |'
    yield '|---|---|---|---|---|---|---|'
    for camera, noise in (
        (SHARP, OutlineNoise()),
        (GRAINY, OutlineNoise()),
        (COARSE, OutlineNoise(2e-4)),
    ):
        yield _images_row(known, camera, noise)
    yield ''


def _images_row(known: list[KnownPart], camera: Camera, noise: OutlineNoise) -> str:
    generator = np.random.default_rng(SEED)
    right = refused = 0
    yaws, places, times = [], [], []
    for part in track(known, camera.name.partition(':')[0]):
        alike = look_alikes(part.outlines)
        for k, outline in enumerate(part.outlines):
            same = {a.symmetry_class for a in alike[k + 1] if a.verdict != 'distinct'} | {k + 1}
            for _ in range(IMAGES):
                polygon, (_, _, yaw) = _placed(outline, generator)
                seen = observed_polygon(rendered(polygon, camera, generator))
                start = time.process_time()
                found = identify(seen, [part], noise)
                times.append(1000 * (time.process_time() - start))
                best = found.best
                refused += best is None
                right += best is not None and best.symmetry_class in same
                if best is None or best.symmetry_class != k + 1:
                    continue
                if order := outline.yaw_symmetry:
                    off = np.angle(np.exp(1j * order * (best.yaw - yaw))) / order
                    yaws.append(abs(np.degrees(off)))
                turned = affinity.rotate(
                    outline.polygon, best.yaw, origin=(0, 0), use_radians=True
                )
                there = affinity.translate(turned, best.x, best.y).centroid
                places.append(1000 * there.distance(polygon.centroid))
    return (
        f'| {camera.name} | {len(times)} | {right} | {refused} | {np.percentile(yaws, 99):.2f} '
        f'| {np.percentile(places, 99):.3f} '
        f'| {np.median(times):.1f}, {np.percentile(times, 99):.1f} |'
    )


def _refused(known: list[KnownPart]) -> Iterator[str]:
    yield '### Other parts and touching parts'
    yield ''
    yield (
        'Sharp images. *Other part*: each outline of each part is identified with all other '
        'parts; those that fit an outline of them within 0.2 mm (root mean square) are left out. '
        f'*Touching*: {TOUCHING} pairs of parts that touch, both among the candidates. '
        '*Overlapping*: the same, moved into each other by a fifth of their length.'
    )
    yield ''
    yield '| shown | n | none | touching | taken for a part | time (ms) |'
    yield '|---|---|---|---|---|---|'
    generator = np.random.default_rng(SEED)
    answers, times = [], []
    for part in track(known, 'other parts'):
        rest = [each for each in known if each is not part]
        for outline in part.outlines:
            clear = identify(outline.polygon, rest).candidates
            if min(each.residual for each in clear) < 2e-4:
                continue
            polygon, _ = _placed(outline, generator)
            seen = observed_polygon(rendered(polygon, SHARP, generator))
            start = time.process_time()
            answers.append(identify(seen, rest).answer)
            times.append(1000 * (time.process_time() - start))
    yield _answers_row('other part', answers, times)
    for name, depth in (('touching', 0.0), ('overlapping', 0.2)):
        answers, times = [], []
        for _ in track(range(TOUCHING), name):
            parts = [known[k] for k in generator.integers(len(known), size=2)]
            blob = _touching(parts, depth, generator)
            seen = observed_polygon(rendered(blob, SHARP, generator))
            start = time.process_time()
            answers.append(identify(seen, parts).answer)
            times.append(1000 * (time.process_time() - start))
        yield _answers_row(name, answers, times)
    yield ''


def _touching(
    parts: list[KnownPart], depth: float, generator: np.random.Generator
) -> shapely.Polygon:
    """Return two outlines that touch in a random direction, or overlap by a share of a length."""
    chosen = [part.outlines[generator.integers(len(part.outlines))] for part in parts]
    one, other = (
        affinity.rotate(each.polygon, generator.uniform(0, 360), origin='centroid')
        for each in chosen
    )
    angle = generator.uniform(0, 2 * np.pi)
    way = np.array([np.cos(angle), np.sin(angle)])
    low, high = 0.0, 1.0
    for _ in range(40):
        middle = (low + high) / 2
        if one.intersects(affinity.translate(other, *(middle * way))):
            low = middle
        else:
            high = middle
    apart = low - max(depth * min(each.length for each in chosen), 5e-5)
    return one.union(affinity.translate(other, *(apart * way)))


def _answers_row(name: str, answers: list[str], times: list[float]) -> str:
    counts = ' | '.join(str(answers.count(each)) for each in ('none', 'touching', 'part'))
    return (
        f'| {name} | {len(answers)} | {counts} '
        f'| {np.median(times):.1f}, {np.percentile(times, 99):.1f} |'
    )
