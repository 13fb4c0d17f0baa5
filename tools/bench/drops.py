"""Drops per second: parts and surfaces, engines and numbers of threads, other programs."""

import statistics
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from importlib.util import find_spec

from numba import cuda
from rich.progress import track
from validation.document import paragraphs, table
from validation.dropper import Dropper
from validation.mujoco_drops import mujoco_loop

from bench.case import EXAMPLE, job_of
from bench.plain import plain_loop
from resting_aspects_ros.simulation.conditions import BULLET, CUDA, KERNEL
from resting_aspects_ros.simulation.job import DropJob
from resting_aspects_ros.simulation.workers import LocalWorkers, Workers, submit_drops
from resting_aspects_ros.system import available_cores

# All cases take turns in each round, so that other load on the machine affects all of them.
ROUNDS = 3
# Drops per turn of each engine.
PER_TURN = {CUDA: 1_000_000, KERNEL: 50_000, BULLET: 4000}
# Drops per turn of other programs.
OTHER = 200
# Part, surface, and the aim in drops per second on two cores.
CASES = (
    ('l_bracket', 'rubber_mat', '40000'),
    ('l_bracket', 'steel', ''),
    ('l_bracket', 'thrown', '10000'),
    ('cylinder_d20_h20', 'thrown', '5000'),
    ('washer', 'thrown', '5000'),
    ('hex_nut', 'rubber_mat', ''),
)


@dataclass
class Timed:
    """A way to simulate ``drops`` from the index ``first``, and its rates, drops per second."""

    title: str
    work: Callable[[int, int], object]
    drops: int
    aim: str = ''
    rates: list[float] = field(default_factory=list)

    def turn(self, number: int) -> None:
        """Time the drops of a round."""
        started = time.perf_counter()
        self.work(number * self.drops, self.drops)
        self.rates.append(self.drops / (time.perf_counter() - started))


def suite(workers: Workers, job: DropJob, first: int, drops: int) -> None:
    """Simulate drops as the commands do."""
    for future in submit_drops(job, first, drops, workers):
        future.result()


def drops(dropper: Dropper) -> Iterator[str]:
    """Time drops with all workers and with one thread, and in other programs."""
    many, one, count = dropper.workers, LocalWorkers(1), available_cores()
    plain, bullet = job_of(), job_of(engine=BULLET)
    cases = []
    for name, surface, aim in CASES:
        work = partial(suite, many, job_of(name, surface))
        cases.append(Timed(f'{name}, {surface}', work, PER_TURN[KERNEL], aim))
    ways = [
        Timed('suite, 1 thread', partial(suite, one, plain), PER_TURN[KERNEL]),
        Timed(
            f'suite, Bullet in {count} processes', partial(suite, many, bullet), PER_TURN[BULLET]
        ),
        Timed(
            'plain PyBullet loop', partial(plain_loop, bullet), OTHER, 'suite 400 times as fast'
        ),
    ]
    if find_spec('mujoco'):
        ways += [
            Timed(f'MuJoCo, threads: {k}', partial(mujoco_loop, k, bullet), OTHER * k)
            for k in (1, 2)
        ]
    if cuda.is_available():
        on_gpu = partial(suite, many, job_of(engine=CUDA))
        ways.append(Timed('suite on a GPU', on_gpu, PER_TURN[CUDA]))
    for each in ways:
        each.title = f'{EXAMPLE}, rubber_mat: {each.title}'
    cases += ways
    try:
        for each in cases:
            each.work(0, min(each.drops, 500))
        turns = [(k, each) for k in range(ROUNDS) for each in cases]
        for k, each in track(turns, 'drops', transient=True):
            each.turn(k)
    finally:
        one.stop()
    yield from paragraphs(
        '## Drops per second',
        'From the first request to the last pose, with the compiled kernel in '
        f'{count} threads, unless another engine or number of threads is named: the median of '
        f'{ROUNDS} rounds, in each of which all cases take turns. *Lowest*, *highest*: rates of '
        'the rounds. The aims are for two cores. *Plain PyBullet loop*: one body after another in '
        'one world, stepped from Python with the contacts and the time step of the suite in '
        'Bullet; the pose is read after each step. *MuJoCo*: all bodies in the threads of '
        '`mujoco.rollout`, with the same time step. Both simulate each drop from the full height '
        'until it is still.',
    )
    yield from table(
        ['part, surface', 'drops/s', 'lowest', 'highest', 'aim'],
        (
            [
                each.title,
                *(f'{f(each.rates):.0f}' for f in (statistics.median, min, max)),
                each.aim,
            ]
            for each in cases
        ),
        numbers=True,
    )
