"""Benchmark of identification, beside Hu moments of OpenCV and iterative closest points."""

import time
from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
import shapely
from rich.progress import track
from scipy.spatial import KDTree
from shapely import affinity
from validation.dropper import ROOT, SEED
from validation.identification import GRAINY, PIXEL, SHARP, Camera, rendered

from bench.report import Section, Table
from resting_aspects_ros.api.identify import known_part
from resting_aspects_ros.arrays import Array
from resting_aspects_ros.part.library import PartLibrary
from resting_aspects_ros.vision.identification import identify, observed_polygon
from resting_aspects_ros.vision.outline import Outline, look_alikes
from resting_aspects_ros.vision.rolling import KnownPart

PARTS = ('angle_45x30x8', 'l_bracket')  # 5 classes each
IMAGES = 20  # of each class and camera
ITERATIONS, POINTS = 30, 240

# Index of the class, and yaw and place of its outline.
Found = tuple[int, float, Array]


def vision() -> Section:
    """Time the identification of rendered images with ten classes."""
    library = PartLibrary(ROOT / 'config' / 'parts')
    known = [known_part(library.load(name)) for name in PARTS]
    outlines = [outline for part in known for outline in part.outlines]
    baseline = Baseline(outlines)
    table = Table(
        ['way', 'camera', 'right', 'yaw, 99 % (deg)', 'position, 99 % (mm)', 'ms', 'ms, 99 %']
    )
    found: dict[str, dict[str, float]] = {}
    ways: dict[str, Callable[[shapely.Polygon], Found | None]] = {
        'identify_part': lambda seen: _identified(seen, known),
        'cv2.matchShapes, ICP': baseline.find,
    }
    for camera in (SHARP, GRAINY):
        images = _images(outlines, camera)
        for name, way in ways.items():
            row = _measured(way, images, outlines)
            short = camera.name.partition(':')[0]
            found[f'{name}, {short}'] = row
            table.rows.append([name, short, *(f'{value:.3g}' for value in row.values())])
    text = (
        f'{len(outlines)} classes of {" and ".join(PARTS)}, {IMAGES} images of each at 10 px/mm. '
        '*Right*: the share of images with the right class or a look-alike of it (same or '
        'mirrored). The other way is what one may write with OpenCV: the class by the Hu moments '
        'of the contour, the pose by iterative closest points from the principal axis, in both '
        'directions. Errors are those where the class is right, modulo symmetry. CPU time, '
        'without the rendering and the contour.'
    )
    return Section('Identification', text, [table], {'vision': found})


class Baseline:
    """Class by `cv2.matchShapes`, pose by iterative closest points."""

    def __init__(self, outlines: list[Outline]) -> None:
        self._outlines = outlines
        self._contours = [_contour(outline.polygon) for outline in outlines]
        self._points = [_points(outline.polygon) for outline in outlines]

    def find(self, seen: shapely.Polygon) -> Found:
        """Return the class, yaw and place of the most similar outline."""
        contour = _contour(seen)
        off = [cv2.matchShapes(contour, one, cv2.CONTOURS_MATCH_I1, 0) for one in self._contours]
        k = int(np.argmin(off))
        points = _points(seen)
        tree = KDTree(points)
        start = _axis(points) - _axis(self._points[k])
        ends = [_closest(self._points[k], points, tree, start + turn) for turn in (0.0, np.pi)]
        _, yaw, place = min(ends, key=lambda end: end[0])
        return k, yaw, place


def _identified(seen: shapely.Polygon, known: list[KnownPart]) -> Found | None:
    best = identify(seen, known).best
    if best is None:
        return None
    first = 0
    for part in known:
        if part.part.name == best.part:
            break
        first += len(part.outlines)
    return first + best.symmetry_class - 1, best.yaw, np.array([best.x, best.y])


def _images(
    outlines: list[Outline], camera: Camera
) -> list[tuple[int, float, Array, shapely.Polygon]]:
    generator = np.random.default_rng(SEED)
    found = []
    for k, outline in enumerate(track(outlines, 'images', transient=True)):
        for _ in range(IMAGES):
            yaw, place = generator.uniform(-np.pi, np.pi), generator.uniform(-0.1, 0.1, 2)
            turned = affinity.rotate(outline.polygon, yaw, origin=(0, 0), use_radians=True)
            seen = rendered(affinity.translate(turned, *place), camera, generator)
            found.append((k, yaw, place, observed_polygon(seen)))
    return found


def _measured(
    way: Callable[[shapely.Polygon], Found | None],
    images: list[tuple[int, float, Array, shapely.Polygon]],
    outlines: list[Outline],
) -> dict[str, float]:
    numbered = [replace(one, symmetry_class=k) for k, one in enumerate(outlines)]
    same = {
        k: {k, *(a.symmetry_class for a in alike if a.verdict != 'distinct')}
        for k, alike in look_alikes(numbered).items()
    }
    right, yaws, places, times = 0, [], [], []
    for k, yaw, place, seen in images:
        start = time.process_time()
        found = way(seen)
        times.append(1000 * (time.process_time() - start))
        right += found is not None and found[0] in same[k]
        if found is None or found[0] != k:
            continue
        order = max(outlines[k].yaw_symmetry, 1)
        yaws.append(abs(np.degrees(np.angle(np.exp(1j * order * (found[1] - yaw))) / order)))
        middle = [_turned(outlines[k].centroid, angle) for angle in (found[1], yaw)]
        places.append(1000 * np.linalg.norm(middle[0] + found[2] - middle[1] - place))
    return {
        'right': right / len(images),
        'yaw_deg': float(np.percentile(yaws, 99)),
        'position_mm': float(np.percentile(places, 99)),
        'median_ms': float(np.median(times)),
        'p99_ms': float(np.percentile(times, 99)),
    }


def _closest(model: Array, points: Array, tree: KDTree, yaw: float) -> tuple[float, float, Array]:
    """Return the mean square, yaw and place of a model after iterative closest points."""
    place = points.mean(axis=0) - _turned(model, yaw).mean(axis=0)
    for _ in range(ITERATIONS):
        moved = _turned(model, yaw) + place
        near = points[tree.query(moved)[1]]
        a, b = moved - moved.mean(axis=0), near - near.mean(axis=0)
        step = np.arctan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a * b).sum())
        yaw += float(step)
        place = near.mean(axis=0) - _turned(model, yaw).mean(axis=0)
    distance = np.asarray(tree.query(_turned(model, yaw) + place)[0])
    return float((distance**2).mean()), yaw, place


def _axis(points: Array) -> float:
    x, y = (points - points.mean(axis=0)).T
    return 0.5 * float(np.arctan2(2 * (x * y).mean(), (x * x - y * y).mean()))


def _turned(points: Array, yaw: float) -> Array:
    c, s = np.cos(yaw), np.sin(yaw)
    return np.asarray(points @ np.array([[c, s], [-s, c]]))


def _contour(polygon: shapely.Polygon) -> np.ndarray:
    return (shapely.get_coordinates(polygon.exterior)[:-1] / PIXEL).astype(np.float32)[:, None]


def _points(polygon: shapely.Polygon) -> Array:
    ring = polygon.exterior
    places = np.arange(POINTS) / POINTS * ring.length
    return np.asarray(shapely.get_coordinates(shapely.line_interpolate_point(ring, places)))
