"""Scaling of the run time with the number of hull vertices and the number of drops."""

import time

from bench_case import example_job, example_part, job_of
from bench_geometry import EGG, egg
from bench_report import Section, Table
from bench_suite import simulated
from rich.progress import track

from resting_aspects_ros.core.aspects.aspect import find_aspects
from resting_aspects_ros.core.poses import RestingPoses, RestStatus
from resting_aspects_ros.core.statistics.distribution import count_poses, no_drops
from resting_aspects_ros.simulation.chunks import submit_drops
from resting_aspects_ros.simulation.initial_state import CHUNK
from resting_aspects_ros.simulation.local_workers import LocalWorkers

CORNERS = (8, 20, 50, 100, 200, 500, 1000, 2000)
EGG_CHUNKS = 2  # per worker
NUMBERS = (100, 1000, 10_000, 100_000, 1_000_000)
# A time that would exceed this, s, is extrapolated from the last SLICE drops.
MAX_TIME = 60.0
SLICE = 10_000


def scaling(workers: LocalWorkers) -> Section:
    """Measure both, with running workers."""
    by_corners, eggs = _corners(workers)
    by_number, numbers = _numbers(workers)
    text = (
        f'{workers.count} running workers. The first table has hulls of random points on an '
        f'ellipsoid with half axes {":".join(f"{a:g}" for a in EGG)} mm, on `rubber_mat`, with '
        f'{EGG_CHUNKS * workers.count * CHUNK} drops of each. A hull with more corners is rounder '
        'and rolls longer. *µs per step* is the time of one step of one body, on all cores '
        'together. *Prepare*: computation of the landscape and the rest rule, once per part. The '
        'second table has drops of the example part that are simulated, classified and counted, '
        f'but not stored. A time of more than {MAX_TIME:g} s is extrapolated from its last '
        f'{SLICE} drops, and marked.'
    )
    return Section('Scaling', text, [by_corners, by_number], {'corners': eggs, 'numbers': numbers})


def _corners(workers: LocalWorkers) -> tuple[Table, dict[str, dict[str, float]]]:
    table = Table(
        ['corners', 'aspects', 'prepare (s)', 'drops/s', 'T simulated', 'µs per step', 'unsettled']
    )
    found = {}
    for corners in track(CORNERS, 'corners', transient=True):
        part = egg(corners)
        started = time.perf_counter()
        job = job_of(part)
        prepared = time.perf_counter() - started
        drops = EGG_CHUNKS * workers.count * CHUNK
        started = time.perf_counter()
        futures = submit_drops(job, 0, drops, workers)
        poses = RestingPoses.join([future.result() for future in futures])
        seconds = time.perf_counter() - started
        mean = float(simulated(job, poses).mean())
        step = 1e6 * seconds / (mean * drops * job.steps_per_t)
        unsettled = (poses.status == RestStatus.UNSETTLED).mean()
        found[str(corners)] = {
            'prepare_s': prepared,
            'drops_per_s': drops / seconds,
            'us_per_step': step,
        }
        table.rows.append(
            [
                f'{len(part.hull_vertices)}',
                f'{len(find_aspects(part))}',
                f'{prepared:.3f}',
                f'{drops / seconds:.0f}',
                f'{mean:.1f}',
                f'{step:.2f}',
                f'{100 * unsettled:.1f} %',
            ]
        )
    return table, found


def _numbers(workers: LocalWorkers) -> tuple[Table, dict[str, dict[str, object]]]:
    aspects, job = find_aspects(example_part()), example_job()
    table = Table(['drops', 'seconds', 'drops/s', ''])
    found: dict[str, dict[str, object]] = {}
    seconds, before = 0.0, 1
    for drops in track(NUMBERS, 'numbers', transient=True):
        measured = seconds * drops / before < MAX_TIME
        made = drops if measured else SLICE
        distribution = no_drops(aspects)
        started = time.perf_counter()
        for future in submit_drops(job, drops - made, made, workers):
            distribution += count_poses(aspects, future.result())
        seconds, before = (time.perf_counter() - started) * drops / made, drops
        note = '' if measured else f'extrapolated from {made}'
        table.rows.append([f'{drops}', f'{seconds:.2f}', f'{drops / seconds:.0f}', note])
        found[str(drops)] = {'seconds': seconds, 'measured_drops': distribution.drops}
    return table, found
