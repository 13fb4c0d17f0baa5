"""What a drop in surroundings costs in each engine, beside a plain PyBullet loop and MuJoCo."""

import dataclasses
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import trimesh
from rich.progress import track
from validation.dropper import SEED
from validation.mujoco_drops import mujoco_loop
from validation.trial import Trial

import resting_aspects_ros as ra
from bench.case import COST_DROPS, cost, example_part
from bench.plain import plain_loop
from bench.report import Section, Table
from resting_aspects_ros.api.conditions import shipped_surfaces, with_surroundings
from resting_aspects_ros.simulation.job import BULLET, KERNEL, DropJob, make_job
from resting_aspects_ros.simulation.surroundings import Surroundings

# Drops of each other engine.
OTHER_DROPS = 125
# Squares along each side of the mesh, of two triangles each, its side, m, and the height of its
# corners above its middle, m.
SQUARES, SIDE, RISE = 50, 0.3, 0.02
AT_REST = 'l_chute, belt at rest'


def surroundings() -> Section:
    """Time drops of the example part on the plane and in surroundings, in one thread."""
    columns = ['simulated in', 'at rest', 'time (T)', 'kernel (ms)', 'Bullet (ms)']
    table = Table([*columns, 'of a drop on the plane'])
    found: dict[str, dict[str, float]] = {}
    jobs = _jobs()
    for name, job in track(list(jobs.items()), 'surroundings', transient=True):
        bullet = cost(dataclasses.replace(job, engine=BULLET))
        first = cost(job) if job.engine == KERNEL else bullet
        found[name] = {BULLET: bullet.milliseconds, job.engine: first.milliseconds}
        table.rows.append(
            [
                name,
                f'{100 * first.settled:.1f} %',
                f'{first.simulated:.1f}',
                f'{first.milliseconds:.3f}' if job.engine == KERNEL else '-',
                f'{bullet.milliseconds:.2f}',
                f'{first.milliseconds / found["plane"][job.engine]:.1f}',
            ]
        )
    at_rest = dataclasses.replace(jobs[AT_REST], engine=BULLET)
    others = {'plain_loop': _milliseconds(partial(plain_loop, at_rest))}
    text = f'in a plain PyBullet loop {others["plain_loop"]:.1f} ms'
    try:
        others['mujoco'] = _milliseconds(partial(mujoco_loop, 1, at_rest))
        text += f', in MuJoCo {others["mujoco"]:.1f} ms'
    except ImportError as error:
        text += f'; MuJoCo was skipped ({error})'
    found[AT_REST] |= others
    return Section('Surroundings', _text(text), [table], {'surroundings': found})


def _text(others: str) -> str:
    return (
        f'Processor time of one thread for a drop of {example_part().name} on `rubber_mat`: the '
        f'mean of {COST_DROPS[KERNEL]} in the kernel and {COST_DROPS[BULLET]} in Bullet. The mesh '
        f'is a square bowl of {2 * SQUARES**2} triangles, {1000 * SIDE:g} mm wide and '
        f'{1000 * RISE:g} mm deep, which only Bullet simulates. *Time*: simulated until the part '
        'is at rest. *Of a drop on the plane*: the ratio of the costs in the same engine, the '
        'kernel where it can simulate both. With the same start, time step and rule of rest as in '
        f'the first table, a drop in the chute with its belt at rest takes {others}.'
    )


def _milliseconds(work: Callable[[int, int], Trial]) -> float:
    """Return the processor time of a drop."""
    started = time.process_time()
    work(0, OTHER_DROPS)
    return 1000 * (time.process_time() - started) / OTHER_DROPS


def _jobs() -> dict[str, DropJob]:
    part, rubber = example_part(), shipped_surfaces().get()
    with tempfile.TemporaryDirectory() as folder:
        mesh = ra.surroundings('mesh', mesh=_bowl(Path(folder)))
    kinds: dict[str, Surroundings | None] = {
        'plane': None,
        'slope': ra.surroundings('slope'),
        'v_groove': ra.surroundings('v_groove'),
        AT_REST: ra.surroundings('l_chute', belt={'speed': 0.0}),
        'l_chute': ra.surroundings('l_chute'),
        'mesh of 5,000 triangles': mesh,
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
