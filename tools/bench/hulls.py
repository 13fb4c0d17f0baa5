"""Run time of drops and their preparation with the number of corners of the hull."""

import time
from collections.abc import Iterator

import numpy as np
from rich.progress import track
from validation.document import table

from bench.case import job_of
from bench.geometry import EGG, egg
from resting_aspects_ros.simulation.kernel_data import Numerics
from resting_aspects_ros.simulation.kernel_engine import body_of, ground_of, simulate
from resting_aspects_ros.simulation.release import TIME_LIMIT, initial_states
from resting_aspects_ros.statistics.poses import RestStatus

CORNERS = (8, 20, 50, 100, 200, 500, 1000, 2000, 3000)
DROPS = 2000
COLUMNS = (
    'corners',
    'landscape (ms)',
    'kernel (ms)',
    'µs per drop',
    'steps',
    'µs per step',
    'at rest',
)


def hulls() -> Iterator[str]:
    """Measure both, in one thread."""
    yield '## Scaling'
    yield ''
    yield (
        'Hulls of random points on an ellipsoid with half axes '
        f'{":".join(f"{a:g}" for a in EGG)} mm on `rubber_mat`, {DROPS} drops of each in one '
        'thread. A hull with more corners is rounder and rolls longer. *Landscape*: computation '
        'of the landscape and the rest rule, once per part. *Kernel*: preparation of the part for '
        'the kernel after that; the aim is 50 ms for 1000 corners. *Steps*: of flight, impact and '
        'lasting contact, per drop.'
    )
    yield ''
    yield from table(COLUMNS, map(_row, track(CORNERS, 'corners', transient=True)), numbers=True)


def _row(corners: int) -> list[str]:
    part = egg(corners)
    started = time.perf_counter()
    job = job_of(part)
    planned = time.perf_counter()
    body = body_of(job)
    prepared = time.perf_counter()
    states = initial_states(job, 0, DROPS)
    ends, codes = np.empty((DROPS, 15)), np.empty((DROPS, 2), dtype=np.int64)
    at = states.position, states.velocity, states.spin, states.orientation
    start = time.process_time()
    counts = simulate(body, ground_of(job), Numerics(), TIME_LIMIT, at, ends, codes)
    spent = 1e6 * (time.process_time() - start)
    return [
        f'{len(part.hull_vertices)}',
        f'{1e3 * (planned - started):.1f}',
        f'{1e3 * (prepared - planned):.1f}',
        f'{spent / DROPS:.1f}',
        f'{counts[0] / DROPS:.1f}',
        f'{spent / counts[0]:.3f}',
        f'{100 * (codes[:, 0] == RestStatus.SETTLED).mean():.1f} %',
    ]
