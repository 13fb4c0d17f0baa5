"""Validation of identification: rendered images, reliability, refusal, and poses of drops.

`python -m validation.identification` prints the section; takes about 20 minutes on one core.
"""

import dataclasses
import sys
import time
from collections.abc import Iterator
from itertools import pairwise

import contourpy
import numpy as np
import numpy.typing as npt
import shapely
from PIL import Image, ImageDraw
from rich.progress import track
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import Rotation
from shapely import affinity
from shapely.geometry.polygon import orient

import resting_aspects_ros as ra
from resting_aspects_ros.api.identify import known_part
from resting_aspects_ros.part.library import PartLibrary
from resting_aspects_ros.statistics.poses import RestStatus
from resting_aspects_ros.vision.fitting import OutlineNoise, shape_of
from resting_aspects_ros.vision.identification import Identification, identify, observed_polygon
from resting_aspects_ros.vision.location import Pose, camera_pose
from resting_aspects_ros.vision.outline import Outline, _yaw_symmetry, look_alikes, seen_outline
from resting_aspects_ros.vision.rolling import KnownPart
from validation.dropper import ROOT, SEED

Array = npt.NDArray[np.float64]

PIXEL, FINE = 1e-4, 8  # m; number of subpixels along each side
DROPS = 1000
IMAGES = 60  # of each class
PAIRS = 3000
TOUCHING = 150
EDGES = (0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99, 1.0)


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
    yield from _drops(known)
    yield from _images(known)
    yield from _reliability(known)
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


def rotation_error(known: KnownPart, one: Array, other: Array) -> float:
    """Return the angle between two orientations xyzw modulo symmetry of the part, degrees."""
    symmetry = known.aspects.symmetry
    assert symmetry is not None
    a, b = (Rotation.from_quat(q).as_matrix() for q in (one, other))
    if symmetry.axis is not None:
        cosines = symmetry.rotations @ symmetry.axis @ (a @ symmetry.axis @ b)
        return float(np.degrees(np.arccos(np.clip(cosines.max(), -1, 1))))
    traces = np.einsum('kij,ij->k', symmetry.rotations, a.T @ b)
    return float(np.degrees(np.arccos(np.clip((traces.max() - 1) / 2, -1, 1))))


def _centre(known: KnownPart, position: Array, orientation: Array) -> Array:
    turn = Rotation.from_quat(orientation).as_matrix()
    return np.asarray(position + turn @ known.part.centre_of_mass)


def _pose_errors(
    known: KnownPart, found: Identification, pose: Pose
) -> tuple[float, float, bool, bool]:
    """Return rotation (degrees) and x, y (mm) errors of the nearest pose, and where it is.

    The flags say whether it is a pose of the first candidate, and its very first pose.
    """
    centre = _centre(known, pose.position, pose.orientation)
    rows = []
    for rank, candidate in enumerate(found.candidates):
        for place, each in enumerate(candidate.poses):
            there = _centre(known, each.position, each.orientation)
            turn = rotation_error(known, pose.orientation, each.orientation)
            apart = 1000 * float(np.linalg.norm((there - centre)[:2]))
            rows.append((turn + 10 * apart, turn, apart, rank == 0, place == 0))
    return min(rows)[1:]


def _drops(known: list[KnownPart]) -> Iterator[str]:
    yield '### Poses of drops'
    yield ''
    yield (
        f'{DROPS} drops of each part on `rubber_mat`. The silhouette of each settled part is '
        'identified with the outlines of the part, and located. *Among*: the true pose is among '
        'those of the candidates, within 0.5 degrees (modulo symmetry and roll) and 0.1 mm. '
        '*First*: it is one of the first candidate, of the drops whose class has no look-alike. '
        '*Inverse*: the camera pose of the true pose gives that pose. *Time*: CPU time of an '
        'identification, median and 99th percentile.'
    )
    yield ''
    yield (
        '| part | classes | settled | among | without look-alike | first | inverse | rotation, '
        'max (deg) | x, y, max (mm) | time (ms) |'
    )
    yield '|---|---|---|---|---|---|---|---|---|---|'
    for each in track(known, 'drops'):
        yield _drops_row(each)
    yield ''


def _drops_row(known: KnownPart) -> str:
    part = known.part
    poses = ra.drop(part, drops=DROPS, seed=SEED).poses
    ids = known.aspects.classify(np.nan_to_num(poses.orientation))
    alike = look_alikes(known.outlines)
    alone = {k for k, each in alike.items() if all(a.verdict == 'distinct' for a in each)}
    settled = np.flatnonzero((poses.status == RestStatus.SETTLED) & (ids > 0))
    among = first = distinct = inverse = 0
    worst, times = np.zeros(2), []
    for k in settled:
        pose = Pose(int(ids[k]), poses.position[k], poses.orientation[k])
        x, y, _ = _centre(known, pose.position, pose.orientation)
        seen = affinity.translate(seen_outline(part, pose.orientation), x, y)
        start = time.process_time()
        found = identify(observed_polygon(seen), [known])
        times.append(1000 * (time.process_time() - start))
        turn, apart, is_first, _ = _pose_errors(known, found, pose)
        good = turn < 0.5 and apart < 0.1
        among += good
        if known.aspects.aspects[pose.aspect - 1].symmetry_class in alone:
            distinct += 1
            first += good and is_first
        worst = np.maximum(worst, (turn, apart))
        back = camera_pose(known.placements, pose.position, pose.orientation)
        again = known.placements[back.symmetry_class - 1].poses(back.x, back.y, back.yaw)
        inverse += min(rotation_error(known, pose.orientation, a.orientation) for a in again) < 0.5
    return (
        f'| {part.name} | {len(known.outlines)} | {len(settled)} | {among} | {distinct} | {first} '
        f'| {inverse} | {worst[0]:.3f} | {worst[1]:.4f} '
        f'| {np.median(times):.1f}, {np.percentile(times, 99):.1f} |'
    )


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


