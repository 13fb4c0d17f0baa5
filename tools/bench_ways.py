"""How many drops in a second the suite makes of the example part, and what else makes."""

import statistics
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import partial
from multiprocessing import get_context

import numpy as np
from bench_case import EXAMPLE, Trial, example_job, example_part
from bench_engines import (
    BLENDER,
    MUJOCO,
    MUJOCO_MOTION,
    blender_still,
    mujoco_energy,
    mujoco_still,
)
from bench_plain import plain_loop, plain_loop_energy, plain_loop_looks
from bench_report import Section, Table
from bench_suite import begun_workers, suite
from rich.console import Console
from rich.progress import track

from resting_aspects_ros.core.aspects.aspect import find_aspects
from resting_aspects_ros.core.aspects.aspect_set import AspectSet
from resting_aspects_ros.core.rotations import Array
from resting_aspects_ros.simulation.drop_job import DropJob
from resting_aspects_ros.simulation.initial_state import CHUNK
from resting_aspects_ros.simulation.settling import REST_MOTION, REST_WINDOW

# Each way has its turn in each round, so that what else the machine does meets all of them.
ROUNDS = 3
# Chunks of drops in a turn, for each worker of the suite and for each other way: 2 to 4 s.
SUITE_CHUNKS = 20
OTHER_CHUNKS = 2

Work = Callable[[DropJob, range], Trial]


@dataclass
class Way:
    """One way to drop the part, and its turns.

    work : callable
        Makes the drops of some chunks, in this process or in another.
    package : str
        What has to be installed for it, as pip names it; empty if the suite has it.
    """

    key: str
    title: str
    work: Work
    chunks: int = OTHER_CHUNKS
    package: str = ''
    trials: list[Trial] = field(default_factory=list)

    @property
    def rates(self) -> list[float]:
        """Drops in a second, for each round."""
        return [trial.drops / trial.seconds for trial in self.trials]

    @property
    def rate(self) -> float:
        """The median."""
        return statistics.median(self.rates)


def ways(console: Console, workers: int) -> Section:
    """Time all ways that can be timed."""
    with ExitStack() as stack:
        known = _known(stack, workers)
        skipped = _turns(console, known)
    made = [way for way in known if way.trials]
    whole, plain = made[0], next(way for way in made if way.key == 'plain_loop')
    ratios = [a / b for a, b in zip(whole.rates, plain.rates, strict=True)]
    found = {
        'drops_per_s': whole.rate,
        'ratio_to_plain_loop': whole.rate / plain.rate,
        'ratio_to_plain_loop_of_rounds': sorted(ratios),
        'workers': workers,
        **{f'{way.key}_drops_per_s': way.rate for way in made[1:]},
        **{f'ratio_to_{way.key}': whole.rate / way.rate for way in made[3:]},
        'skipped': sorted(skipped),
    }
    title = f'Drops of {EXAMPLE} in a second'
    return Section(title, _text(made), _tables(made), {EXAMPLE: found})


def _known(stack: ExitStack, workers: int) -> list[Way]:
    job = example_job()
    many, one = (stack.enter_context(begun_workers(count, job)) for count in (workers, 1))

    def alone(work: Work) -> Work:
        pool = ProcessPoolExecutor(1, get_context('spawn'))
        return partial(_elsewhere, stack.enter_context(pool), work)

    return [
        Way('suite', f'suite, {workers} workers', partial(suite, many), SUITE_CHUNKS * workers),
        Way('one_worker', 'suite, 1 worker', partial(suite, one), SUITE_CHUNKS),
        Way('plain_loop', 'plain loop, read each step', alone(plain_loop)),
        Way('plain_loop_looks', 'plain loop, read every T/2', alone(plain_loop_looks)),
        Way('plain_loop_energy', 'plain loop, ended by energy', alone(plain_loop_energy)),
        Way('mujoco', 'MuJoCo', alone(mujoco_still), package=MUJOCO),
        Way('mujoco_energy', 'MuJoCo, ended by energy', alone(mujoco_energy), package=MUJOCO),
        Way('blender', 'Blender', alone(blender_still), package=BLENDER),
    ]


def _elsewhere(pool: ProcessPoolExecutor, work: Work, job: DropJob, chunks: range) -> Trial:
    return pool.submit(work, job, chunks).result()


