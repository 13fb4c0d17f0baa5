"""What a drop on the plane, an action, or a drop in surroundings costs in each engine."""

import dataclasses
import tempfile
import time
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
import trimesh
from rich.progress import track
from validation.document import table
from validation.dropper import SEED

import resting_aspects_ros as ra
from bench.case import EXAMPLE, example_part
from resting_aspects_ros.api.conditions import (
    shipped_actions,
    shipped_surfaces,
    with_surroundings,
)
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.part.part import Part
from resting_aspects_ros.simulation.conditions import BULLET, KERNEL
from resting_aspects_ros.simulation.job import DropJob, make_job
from resting_aspects_ros.simulation.starts import rest_starts
from resting_aspects_ros.simulation.surroundings import Surroundings
from resting_aspects_ros.simulation.workers import drop_range
from resting_aspects_ros.statistics.poses import RestStatus

PARTS = ('l_bracket', 'box_10x20x30')
# Drops of which the processor time of one is the mean.
DROPS = {KERNEL: 4000, BULLET: 250}
# Squares along each side of the mesh, of two triangles each, its side, m, and the height of its
# corners above its middle, m.
SQUARES, SIDE, RISE = 50, 0.3, 0.02
COLUMNS = ('simulated', 'at rest', 'time (T)', 'kernel (ms)', 'Bullet (ms)', 'of a drop')
TEXT = (
    f'The mean processor time of one thread of {DROPS[KERNEL]} in the kernel and {DROPS[BULLET]} '
    'in Bullet. *Time*: simulated until the rest is decided. *Of a drop*: a multiple of the cost '
    'of a drop on `rubber_mat` in the same engine, the kernel where it can simulate both.'
)


def actions() -> Iterator[str]:
    """Time drops on two surfaces and each named action."""
    yield '## Actions'
    yield ''
    yield (
        'A drop on the named surface, or an action on `rubber_mat`. Parts that fall from an edge '
        f'are simulated only in Bullet. {TEXT}'
    )
    yield ''
    for name in PARTS:
        yield f'{name}:'
        yield ''
        yield from table(COLUMNS, _rows(_jobs_of_actions(example_part(name))), numbers=True)


def surroundings() -> Iterator[str]:
    """Time drops of the example part on the plane and in surroundings."""
    yield '## Surroundings'
    yield ''
    yield (
        f'A drop of {EXAMPLE} on `rubber_mat`. The mesh is a square bowl of {2 * SQUARES**2} '
        f'triangles, {1000 * SIDE:g} mm wide and {1000 * RISE:g} mm deep, which only Bullet '
        f'simulates. {TEXT}'
    )
    yield ''
    yield from table(COLUMNS, _rows(_jobs_of_surroundings()), numbers=True)


def _rows(jobs: Mapping[str, DropJob]) -> Iterator[list[str]]:
    """Yield a row for each job; the first one is the drop on `rubber_mat`."""
    drop: dict[str, float] = {}
    for name, job in track(list(jobs.items()), 'costs', transient=True):
        milliseconds: dict[str, float] = {}
        for engine in dict.fromkeys((BULLET, job.engine)):
            drops = DROPS[engine]
            each = dataclasses.replace(job, engine=engine)
            drop_range(each, 0, 1)
            started = time.process_time()
            poses = drop_range(each, 0, drops)
            milliseconds[engine] = 1000 * (time.process_time() - started) / drops
        drop = drop or milliseconds
        yield [
            name,
            f'{100 * (poses.status == RestStatus.SETTLED).mean():.1f} %',
            f'{np.nanmean(poses.time_to_rest) / job.time_unit:.1f}',
            f'{milliseconds[KERNEL]:.3f}' if KERNEL in milliseconds else '-',
            f'{milliseconds[BULLET]:.2f}',
            f'{milliseconds[job.engine] / drop[job.engine]:.1f}',
        ]


def _jobs_of_actions(part: Part) -> dict[str, DropJob]:
    surfaces, named = shipped_surfaces(), shipped_actions()
    conditions, aspects = surfaces.get(), find_aspects(part).aspects
    jobs = {f'drop, {s}': make_job(part, surfaces.get(s), SEED) for s in ('rubber_mat', 'thrown')}
    for name in named.names():
        starts = rest_starts(part, aspects, named.get(name).action, conditions)
        jobs[name] = make_job(part, conditions, SEED, starts=starts)
    return jobs


def _jobs_of_surroundings() -> dict[str, DropJob]:
    part, rubber = example_part(), shipped_surfaces().get()
    with tempfile.TemporaryDirectory() as folder:
        mesh = ra.surroundings('mesh', mesh=_bowl(Path(folder)))
    kinds: dict[str, Surroundings | None] = {
        'plane': None,
        'slope': ra.surroundings('slope'),
        'v_groove': ra.surroundings('v_groove'),
        'l_chute, belt at rest': ra.surroundings('l_chute', belt={'speed': 0.0}),
        'l_chute': ra.surroundings('l_chute'),
        f'mesh of {2 * SQUARES**2} triangles': mesh,
    }
    return {
        name: make_job(part, with_surroundings(rubber, kind), SEED) for name, kind in kinds.items()
    }


def _bowl(folder: Path) -> str:
    """Write a bowl in mm; returns its path."""
    ticks = np.linspace(-SIDE / 2, SIDE / 2, SQUARES + 1) * 1000
    x, y = (values.ravel() for values in np.meshgrid(ticks, ticks, indexing='ij'))
    z = 1000 * RISE * (x**2 + y**2) / (2 * (500 * SIDE) ** 2)
    n = SQUARES + 1
    first = (np.arange(SQUARES)[:, None] * n + np.arange(SQUARES)).ravel()
    corners = np.stack([first, first + n, first + n + 1, first + 1], axis=1)
    triangles = np.vstack([corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]])
    path = folder / 'bowl.stl'
    trimesh.Trimesh(np.stack([x, y, z], axis=1), triangles, process=False).export(path)
    return str(path)
