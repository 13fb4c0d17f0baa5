"""Drops per second of the suite for the example part, compared with other methods."""

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
from bench_plain import plain_loop, plain_loop_checks, plain_loop_energy
from bench_report import Section, Table
from bench_suite import running_workers, suite
from rich.console import Console
from rich.progress import track

from resting_aspects_ros.core.aspects.aspect import find_aspects
from resting_aspects_ros.core.aspects.aspect_set import AspectSet
from resting_aspects_ros.core.rotations import Array
from resting_aspects_ros.simulation.drop_job import DropJob
from resting_aspects_ros.simulation.initial_state import CHUNK
from resting_aspects_ros.simulation.settling import REST_MOTION, REST_WINDOW

# All methods take turns in each round, so that other load on the machine affects all of them.
ROUNDS = 3
# Chunks of drops per turn, for each worker of the suite and for each other method: 2 to 4 s.
SUITE_CHUNKS = 20
OTHER_CHUNKS = 2

Work = Callable[[DropJob, range], Trial]


@dataclass
class Method:
    """One method to simulate drops of the part, and its trials.

    work : callable
        Simulates the drops of some chunks, in this process or in another.
    package : str
        The pip package that the method needs; empty if the suite depends on it.
    """

    key: str
    title: str
    work: Work
    chunks: int = OTHER_CHUNKS
    package: str = ''
    trials: list[Trial] = field(default_factory=list)

    @property
    def rates(self) -> list[float]:
        """Drops per second in each round."""
        return [trial.drops / trial.seconds for trial in self.trials]

    @property
    def rate(self) -> float:
        """Median of the rates."""
        return statistics.median(self.rates)


def ways(console: Console, workers: int) -> Section:
    """Time all available methods."""
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
    title = f'Drops of {EXAMPLE} per second'
    return Section(title, _text(made), _tables(made), {EXAMPLE: found})


def _known(stack: ExitStack, workers: int) -> list[Method]:
    job = example_job()
    many, one = (stack.enter_context(running_workers(count, job)) for count in (workers, 1))

    def alone(work: Work) -> Work:
        pool = ProcessPoolExecutor(1, get_context('spawn'))
        return partial(_elsewhere, stack.enter_context(pool), work)

    return [
        Method('suite', f'suite, {workers} workers', partial(suite, many), SUITE_CHUNKS * workers),
        Method('one_worker', 'suite, 1 worker', partial(suite, one), SUITE_CHUNKS),
        Method('plain_loop', 'plain loop, read each step', alone(plain_loop)),
        Method('plain_loop_looks', 'plain loop, read every T/2', alone(plain_loop_checks)),
        Method('plain_loop_energy', 'plain loop, ended by energy', alone(plain_loop_energy)),
        Method('mujoco', 'MuJoCo', alone(mujoco_still), package=MUJOCO),
        Method('mujoco_energy', 'MuJoCo, ended by energy', alone(mujoco_energy), package=MUJOCO),
        Method('blender', 'Blender', alone(blender_still), package=BLENDER),
    ]


def _elsewhere(pool: ProcessPoolExecutor, work: Work, job: DropJob, chunks: range) -> Trial:
    return pool.submit(work, job, chunks).result()


def _turns(console: Console, known: list[Method]) -> set[str]:
    """Run all rounds; returns the packages that are missing."""
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
                    f'{way.title} is skipped ({error}); install it with '
                    f'.venv/bin/python -m pip install {way.package}',
                    highlight=False,
                    soft_wrap=True,
                )
            missing.add(way.package)
    turns = [(k, way) for k in range(ROUNDS) for way in known if way.package not in missing]
    for k, way in track(turns, 'drops', console=console, transient=True):
        way.trials.append(way.work(job, range(k * way.chunks, (k + 1) * way.chunks)))
    return missing


def _tables(made: list[Method]) -> list[Table]:
    """Return a table of the rates, and a table of the reasons for them."""
    whole = made[0]
    speed = Table(['method', 'drops/s', 'lowest', 'highest', 'suite is faster by'])
    reasons = Table(
        ['method', 'drops', 'steps per drop', 'µs per step', 'in an aspect', 'distance']
    )
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


def _shares(aspects: AspectSet, way: Method) -> Array:
    """Return the shares, (k,), of the drops that ended in each aspect."""
    ids, _ = aspects.locate(np.vstack([trial.down for trial in way.trials]))
    drops = sum(trial.drops for trial in way.trials)
    return np.bincount(ids, minlength=len(aspects) + 1)[1:] / drops


def _text(made: list[Method]) -> str:
    job = example_job()
    text = (
        f'{EXAMPLE} on `{job.conditions.surface}`, {job.steps_per_t} steps per T = sqrt(R / g), '
        f'{1e3 * job.time_unit:.1f} ms. The rate is the median of {ROUNDS} rounds, in each of '
        'which all methods take turns. *Suite*: running worker processes, each with '
        f'{CHUNK} bodies in one world, timed from the first request to the last pose in the '
        'parent. All other methods simulate one body in one thread, one drop after another, from '
        'the full height (the suite does not simulate the free fall). Their times exclude the '
        'import of the engine and the creation of the world, which is reused for all drops. '
        '*Plain loop*: PyBullet, stepped one by one from Python, with the same scale, mass, '
        'inertia, friction and contact settings. A drop ends when, for '
        f'{REST_WINDOW:g} T, no coordinate of its pose changes by more than {REST_MOTION:g} '
        '(in R, or of a quaternion), compared between checks if the pose is read only every T/2. '
        '*Ended by energy*: with the rule of the suite, applied at every check. *Lowest*, '
        '*highest*: rates of the rounds. *µs per step*: time of one step of one body, on all '
        'cores used. *In an aspect*: share of drops that came to rest in an aspect. *Distance*: '
        "total variation distance to the suite's distribution; sampling alone causes about 0.03 "
        f'for {OTHER_CHUNKS * ROUNDS * CHUNK} drops. *Aim*: on two cores, 50 times the rate of '
        'the plain loop that is read at each step, and at least 20 times. The engine itself sets '
        'the limit: almost all of the time is spent in its steps, fewer steps would change the '
        'result, and the plain loop uses the same solver settings.'
    )
    if any(way.key == 'mujoco' for way in made):
        text += (
            ' *MuJoCo*: same hull, mass, inertia and time step; contacts are springs with the '
            'same bounce height, with elliptic friction cones and without rolling friction; a '
            f'part is still within {MUJOCO_MOTION:g} between checks, because its contacts creep.'
        )
    if any(way.key == 'blender' for way in made):
        text += (
            ' *Blender*: its rigid body world without a window, with the same hull and time step '
            'and a frame every T/2; the inertia is that of a box, and there is no rolling '
            'friction.'
        )
    return text
