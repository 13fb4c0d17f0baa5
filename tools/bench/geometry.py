"""Run time of the geometry: landscapes with many corners, and millions of poses."""

import time
from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
import trimesh
from rich.progress import track
from validation.document import paragraphs, table

from resting_aspects_ros.arrays import Array
from resting_aspects_ros.aspects.clusters import DEFAULT_TOLERANCE_DEGREES, cluster_directions
from resting_aspects_ros.aspects.find import find_aspects, join_minima
from resting_aspects_ros.aspects.landscape import Landscape
from resting_aspects_ros.part.loading import part_from_bytes
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.report.drop_page import PAGE, drop_page
from resting_aspects_ros.rotations import random_orientations
from resting_aspects_ros.statistics.distribution import no_drops

REPEATS = 3
POSES = 1_000_000
CORNERS = 2000
EGG = np.array([10.0, 8.0, 5.0])  # half axes, mm
BALL = 10.0
DIVISIONS = 8  # subdivisions of a box that is projected to an ellipsoid: 786,432 triangles


def geometry() -> Iterator[str]:
    """Time the geometry."""
    yield from paragraphs(
        '## Geometry', f'Times are the best of {REPEATS} runs, of a scan those of one.'
    )
    works = track(list(_works()), 'geometry', transient=True)
    rows = [(title, best(work)) for title, work in works]
    scan = _scan()
    times = [time.perf_counter()]
    part = part_from_bytes(scan, 'stl', 'scan')
    times.append(time.perf_counter())
    aspects = find_aspects(part)
    times.append(time.perf_counter())
    files = dict(drop_page(no_drops(aspects), part, 'scan', '').files())
    times.append(time.perf_counter())
    page = f'page of {len(files[PAGE]) / 1e6:.1f} MB, with figures, of'
    for step, seconds in zip(('load', 'aspects of', page), np.diff(times).tolist(), strict=True):
        rows.append((f'{step} a scan of {len(part.faces)} triangles', seconds))
    columns = ('task', 'seconds')
    yield from table(columns, ([title, f'{s:.2f}'] for title, s in rows), numbers=True)


def egg(corners: int, axes: Array = EGG) -> Part:
    """Return a part whose corners are random points on an ellipsoid, all of them on its hull."""
    directions = np.random.default_rng(1).standard_normal((corners, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return _part(trimesh.convex.convex_hull(directions * axes))


def _scan() -> bytes:
    """Return an ellipsoid with the noise of a scanner, as STL."""
    ball = trimesh.creation.box()
    for _ in range(DIVISIONS):
        ball = ball.subdivide()
    directions = ball.vertices / np.linalg.norm(ball.vertices, axis=1, keepdims=True)
    noise = 1 + 3e-4 * np.random.default_rng(1).standard_normal((len(directions), 1))
    mesh = trimesh.Trimesh(directions * noise * [30, 20, 10], ball.faces, process=False)
    data = mesh.export(file_type='stl')
    assert isinstance(data, bytes)
    return data


def _works() -> Iterator[tuple[str, Callable[[], object]]]:
    for name, part in (('egg', egg(CORNERS)), ('ball', egg(CORNERS, np.full(3, BALL)))):
        title = f'landscape of {name}, {len(part.hull_vertices)} corners'
        yield title, partial(_landscape, part)
    poses = random_orientations(np.random.default_rng(1), POSES)
    for name, mesh in (
        ('box', trimesh.creation.box((10, 20, 30))),
        ('cylinder of 256 sides', trimesh.creation.cylinder(10, 20, sections=256)),
        ('ball of 1280 sides', trimesh.creation.icosphere(3, radius=10)),
    ):
        yield (
            f'classify {POSES} poses of {name}',
            partial(find_aspects(_part(mesh)).classify, poses),
        )
    aspects = np.concatenate([np.eye(3), -np.eye(3)])
    resting = aspects[np.arange(POSES) % len(aspects)]
    resting = resting + 1e-4 * np.random.default_rng(1).standard_normal(resting.shape)
    tolerance = np.radians(DEFAULT_TOLERANCE_DEGREES)
    yield (
        f'cluster {POSES} poses without a part',
        partial(cluster_directions, resting, tolerance),
    )


def _landscape(part: Part) -> None:
    landscape = Landscape(part)
    join_minima(landscape)
    landscape.basin_shares.sum()


def best(work: Callable[[], object]) -> float:
    """Return the time of the fastest of REPEATS runs, s."""
    times = []
    for _ in range(REPEATS):
        started = time.perf_counter()
        work()
        times.append(time.perf_counter() - started)
    return min(times)


def _part(mesh: trimesh.Trimesh) -> Part:
    data = mesh.export(file_type='stl')
    assert isinstance(data, bytes)
    return part_from_bytes(data, 'stl', 'bench')
