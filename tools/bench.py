"""Time what has to be fast, side by side in one run; prints a table and writes out/bench.json."""

import json
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import trimesh
from rich.console import Console
from rich.table import Table

from resting_aspects_ros.core.aspects import find_aspects
from resting_aspects_ros.core.clusters import DEFAULT_TOLERANCE_DEGREES, cluster_directions
from resting_aspects_ros.core.joining import join_minima
from resting_aspects_ros.core.landscape import Landscape
from resting_aspects_ros.core.part import Part, part_from_bytes
from resting_aspects_ros.core.rotations import down_in_part, random_orientations

RESULT = Path('out/bench.json')
REPEATS = 3
POSES = 1_000_000
DIVISIONS = 8  # of a ball: 1.3 million triangles
CORNERS = 2000


def main() -> None:
    """Run all of it."""
    found: dict[str, dict[str, float]] = {'landscape': {}, 'classify': {}}
    table = Table('what', 'seconds', title='best of three')
    egg = _solid(_ellipsoid(CORNERS) * [10, 8, 5])
    ball = _solid(_ellipsoid(CORNERS) * 10)
    for name, part in (('egg', egg), ('ball', ball)):
        seconds = _best(partial(_landscape, part))
        found['landscape'][f'{name}_{len(part.hull_vertices)}_corners_s'] = seconds
        table.add_row(f'landscape of {name}, {len(part.hull_vertices)} corners', f'{seconds:.2f}')
    poses = random_orientations(np.random.default_rng(1), POSES)
    for name, mesh in (
        ('box', trimesh.creation.box((10, 20, 30))),
        ('cylinder of 256 sides', trimesh.creation.cylinder(10, 20, sections=256)),
        ('ball of 1280 sides', trimesh.creation.icosphere(3, radius=10)),
    ):
        aspects = find_aspects(_part(mesh))
        seconds = _best(partial(aspects.classify, poses))
        found['classify'][f'{name.replace(" ", "_")}_s'] = seconds
        table.add_row(f'classify {POSES} poses of {name}', f'{seconds:.2f}')
    down = down_in_part(poses)
    seconds = _best(lambda: cluster_directions(down, np.radians(DEFAULT_TOLERANCE_DEGREES)))
    found['classify']['clusters_without_a_part_s'] = seconds
    table.add_row(f'cluster {POSES} poses without a part', f'{seconds:.2f}')
    scan = _scan().export(file_type='stl')
    assert isinstance(scan, bytes)
    begun = time.perf_counter()
    part = part_from_bytes(scan, 'stl', 'scan')
    loaded = time.perf_counter()
    find_aspects(part)
    found['scan'] = {'load_s': loaded - begun, 'aspects_s': time.perf_counter() - loaded}
    what = f'a scan of {len(part.faces)} triangles, once:'
    table.add_row(f'{what} load', f'{found["scan"]["load_s"]:.2f}')
    table.add_row(f'{what} aspects', f'{found["scan"]["aspects_s"]:.2f}')
    Console().print(table)
    RESULT.parent.mkdir(parents=True, exist_ok=True)
    RESULT.write_text(json.dumps(found, indent=2) + '\n', encoding='utf-8')
    print(f'Written: {RESULT}')


def _landscape(part: Part) -> None:
    landscape = Landscape(part)
    join_minima(landscape)
    landscape.basin_shares.sum()


def _best(work: Callable[[], object]) -> float:
    times = []
    for _ in range(REPEATS):
        begun = time.perf_counter()
        work()
        times.append(time.perf_counter() - begun)
    return min(times)


def _ellipsoid(corners: int) -> np.ndarray:
    directions = np.random.default_rng(1).standard_normal((corners, 3))
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)


def _scan() -> trimesh.Trimesh:
    """An ellipsoid with the noise of a scanner."""
    ball = trimesh.creation.icosphere(DIVISIONS)
    noise = 1 + 3e-4 * np.random.default_rng(1).standard_normal((len(ball.vertices), 1))
    return trimesh.Trimesh(ball.vertices * noise * [30, 20, 10], ball.faces, process=False)


def _solid(points: np.ndarray) -> Part:
    return _part(trimesh.convex.convex_hull(points))


def _part(mesh: trimesh.Trimesh) -> Part:
    data = mesh.export(file_type='stl')
    assert isinstance(data, bytes)
    return part_from_bytes(data, 'stl', 'bench')


if __name__ == '__main__':
    main()