def _turns(console: Console, known: list[Way]) -> set[str]:
    """Let each way have its turns; returns the packages that are missing."""
    job = example_job()
    missing: set[str] = set()
    for way in track(known, 'first drops', console=console, transient=True):
        try:
            way.work(job, range(1))
        except ImportError as error:
            if not way.package:
                raise
            if way.package not in missing:
                console.print(
                    f'{way.title} is skipped ({error}); to compare with it: '
                    f'.venv/bin/python -m pip install {way.package}',
                    highlight=False,
                    soft_wrap=True,
                )
            missing.add(way.package)
    turns = [(k, way) for k in range(ROUNDS) for way in known if way.package not in missing]
    for k, way in track(turns, 'drops', console=console, transient=True):
        way.trials.append(way.work(job, range(k * way.chunks, (k + 1) * way.chunks)))
    return missing


def _tables(made: list[Way]) -> list[Table]:
    """How fast each way is, and why."""
    whole = made[0]
    speed = Table(['way', 'drops/s', 'lowest', 'highest', 'suite is faster by'])
    reasons = Table(['way', 'drops', 'steps a drop', 'µs a step', 'in an aspect', 'apart'])
    aspects = find_aspects(example_part())
    ours = _shares(aspects, whole)
    for way in made:
        drops, steps, seconds = (
            sum(getattr(trial, name) for trial in way.trials)
            for name in ('drops', 'steps', 'seconds')
        )
        shares = _shares(aspects, way)
        speed.rows.append(
            [
                way.title,
                *(f'{rate:.0f}' for rate in (way.rate, min(way.rates), max(way.rates))),
                f'{whole.rate / way.rate:.1f}',
            ]
        )
        reasons.rows.append(
            [
                way.title,
                f'{drops}',
                f'{steps / drops:.0f}',
                f'{1e6 * seconds / steps:.2f}',
                f'{100 * shares.sum():.1f} %',
                f'{np.abs(shares - ours).sum() / 2:.3f}',
            ]
        )
    return [speed, reasons]


def _shares(aspects: AspectSet, way: Way) -> Array:
    """(k,) shares of the drops that ended in each aspect."""
    ids, _ = aspects.locate(np.vstack([trial.down for trial in way.trials]))
    drops = sum(trial.drops for trial in way.trials)
    return np.bincount(ids, minlength=len(aspects) + 1)[1:] / drops


def _text(made: list[Way]) -> str:
    job = example_job()
    text = (
        f'{EXAMPLE} on `{job.conditions.surface}`, {job.steps_per_t} steps in T = sqrt(R / g), '
        f'{1e3 * job.time_unit:.1f} ms. Drops in a second: the median of {ROUNDS} rounds, in '
        'which each way has its turn. *Suite*: worker processes that have begun, each with '
        f'{CHUNK} bodies in one world; from the first request to the last pose in the parent. '
        'All others: one body in one thread, one drop after another, from the full height (the '
        'suite leaves the free fall out); without what it takes to make the world, which is kept '
        'for all drops, and to import the engine. *Plain loop*: PyBullet stepped one by one from '
        'Python, at the same scale, mass, inertia, friction and contact settings. A drop is over '
        f'when for {REST_WINDOW:g} T no coordinate of its pose moves by more than {REST_MOTION:g} '
        '(R, or of a quaternion), from look to look where it is looked at every T/2 only; *ended '
        'by energy*: by the rule of the suite, at every look. *Lowest*, *highest*: of the rounds. '
        '*µs a step*: of one body, on all cores that work. *In an aspect*: where it came to rest. '
        '*Apart*: total variation between where its drops end and where those of the suite do; '
        f'sampling alone makes about 0.03 of {OTHER_CHUNKS * ROUNDS * CHUNK} drops. *Aim*: on '
        'two cores 50 times the plain loop that is read at each step, and 20 at least. What is '
        'between is the engine itself: hardly anything but its steps takes time, fewer steps are '
        'not to be had without another answer, and the plain loop has the same solver settings.'
    )
    if any(way.key == 'mujoco' for way in made):
        text += (
            ' *MuJoCo*: same hull, mass, inertia and step; contacts as springs that bounce as '
            'high, elliptic friction cones, no rolling friction; still within '
            f'{MUJOCO_MOTION:g} a look, because its contacts creep.'
        )
    if any(way.key == 'blender' for way in made):
        text += (
            ' *Blender*: its rigid body world without a window, the same hull and step, a frame '
            'every T/2; the inertia is that of a box, and there is no rolling friction.'
        )
    return text
