"""What a drop in surroundings costs, beside the plane, a plain PyBullet loop and MuJoCo."""

import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
import trimesh
from bench_case import example_part, steps_in
from bench_engines import MUJOCO_MOTION, MujocoBody
from bench_plain import PlainBody, plain_body
from bench_report import Section, Table
from dropper import ROOT, SEED
from rich.progress import track

import resting_aspects_ros as ra
from resting_aspects_ros.api.surroundings import with_surroundings
from resting_aspects_ros.core.poses import RestStatus
from resting_aspects_ros.simulation.bullet_scene import RESIDUAL
from resting_aspects_ros.simulation.drop_job import DropJob
from resting_aspects_ros.simulation.engine import drop_range
from resting_aspects_ros.simulation.initial_state import CHUNK, initial_states
from resting_aspects_ros.simulation.plan import make_job
from resting_aspects_ros.simulation.settling import (
    CHECK_INTERVAL,
    REST_MOTION,
    TIME_LIMIT,
)
from resting_aspects_ros.simulation.surfaces import Surfaces
from resting_aspects_ros.simulation.surroundings.description import Surroundings
from resting_aspects_ros.simulation.surroundings.scene_settling import WINDOW

CHUNKS = 4
# Drops of each other engine, which simulates one body after another.
OTHER_DROPS = 125
# Squares along each side of the mesh, of two triangles each, its side, m, and the height of its
# corners above its middle, m.
SQUARES, SIDE, RISE = 50, 0.3, 0.02
AIMS = {'l_chute': 4, 'mesh of 5,000 triangles': 10}


class Cost(NamedTuple):
    """Drops, how many of them came to rest, simulated time, T, and processor time, ms, of each."""

    drops: int
    settled: int
    simulated: float
    milliseconds: float


def surroundings() -> Section:
    """Time drops of the example part on the plane and in surroundings, in one process."""
    jobs = _jobs()
    rows: dict[str, Cost] = {}
    for name, job in track(list(jobs.items()), 'surroundings', transient=True):
        rows[f'suite, {name}'] = _suite(job)
    at_rest = jobs['l_chute, belt at rest']
    rows['plain loop, l_chute, belt at rest'] = _plain(at_rest)
    notes = ''
    try:
        rows['MuJoCo, l_chute, belt at rest'] = _mujoco(at_rest)
    except ImportError as error:
        notes = f' MuJoCo was skipped ({error}).'
    plane = rows['suite, plane'].milliseconds
    columns = ['simulated', 'drops', 'at rest', 'T', 'ms', 'ms per T', 'of a drop on the plane']
    table = Table([*columns, 'aim'])
    for what, cost in rows.items():
        ratio = f'{cost.milliseconds / plane:.1f}'
        aim = str(AIMS.get(what.removeprefix('suite, '), ''))
        counts = [str(cost.drops), str(cost.settled)]
        each = cost.milliseconds / cost.simulated
        times = [f'{cost.simulated:.1f}', f'{cost.milliseconds:.2f}', f'{each:.2f}']
        table.rows.append([what, *counts, *times, ratio, aim])
    text = (
        f'Processor time of one process for each drop of {example_part().name} on `rubber_mat`, '
        'one after the other in the same run. The mesh is a square bowl '
        f'of {2 * SQUARES**2} triangles, {1000 * SIDE:g} mm wide and {1000 * RISE:g} mm deep. *T* '
        'is the mean time that is simulated, with that without motion at the end. '
        '*Plain loop* and *MuJoCo*: the same chute, start and time step, one body at a time, read '
        'every T/2 until it is still, for at most 500 T; MuJoCo has no belt, so that of the '
        'comparison is at rest.' + notes
    )
    found = {what: cost._asdict() for what, cost in rows.items()}
    return Section('Surroundings', text, [table], {'surroundings': found})


def _jobs() -> dict[str, DropJob]:
    part, rubber = example_part(), Surfaces.read(ROOT / 'config' / 'surfaces.yaml').get()
    with tempfile.TemporaryDirectory() as folder:
        mesh = ra.surroundings('mesh', mesh=_bowl(Path(folder)))
    kinds: dict[str, Surroundings | None] = {
        'plane': None,
        'slope': ra.surroundings('slope'),
        'v_groove': ra.surroundings('v_groove'),
        'l_chute, belt at rest': ra.surroundings('l_chute', belt={'speed': 0.0}),
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


def _suite(job: DropJob) -> Cost:
    drop_range(job, 0, 1)
    started = time.process_time()
    poses = [drop_range(job, k * CHUNK, (k + 1) * CHUNK) for k in range(CHUNKS)]
    seconds = time.process_time() - started
    n = CHUNKS * CHUNK
    settled = sum(int((each.status == RestStatus.SETTLED).sum()) for each in poses)
    simulated = sum(float(np.nansum(each.time_to_rest)) for each in poses) / job.time_unit
    # Where no energy decides, the rest is detected later than it began.
    simulated += WINDOW * settled if job.scene is not None else 0.0
    return Cost(n, settled, simulated / n, 1000 * seconds / n)


def _plain(job: DropJob) -> Cost:
    with plain_body(job) as body:
        of_part = job.conditions.friction
        belt, wall = (friction / of_part for friction in _planes(job))
        planes = [([0.0, 0.0, 1.0], belt), ([0.0, 1.0, 0.0], wall)]
        body.surround(_down(job), planes, RESIDUAL)
        return _until_still(job, body, REST_MOTION)


def _mujoco(job: DropJob) -> Cost:
    belt, wall = _planes(job)
    body = MujocoBody(job, gravity=_down(job), planes={'z': belt, 'y': wall})
    return _until_still(job, body, MUJOCO_MOTION)


def _planes(job: DropJob) -> list[float]:
    """Return the frictions of belt and wall, which are the planes z = 0 and y = 0."""
    assert job.scene is not None
    return [body.contact.friction for body in job.scene.half_spaces]


def _down(job: DropJob) -> list[float]:
    assert job.scene is not None
    down: list[float] = job.scene.down.tolist()
    return down


def _until_still(job: DropJob, body: PlainBody | MujocoBody, motion: float) -> Cost:
    """Simulate drops until they were still for WINDOW, at most for TIME_LIMIT."""
    states, look = initial_states(job, 0), steps_in(job, CHECK_INTERVAL)
    settled = looks = 0
    started = time.process_time()
    for slot in range(OTHER_DROPS):
        start = (states.position, states.orientation, states.velocity)
        body.start(*(values[slot].tolist() for values in start))
        before, still = body.pose(), 0
        for _ in range(round(TIME_LIMIT / CHECK_INTERVAL)):
            body.step(look)
            looks += 1
            now = body.pose()
            # A quaternion and its negative are the same orientation.
            sign = 1 if sum(a * b for a, b in zip(now[3:], before[3:], strict=True)) > 0 else -1
            now = [*now[:3], *(sign * q for q in now[3:])]
            moved = max(abs(a - b) for a, b in zip(now, before, strict=True))
            before, still = now, still + 1 if moved < motion else 0
            if still == round(WINDOW / CHECK_INTERVAL):
                settled += 1
                break
    seconds = time.process_time() - started
    simulated = looks * CHECK_INTERVAL / OTHER_DROPS
    return Cost(OTHER_DROPS, settled, simulated, 1000 * seconds / OTHER_DROPS)