def _reliability(known: list[KnownPart]) -> Iterator[str]:
    yield '### Reliability of the posterior'
    yield ''
    yield (
        f'{PAIRS} images with two candidates that differ slightly: an outline and its copy, '
        'larger all around or stretched along an axis, by an amount at which the mean difference '
        'of the log likelihoods is between 0 and 6. The first is shown with its prior share, '
        'which is uniform between 0.2 and 0.8. *Share*: of the images whose most probable '
        'candidate has a posterior in the range, those where it is right, with its standard '
        'error.'
    )
    yield ''
    yield ('| posterior | ' + ' | '.join(f'{a:g} to {b:g}' for a, b in pairwise(EDGES)) + ' |')
    yield '|---|' + '---|' * (len(EDGES) - 1)
    default = OutlineNoise()
    cases = [
        (GRAINY, default, 'grainy, noise 0.1 mm, 1 mm (default)'),
        (COARSE, OutlineNoise(2e-4, 1e-3), 'coarse, noise 0.2 mm, 1 mm'),
        (SHARP, default, 'sharp, noise 0.1 mm, 1 mm (default)'),
    ]
    for camera, noise, name in cases:
        yield from _reliability_rows(known, camera, noise, name)
    yield ''


def _reliability_rows(
    known: list[KnownPart], camera: Camera, noise: OutlineNoise, name: str
) -> Iterator[str]:
    generator = np.random.default_rng(SEED)
    rows = []
    for _ in track(range(PAIRS), name.partition(',')[0]):
        part = known[generator.integers(len(known))]
        outline = part.outlines[generator.integers(len(part.outlines))]
        count = outline.polygon.length / noise.correlation
        wanted = generator.uniform(0, 6)
        first = dataclasses.replace(outline, symmetry_class=1, family=())
        other = _variant(first, noise.sd * np.sqrt(2 * wanted / count), generator)
        share = generator.uniform(0.2, 0.8)
        pair = dataclasses.replace(
            part, outlines=(first, other), shares=np.array([share, 1 - share])
        )
        shown = int(generator.uniform() > share)
        polygon, _ = _placed(pair.outlines[shown], generator)
        found = identify(observed_polygon(rendered(polygon, camera, generator)), [pair], noise)
        best = found.candidates[0]
        if found.answer == 'part':
            rows.append((best.posterior, best.symmetry_class == shown + 1))
    posterior, right = np.array(rows, dtype=np.float64).T
    place = np.digitize(posterior, EDGES[1:-1])
    cells, means = [], []
    for k in range(len(EDGES) - 1):
        here = right[place == k]
        if not len(here):
            cells.append('-')
            means.append('-')
            continue
        error = np.sqrt(max(here.mean() * (1 - here.mean()), 1e-4) / len(here))
        cells.append(f'{here.mean():.3f} ± {error:.3f} ({len(here)})')
        means.append(f'{posterior[place == k].mean():.3f}')
    yield f'| {name}: share right (n) | ' + ' | '.join(cells) + ' |'
    yield '| mean posterior | ' + ' | '.join(means) + ' |'


def _variant(outline: Outline, rms: float, generator: np.random.Generator) -> Outline:
    """Return a copy of an outline as class 2, whose boundary differs by about ``rms``, m."""
    # A round outline that is hardly stretched has no defined symmetry.
    grown = generator.uniform() < 0.5 or outline.yaw_symmetry == 0
    if grown:
        polygon = orient(outline.polygon.buffer(rms, join_style='mitre'))
    else:
        # The boundary moves by x (factor - 1) n_x; the root mean square is that of x n_x.
        points = shapely.get_coordinates(outline.polygon.exterior.segmentize(outline.length / 50))
        middle = (points[1:] + points[:-1]) / 2 - np.asarray(outline.centroid)
        along = np.diff(points, axis=0)
        length = np.linalg.norm(along, axis=1)
        moved = middle[:, 0] * along[:, 1] / length
        moved -= (
            (moved * along[:, 1]).sum() / (along[:, 1] ** 2 / length).sum() * along[:, 1] / length
        )
        size = np.sqrt((moved**2 * length).sum() / length.sum())
        polygon = affinity.scale(outline.polygon, 1 + rms / size, 1.0)
    order = outline.yaw_symmetry if grown else _yaw_symmetry(shape_of(polygon).boundary)
    return dataclasses.replace(
        outline, polygon=polygon, symmetry_class=2, yaw_symmetry=order, family=()
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


if __name__ == '__main__':
    for line in identification():
        sys.stdout.write(f'{line}\n')
        sys.stdout.flush()
