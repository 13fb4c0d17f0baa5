"""Run time of drops and their preparation with the number of corners of the hull."""

import time

import numpy as np
from rich.progress import track

from bench.case import job_of
from bench.geometry import EGG, egg
from bench.report import Section, Table
from resting_aspects_ros.simulation.kernel_data import Numerics
from resting_aspects_ros.simulation.kernel_engine import body_of, ground_of, simulate
from resting_aspects_ros.simulation.release import TIME_LIMIT, initial_states
from resting_aspects_ros.statistics.poses import RestStatus

CORNERS = (8, 20, 50, 100, 200, 500, 1000, 2000, 3000)
DROPS = 2000


def hulls() -> Section:
    """Measure both, in one thread."""
    table = Table(
        [
            'corners',
            'landscape (ms)',
            'kernel (ms)',
            'µs per drop',
            'steps',
            'µs per step',
            'at rest',
        ]
    )
    found: dict[str, dict[str, float]] = {}
    for corners in track(CORNERS, 'corners', transient=True):
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
        each = {
            'landscape_ms': 1e3 * (planned - started),
            'kernel_ms': 1e3 * (prepared - planned),
            'us_per_drop': spent / DROPS,
            'steps_per_drop': counts[0] / DROPS,
            'us_per_step': spent / counts[0],
        }
        found[str(corners)] = each
        settled = (codes[:, 0] == RestStatus.SETTLED).mean()
        table.rows.append(
            [
                f'{len(part.hull_vertices)}',
                *(f'{value:.1f}' for value in list(each.values())[:-1]),
                f'{each["us_per_step"]:.3f}',
                f'{100 * settled:.1f} %',
            ]
        )
    text = (
        'Hulls of random points on an ellipsoid with half axes '
        f'{":".join(f"{a:g}" for a in EGG)} mm on `rubber_mat`, {DROPS} drops of each in one '
        'thread. A hull with more corners is rounder and rolls longer. *Landscape*: computation '
        'of the landscape and the rest rule, once per part. *Kernel*: preparation of the part for '
        'the kernel after that; the aim is 50 ms for 1000 corners. *Steps*: of flight, impact and '
        'lasting contact, per drop.'
    )
    return Section('Scaling', text, [table], {'corners': found})
